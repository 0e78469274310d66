"""Messages of a page that wait for their turn, so that a flood of them neither fills the memory nor keeps other work waiting."""

from __future__ import annotations

import asyncio
from typing import Any

from .state import StateError

MOST = 512  # messages that wait
REPLACED = ("pick", "outline", "camera")  # of these kinds the newest counts


class Inbox:
    """Sound messages of one page, in order. A newer question replaces an older one of its kind that was not answered yet."""

    def __init__(self) -> None:
        self._waiting: dict[Any, dict[str, Any]] = {}
        self._next = 0
        self._filled = asyncio.Event()

    def put(self, kind: str, message: dict[str, Any]) -> None:
        """Add a message. Raises StateError if too many wait."""
        key: Any = kind
        if kind not in REPLACED:
            if len(self._waiting) >= MOST:
                raise StateError(f"more than {MOST} messages wait: this one is left out")
            key = self._next = self._next + 1
        self._waiting.pop(key, None)
        self._waiting[key] = message
        self._filled.set()

    async def get(self) -> dict[str, Any]:
        """The next message. Other tasks run before."""
        await asyncio.sleep(0)
        while not self._waiting:
            self._filled.clear()
            await self._filled.wait()
        return self._waiting.pop(next(iter(self._waiting)))
