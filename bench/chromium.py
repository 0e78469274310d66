"""A headless Chromium, driven by the Chrome DevTools Protocol over a WebSocket."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
KEYS = {"Enter": 13, "Backspace": 8, "Home": 36, "End": 35, "Escape": 27, "ArrowDown": 40}


def executable() -> str | None:
    """The path of a Chromium of this machine: MAQUETTE_CHROMIUM, or one on the PATH."""
    return os.environ.get("MAQUETTE_CHROMIUM") or next((path for name in NAMES if (path := shutil.which(name))), None)


class Tab:
    """One page of the browser."""

    def __init__(self, browser: Browser, target: str) -> None:
        self.browser, self.target = browser, target
        self._stack = contextlib.ExitStack()
        address = f"ws://127.0.0.1:{browser.port}/devtools/page/{target}"
        self.socket: ClientConnection = self._stack.enter_context(connect(address, max_size=None, compression=None))
        self._numbers = itertools.count(1)
        self.errors: list[str] = []
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """The result of a command of the protocol. Raises AssertionError for a failed one."""
        number = next(self._numbers)
        self.socket.send(json.dumps({"id": number, "method": method, "params": params}))
        while True:
            message = json.loads(self.socket.recv(timeout=30))
            self._note(message)
            if message.get("id") == number:
                assert "error" not in message, message["error"]
                return message["result"]

    def _note(self, message: dict[str, Any]) -> None:
        """Collect exceptions and errors of the page; lost connections are not errors."""
        if message.get("method") == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(message["params"]["exceptionDetails"].get("exception", message["params"]))[:600])
        if message.get("method") == "Log.entryAdded":
            entry = message["params"]["entry"]
            if entry["level"] == "error" and "WebSocket" not in entry["text"] and entry.get("source") != "network":
                self.errors.append(entry["text"])

    def open(self, url: str) -> None:
        self.call("Page.navigate", url=url)

    def js(self, expression: str) -> Any:
        """The value of an expression in the page."""
        reply = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in reply, reply["exceptionDetails"]
        return reply["result"].get("value")

    def wait(self, expression: str, seconds: float = 20.0) -> Any:
        """The value of an expression once it is true."""
        end = time.monotonic() + seconds
        while not (value := self.js(expression)):
            if time.monotonic() > end:
                state = self.js("document.body ? document.body.innerText.slice(0, 1500) : ''")
                raise AssertionError(f"never true: {expression}\n{self.errors}\n{state}")
            time.sleep(0.02)
        return value

    def mouse(self, kind: str, x: float, y: float, *, buttons: int = 0, modifiers: int = 0) -> None:
        button = "left" if kind != "mouseMoved" or buttons else "none"
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, buttons=buttons, clickCount=1, modifiers=modifiers)

    def place(self, selector: str, x: float = 0.5, y: float = 0.5) -> tuple[float, float]:
        """A point of an element, as shares of its width and height."""
        box = self.js(f"(b => [b.left, b.top, b.width, b.height])(document.querySelector({json.dumps(selector)}).getBoundingClientRect())")
        return box[0] + x * box[2], box[1] + y * box[3]

    def click(self, selector: str, x: float = 0.5, y: float = 0.5) -> None:
        position = self.place(selector, x, y)
        self.mouse("mousePressed", *position, buttons=1)
        self.mouse("mouseReleased", *position)

    def drag(self, selector: str, dx: float, dy: float, steps: int = 8, modifiers: int = 0) -> None:
        x, y = self.place(selector)
        self.mouse("mousePressed", x, y, buttons=1, modifiers=modifiers)
        for k in range(1, steps + 1):
            self.mouse("mouseMoved", x + dx * k / steps, y + dy * k / steps, buttons=1, modifiers=modifiers)
        self.mouse("mouseReleased", x + dx, y + dy, modifiers=modifiers)

    def wheel(self, selector: str, amount: float) -> None:
        x, y = self.place(selector)
        self.call("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=amount)

    def type(self, text: str) -> None:
        self.call("Input.insertText", text=text)

    def key(self, key: str, modifiers: int = 0) -> None:
        """Press a key; modifiers: 1 Alt, 2 Ctrl, 8 Shift."""
        code = KEYS.get(key, ord(key.upper()[0]))
        text = {} if modifiers & 3 or len(key) > 1 else {"text": key}
        self.call("Input.dispatchKeyEvent", type="keyDown", key=key, windowsVirtualKeyCode=code, modifiers=modifiers, **text)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=key, windowsVirtualKeyCode=code, modifiers=modifiers)

    def size(self, width: int, height: int, scale: float = 1.0, dark: bool = False) -> None:
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=scale, mobile=width < 600)
        self.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}])

    def close(self) -> None:
        with contextlib.suppress(Exception):
            self.call("Page.close")
        self._stack.close()


class Browser:
    """A running Chromium."""

    def __init__(self, path: str, folder: Path) -> None:
        options = ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run", "--hide-scrollbars")
        command = [path, *options, f"--user-data-dir={folder}", "--remote-debugging-port=0", "--window-size=1280,800", "about:blank"]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        file, end = folder / "DevToolsActivePort", time.monotonic() + 60
        while not (file.exists() and file.read_text().strip()):
            assert time.monotonic() < end, "Chromium did not start"
            assert self.process.poll() is None, "Chromium ended"
            time.sleep(0.05)
        self.port = int(file.read_text().split()[0])

    def version(self) -> str:
        """Its version, such as 142.0.7444.59."""
        with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/json/version", timeout=30) as answer:
            return str(json.load(answer)["Browser"]).rpartition("/")[2]

    def tab(self, url: str = "about:blank") -> Tab:
        """A new page."""
        request = urllib.request.Request(f"http://127.0.0.1:{self.port}/json/new?about:blank", method="PUT")
        with urllib.request.urlopen(request, timeout=30) as answer:
            tab = Tab(self, json.load(answer)["id"])
        tab.open(url)
        return tab

    def close(self) -> None:
        self.process.terminate()
        try:
            self.process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


@contextlib.contextmanager
def running(folder: Path) -> Iterator[Browser]:
    """A Chromium with a profile in `folder`."""
    path = executable()
    assert path is not None
    browser = Browser(path, folder)
    try:
        yield browser
    finally:
        browser.close()
