"""The page of a notebook: a session whose messages go over a widget in place of a socket."""

from __future__ import annotations

import asyncio
import json
import re
import struct
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from .hub import Hub, Page
from .scene_files import Opened, import_readers
from .session import Session

PAGE = Path(__file__).resolve().parent / "page"
SHOWN = 2.0  # seconds after which the next picture is sent, though the page has not shown the last one

Send = Callable[[dict[str, Any], list[bytes]], None]


class NotebookPage:
    """A scene that is drawn for one widget. `send` takes a message and its buffers."""

    def __init__(self, opened: Opened, send: Send) -> None:
        self._send = send
        self.hub = Hub()
        self.session = Session(opened, self.hub)
        self._shown = asyncio.Event()
        self.page: Page | None = None
        import_readers(opened.path)
        self._loop, self._thread = self._start_loop()
        self.hub.loop = self._loop
        self._loop.call_soon_threadsafe(self._open)
        self.session.start()

    def _start_loop(self) -> tuple[asyncio.AbstractEventLoop, threading.Thread | None]:
        """The loop of the notebook, in which widgets send; without one, a loop in a thread."""
        try:
            return asyncio.get_running_loop(), None
        except RuntimeError:
            loop = asyncio.new_event_loop()
            thread = threading.Thread(target=loop.run_forever, name="notebook", daemon=True)
            thread.start()
            return loop, thread

    def _open(self) -> None:
        self.page = self.hub.open()
        self._sender = self._loop.create_task(self.page.run(self._deliver))

    async def _deliver(self, data: str | bytes) -> None:
        """Send a message; a picture only after the last one was shown."""
        if isinstance(data, str):
            self._send(json.loads(data), [])
            return
        (length,) = struct.unpack_from("<I", data)
        self._shown.clear()
        self._send({"type": "picture", "about": json.loads(data[4 : 4 + length])}, [data[4 + length :]])
        try:
            await asyncio.wait_for(self._shown.wait(), SHOWN)
        except TimeoutError:
            return  # a page that was closed, or a notebook without one

    def receive(self, message: Any) -> None:
        """Answer a message of the widget, from any thread."""

        def answer() -> None:
            if isinstance(message, dict) and message.get("type") == "shown":
                self._shown.set()
            elif self.page is not None:
                self.session.handle(self.page, message)

        self._loop.call_soon_threadsafe(answer)

    def close(self) -> None:
        """End the session."""
        self.session.stop()
        if self._thread is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._sender.cancel)
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(timeout=5.0)
        elif self._thread is None:
            self._sender.cancel()


def module() -> str:
    """The widget's script: the parts of the page that it shares, and widget.js, as one module."""
    parts = [(PAGE / name).read_text(encoding="utf-8") for name in ("canvas.js", "controls.js", "widget.js")]
    return re.sub(r"^export (?=class)", "", "\n".join(parts), flags=re.MULTILINE)
