"""An editor for tests: a client of the Language Server Protocol that starts the server as a process and speaks over its pipes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

COMMAND = [sys.executable, "-c", "from maquette.cli.main import main; main()", "lsp", "--stdio"]


class Failure(Exception):
    """An error that the server answers: its message."""


class Editor:
    """One server, and what it has sent. Texts are opened under files of `folder`."""

    def __init__(self, folder: Path, *options: str, **capabilities: Any) -> None:
        self.folder = folder
        self.process = subprocess.Popen([*COMMAND, *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=folder)
        self.diagnostics: dict[str, list[dict[str, Any]]] = {}
        self.checked_versions: dict[str, int | None] = {}
        self.requests = 0
        self.versions: dict[str, int] = {}
        about = {"processId": None, "rootUri": folder.as_uri(), "capabilities": capabilities}
        self.server = self.ask("initialize", about)
        self.tell("initialized", {})

    def _send(self, message: dict[str, Any]) -> None:
        data = json.dumps({"jsonrpc": "2.0", **message}).encode()
        assert self.process.stdin is not None
        self.process.stdin.write(b"Content-Length: %d\r\n\r\n%s" % (len(data), data))
        self.process.stdin.flush()

    def _receive(self) -> dict[str, Any]:
        pipe = self.process.stdout
        assert pipe is not None
        length = 0
        while line := pipe.readline().strip():
            name, _, value = line.partition(b":")
            length = int(value) if name.lower() == b"content-length" else length
        message = json.loads(pipe.read(length))
        if message.get("method") == "textDocument/publishDiagnostics":
            self.diagnostics[message["params"]["uri"]] = message["params"]["diagnostics"]
            self.checked_versions[message["params"]["uri"]] = message["params"].get("version")
        return message

    def tell(self, method: str, params: Any) -> None:
        """Send a notification."""
        self._send({"method": method, "params": params})

    def ask(self, method: str, params: Any) -> Any:
        """The result of a request. Raises Failure."""
        self.requests += 1
        self._send({"id": self.requests, "method": method, "params": params})
        while (message := self._receive()).get("id") != self.requests or "method" in message:
            pass
        if "error" in message:
            raise Failure(message["error"]["message"])
        return message["result"]

    def uri(self, name: str) -> str:
        return (self.folder / name).as_uri()

    def open(self, name: str, text: str) -> None:
        """Open a file, or change the text of an open one."""
        uri = self.uri(name)
        self.versions[uri] = self.versions.get(uri, 0) + 1
        if self.versions[uri] == 1:
            document = {"uri": uri, "languageId": "scene", "version": 1, "text": text}
            self.tell("textDocument/didOpen", {"textDocument": document})
        else:
            document = {"uri": uri, "version": self.versions[uri]}
            self.tell("textDocument/didChange", {"textDocument": document, "contentChanges": [{"text": text}]})

    def close(self, name: str) -> None:
        self.versions.pop(self.uri(name))
        self.tell("textDocument/didClose", {"textDocument": {"uri": self.uri(name)}})

    def checked(self, name: str) -> list[dict[str, Any]]:
        """The diagnostics of the last text of a file."""
        while self.checked_versions.get(self.uri(name)) != self.versions[self.uri(name)]:
            self._receive()
        return self.diagnostics[self.uri(name)]

    def next(self, name: str) -> list[dict[str, Any]]:
        """The diagnostics that come next for a file."""
        while self._receive().get("params", {}).get("uri") != self.uri(name):
            pass
        return self.diagnostics[self.uri(name)]

    def at(self, name: str, method: str, marked: str, **more: Any) -> Any:
        """The answer to a request at the `‸` of a text, which is opened without it."""
        before, _, after = marked.partition("‸")
        self.open(name, before + after)
        line = before.count("\n")
        position = {"line": line, "character": len(before.rpartition("\n")[2].encode("utf-16-le")) // 2}
        return self.ask(f"textDocument/{method}", {"textDocument": {"uri": self.uri(name)}, "position": position, **more})

    def end(self) -> int:
        """End the server; its exit code."""
        self.ask("shutdown", None)
        self.tell("exit", None)
        code = self.process.wait(timeout=30)
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                pipe.close()
        return code
