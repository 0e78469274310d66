"""The live window of one scene: session and server together."""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType

from . import address, server
from .hub import Hub
from .scene_files import Opened
from .session import Session
from .state import State
from .studio import Current


class Window:
    """A context in which the window of a scene is served."""

    def __init__(self, opened: Opened, port: int | None = None, finished: Callable[[Current, State], None] | None = None) -> None:
        """Bind the port. Raises OSError. `finished` is that of Studio."""
        self._bound, self.address = address.listen(opened.path, port)
        self.hub = Hub()
        self.session = Session(opened, self.hub, finished)
        self.server = server.Server(server.application(self.session, self.hub, self.address), self._bound)

    def __enter__(self) -> Window:
        self.session.start()
        return self

    def serve(self) -> None:
        """Serve until Ctrl-C or `stop`. Raises KeyboardInterrupt."""
        self.server.serve_here()

    def stop(self) -> None:
        """End `serve`, from any thread."""
        self.server.should_exit = True

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.session.stop()
        self._bound.close()
