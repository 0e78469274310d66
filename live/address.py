"""Address of the live window: port and secret token, kept for each scene so that a page finds a restarted server."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import socket
from dataclasses import dataclass
from pathlib import Path

from ..compiler.io import cache_dirs
from ..compiler.io.regular_files import read_text

HOST = "127.0.0.1"


@dataclass(frozen=True, slots=True)
class Address:
    """Where a server listens. Only who knows the token gets an answer."""

    port: int
    token: str

    @property
    def url(self) -> str:
        return f"http://{HOST}:{self.port}/{self.token}/"

    @property
    def hosts(self) -> tuple[str, str]:
        """The values of a request's Host."""
        return f"{HOST}:{self.port}", f"localhost:{self.port}"


def listen(scene: Path, port: int | None) -> tuple[socket.socket, Address]:
    """A socket bound to the loopback interface, and its address.

    Without `port`, the port of the last window of the same scene if it is free, else any free one. Raises OSError.
    """
    file = file_of(scene)
    known_port, token = _read(file)
    bound = None
    for candidate in [port] if port is not None else [known_port, 0]:
        try:
            bound = _bind(candidate or 0)
            break
        except OSError:
            if candidate == port and port is not None:
                raise OSError(f"port {port} of {HOST} is in use: choose another --port") from None
    if bound is None:
        raise OSError(f"no port of {HOST} is free")
    address = Address(bound.getsockname()[1], token)
    _write(file, address)
    return bound, address


def _bind(port: int) -> socket.socket:
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        if os.name == "posix":
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((HOST, port))
        listener.listen(64)
    except OSError:
        listener.close()
        raise
    return listener


def file_of(scene: Path) -> Path:
    """The file that keeps the address of a scene, readable by its owner only."""
    name = hashlib.blake2b(os.fsencode(scene.resolve()), digest_size=12).hexdigest()
    return cache_dirs.cache_root() / "live" / f"{name}.json"


def _read(file: Path) -> tuple[int, str]:
    try:
        record = json.loads(read_text(file))
        port, token = int(record["port"]), str(record["token"])
        if 0 < port < 65536 and len(token) >= 16 and token.replace("-", "").replace("_", "").isalnum():
            return port, token
    except (OSError, ValueError, KeyError, TypeError):
        pass
    return 0, secrets.token_urlsafe(18)


def _write(file: Path, address: Address) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with open(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | getattr(os, "O_NOFOLLOW", 0), 0o600), "w", encoding="utf-8") as out:
            json.dump({"port": address.port, "token": address.token}, out)
    except OSError:
        return  # the next window has another address
