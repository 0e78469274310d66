"""The live window of a scene, or of the scenes of a folder: sessions and server together."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

from . import address, server
from .hub import Hub
from .rooms import Rooms
from .scene_files import Opened
from .session import Session
from .state import State
from .studio import Current


class Window:
    """A context in which the window of a scene or a folder is served."""

    def __init__(
        self, path: Path, open_scene: Callable[[Path], Opened], port: int | None = None,
        finished: Callable[[Current, State], None] | None = None, thumbnail: Callable[[Path], bytes] | None = None,
        edited: Callable[[dict[str, Any]], None] | None = None,
    ) -> None:  # fmt: skip
        """Bind the port. `open_scene` gives the options of a scene file; `finished` and `edited` are those of Studio.

        `thumbnail` returns a PNG of a scene file, for the page of a folder; it raises ValueError. Raises OSError.
        """
        self._bound, self.address = address.listen(path, port)

        def make(opened: Opened, hub: Hub) -> Session:
            return Session(opened, hub, finished, edited)

        self.rooms = Rooms(path, open_scene, make)
        self.server = server.Server(server.application(self.rooms, self.address, thumbnail), self._bound)

    @property
    def session(self) -> Session:
        """The session of a window of one scene."""
        return self.rooms.rooms[""].session

    def __enter__(self) -> Window:
        self.rooms.start()
        return self

    def serve(self) -> None:
        """Serve until Ctrl-C or `stop`. Raises KeyboardInterrupt."""
        self.server.serve_here()

    def stop(self) -> None:
        """End `serve`, from any thread."""
        self.server.should_exit = True

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.rooms.stop()
        self._bound.close()
