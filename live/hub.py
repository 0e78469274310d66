"""Pages of the live window: each gets the newest message of each type and the newest picture; nothing queues up."""

from __future__ import annotations

import asyncio
import json
import struct
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any

Send = Callable[[str | bytes], Awaitable[None]]
KEPT = ("scene", "params", "files", "diagnostics", "plan", "view", "progress", "state")  # sent to a page that comes later, in this order


MAX_REFUSALS = 1000  # that wait for a page
MAX_REFUSAL = 500  # characters


@dataclass(eq=False, slots=True)
class Page:
    """One page. `pending` are messages to send by key; `picture` is the newest one that was not sent."""

    number: int
    pending: dict[str, str] = field(default_factory=dict)
    picture: bytes | None = None
    wake: asyncio.Event = field(default_factory=asyncio.Event)
    _refused: int = 0

    def put(self, key: str, message: dict[str, Any]) -> None:
        """Send a message, in place of one with the same key that was not sent yet."""
        self.pending.pop(key, None)
        self.pending[key] = json.dumps(message)
        self.wake.set()

    def refuse(self, why: str) -> None:
        """Answer a message that was refused. Each has its answer, unless very many wait for the page to read."""
        self._refused += 1
        self.put(f"refused {self._refused % MAX_REFUSALS}", {"type": "refused", "message": why[:MAX_REFUSAL]})

    async def run(self, send: Send) -> None:
        """Send what there is, until cancelled. Waits while the page is slower than the renderer."""
        while True:
            await self.wake.wait()
            self.wake.clear()
            while self.pending or self.picture is not None:
                if self.pending:
                    await send(self.pending.pop(next(iter(self.pending))))
                else:
                    picture, self.picture = self.picture, None
                    if picture is not None:
                        await send(picture)


class Hub:
    """All pages of a server. `tell` and `show` may be called from any thread."""

    def __init__(self) -> None:
        self.loop: asyncio.AbstractEventLoop | None = None
        self.pages: dict[int, Page] = {}
        self.kept: dict[str, dict[str, Any]] = {}
        self.picture: bytes | None = None
        self._next = 1

    def open(self) -> Page:
        """Add a page; call it in the event loop."""
        page = Page(self._next)
        self._next += 1
        self.pages[page.number] = page
        return page

    def close(self, page: Page) -> None:
        """Remove a page."""
        self.pages.pop(page.number, None)

    def greet(self, page: Page) -> None:
        """Send a page all that the others have."""
        for key in KEPT:
            if key in self.kept:
                page.put(key, self.kept[key])
        page.picture = self.picture
        page.wake.set()

    def tell(self, message: dict[str, Any], key: str = "", but: int = 0) -> None:
        """Send a message to all pages except number `but`. A newer one with the same key (default: its type) replaces it."""
        key = key or str(message["type"])
        if key in KEPT:
            self.kept[key] = message

        def put() -> None:
            for page in self.pages.values():
                if page.number != but:
                    page.put(key, message)

        self._in_loop(put)

    def show(self, about: dict[str, Any], pixels: bytes) -> None:
        """Send a picture to all pages: the length of the description (uint32, little-endian), the description (JSON), RGBA codes."""
        head = json.dumps(about).encode()
        head += b" " * (-len(head) % 4)
        picture = b"".join((struct.pack("<I", len(head)), head, pixels))
        self.picture = picture

        def put() -> None:
            for page in self.pages.values():
                page.picture = picture
                page.wake.set()

        self._in_loop(put)

    def forget(self) -> None:
        """Drop the messages and the picture of a scene that was closed."""
        self.kept.clear()
        self.picture = None

    def _in_loop(self, put: Callable[[], None]) -> None:
        if self.loop is not None and not self.loop.is_closed():
            self.loop.call_soon_threadsafe(put)
