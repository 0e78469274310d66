"""Windows under test: a served scene, and a client that speaks as a page does."""

from __future__ import annotations

import contextlib
import json
import struct
import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from maquette.compiler import ir, load
from maquette.live import window
from maquette.live.scene_files import Opened
from websockets.sync.client import ClientConnection, connect

SCENE = """\
use "part.scene"
param radius = 1 in 0.2..2  "radius"
part.ball(radius)
point([2, 4, 3], intensity: 20)
camera(position: [0, 0, 5], look_at: [0, 0, 0], fov: 35deg)
render(size: [32, 24], samples: 2, background: #203040, backend: "reference")
"""
PART = "let ball(radius) = sphere(radius, material: lambert(#ff0000))\n"


def write(folder: Path) -> Path:
    """A scene of two files."""
    (folder / "part.scene").write_text(PART, encoding="utf-8")
    (folder / "a.scene").write_text(SCENE, encoding="utf-8")
    return folder / "a.scene"


@contextlib.contextmanager
def served(scene: Path, port: int | None = None, settings: ir.Settings | None = None, **more: Any) -> Iterator[window.Window]:
    """The window of a scene, served in a thread."""
    def opened(path: Path) -> Opened:
        return Opened(path, partial(load.load, path), settings or ir.Settings())

    with window.Window(scene, opened, port, **more) as shown:
        thread = threading.Thread(target=shown.serve)
        thread.start()
        try:
            yield shown
        finally:
            shown.stop()
            thread.join(timeout=10)
            assert not thread.is_alive()


def until(condition: Callable[[], bool], seconds: float = 20.0) -> None:
    """Wait until a condition is true."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.02)


class Client:
    """A page without a browser."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.last: dict[str, dict[str, Any]] = {}
        self.pictures: list[dict[str, Any]] = []
        self.pixels = np.zeros((1, 1, 4), np.uint8)

    def send(self, kind: str, **fields: Any) -> None:
        self.socket.send(json.dumps({"type": kind, **fields}))

    def receive(self, seconds: float = 20.0) -> str:
        """Take one message in; its type."""
        data = self.socket.recv(timeout=seconds)
        if isinstance(data, bytes):
            (length,) = struct.unpack_from("<I", data)
            about = json.loads(data[4 : 4 + length])
            self.pixels = np.frombuffer(data, np.uint8, offset=4 + length).reshape(about["height"], about["width"], 4)
            self.pictures.append(about)
            return "picture"
        message = json.loads(data)
        self.last[message["type"]] = message
        return str(message["type"])

    def wait(self, condition: Callable[[], Any], seconds: float = 20.0) -> Any:
        """The value of a condition once it is true."""
        end = time.monotonic() + seconds
        while not (value := self._try(condition)):
            left = end - time.monotonic()
            assert left > 0, f"it did not happen in time: {self.last}"
            with contextlib.suppress(TimeoutError):
                self.receive(min(left, 0.5))
        return value

    @staticmethod
    def _try(condition: Callable[[], Any]) -> Any:
        try:
            return condition()
        except (KeyError, IndexError):  # the message did not come yet
            return None

    def ask(self, kind: str, answer: str, **fields: Any) -> dict[str, Any]:
        """The answer to a message."""
        self.last.pop(answer, None)
        self.send(kind, **fields)
        return self.wait(lambda: self.last.get(answer))

    def finished(self, after: int = 0, seconds: float = 20.0) -> dict[str, Any]:
        """The description of a finished picture of a later version."""
        return self.wait(lambda: next((p for p in self.pictures[-1:] if p["finished"] and p["version"] > after), None), seconds)

    @property
    def version(self) -> int:
        return self.pictures[-1]["version"] if self.pictures else 0

    def center(self) -> list[int]:
        height, width = self.pixels.shape[:2]
        return self.pixels[height // 2, width // 2, :3].tolist()

    def errors(self) -> list[str]:
        items = self.last.get("diagnostics", {}).get("items", [])
        return [item["text"] for item in items if item["severity"] == "error"]


@contextlib.contextmanager
def client(shown: window.Window, **hello: Any) -> Iterator[Client]:
    """A connected page that was greeted."""
    address = shown.address
    origin = f"http://127.0.0.1:{address.port}"
    with connect(f"ws://127.0.0.1:{address.port}/{address.token}/socket", origin=origin, max_size=None) as socket:  # type: ignore[arg-type]
        page = Client(socket)
        page.send("hello", **{"boot": None, **hello})
        page.wait(lambda: "hello" in page.last)
        yield page
