"""The open scenes of a window: the one scene, or those of a folder that pages have opened."""

from __future__ import annotations

import asyncio
import hashlib
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ..lang import file_types
from .hub import Hub
from .scene_files import Opened, import_readers
from .session import Session

MAX_SCENES = 2000  # of a folder
LINGER = 3.0  # seconds that a scene of a folder stays open without pages, so that a page can be loaded again


@dataclass(eq=False, slots=True)
class Room:
    """A session with its pages."""

    session: Session
    hub: Hub


class Rooms:
    """Opens scenes by key: "" is the scene of a window of one; keys of a folder are those of `listed`."""

    def __init__(self, path: Path, open_scene: Callable[[Path], Opened], make: Callable[[Opened, Hub], Session]) -> None:
        self.path, self.is_folder = path, path.is_dir()
        self._open, self._make = open_scene, make
        self.rooms: dict[str, Room] = {}
        self._lock = threading.Lock()
        self._loop: asyncio.AbstractEventLoop | None = None

    def start(self) -> None:
        """Open the scene of a window of one; call it in the main thread."""
        import_readers(self.path)
        if not self.is_folder:
            self._add("", self.path)

    def use_loop(self, loop: asyncio.AbstractEventLoop) -> None:
        """Take the event loop that sends to pages."""
        self._loop = loop
        for room in self.rooms.values():
            room.hub.loop = loop

    def stop(self) -> None:
        """Close all scenes."""
        with self._lock:
            rooms, self.rooms = list(self.rooms.values()), {}
        for room in rooms:
            room.session.stop()

    def get(self, key: str) -> Room | None:
        """An open scene."""
        return self.rooms.get(key)

    def enter(self, key: str) -> Room | None:
        """A scene, opened if it is not; None for an unknown key."""
        with self._lock:
            if key not in self.rooms and self.is_folder:
                path = self.listed().get(key)
                if path is not None:
                    self._add(key, path)
            return self.rooms.get(key)

    def _add(self, key: str, path: Path) -> None:
        hub = Hub()
        hub.loop = self._loop
        room = self.rooms[key] = Room(self._make(self._open(path), hub), hub)
        room.session.start()

    def leave(self, key: str) -> None:
        """Close a scene of a folder if it has had no page for a while; call it in the event loop."""
        if self.is_folder and self._loop is not None:
            self._loop.call_later(LINGER, self._close_empty, key)

    def _close_empty(self, key: str) -> None:
        room = self.rooms.get(key)
        if room is not None and not room.hub.pages:
            del self.rooms[key]
            threading.Thread(target=room.session.stop, daemon=True).start()

    def listed(self) -> dict[str, Path]:
        """The scenes of the folder by key, sorted by name; hidden folders are left out."""
        scenes: dict[str, Path] = {}
        for path in sorted(self.path.rglob("*")):
            inside = path.relative_to(self.path)
            if path.suffix.lower() in file_types.OPENED and path.is_file() and not any(part.startswith(".") for part in inside.parts):
                scenes[hashlib.blake2b(inside.as_posix().encode("utf-8", "surrogateescape"), digest_size=8).hexdigest()] = path
                if len(scenes) == MAX_SCENES:
                    break
        return scenes
