"""HTTP server of the live window: the page, its socket, and pictures to download, on the loopback interface alone."""

from __future__ import annotations

import asyncio
import contextlib
import secrets
import socket
import tempfile
import threading
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from ..render.image import image_files
from ..render.image.image import Image
from . import page_messages
from .address import Address
from .hub import Page
from .inbox import Inbox
from .rooms import Rooms
from .session import Session
from .state import StateError
from .studio import Current

PAGE = Path(__file__).resolve().parent / "page"
TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml", ".txt": "text/plain"}
PICTURES = {"png": "image/png", "exr": "image/x-exr"}
MAX_MESSAGE = 24 << 20  # bytes of a message of a page
HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; connect-src 'self' {sockets}; "
    "base-uri 'none'; form-action 'none'; frame-ancestors vscode-file: vscode-webview:"  # the preview of VS Code: tools/vscode
)


class Guard:
    """Lets through requests to this host, of this origin, with the token; other requests learn nothing."""

    def __init__(self, app: ASGIApp, address: Address) -> None:
        self.app, self.address = app, address

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket") or self._allowed(scope):
            await self.app(scope, receive, send)
        elif scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
        else:
            await PlainTextResponse("not found\n", 404, HEADERS)(scope, receive, send)

    def _allowed(self, scope: Mapping[str, Any]) -> bool:
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        origin = headers.get("origin")
        if headers.get("host") not in self.address.hosts:
            return False
        if origin is None and scope["type"] == "websocket":
            return False
        if origin is not None and origin not in [f"http://{host}" for host in self.address.hosts]:
            return False
        token = str(scope["path"]).lstrip("/").partition("/")[0]
        return secrets.compare_digest(token.encode(), self.address.token.encode())


def application(rooms: Rooms, address: Address, thumbnail: Callable[[Path], bytes] | None = None) -> ASGIApp:
    """The server's ASGI application: one scene at `/token/`, or a folder there and its scenes at `/token/scene/key/`."""
    served = _Served(rooms, thumbnail, POLICY.format(sockets=" ".join(f"ws://{host}" for host in address.hosts)))

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        rooms.use_loop(asyncio.get_running_loop())
        yield

    routes = []
    for place in ("/{token}", "/{token}/scene/{key}"):
        routes += [WebSocketRoute(f"{place}/socket", served.talk), Route(f"{place}/picture.{{kind}}", served.picture)]
    routes += [Route("/{token}/list.json", served.listed), Route("/{token}/thumbnail/{key}", served.thumbnail)]
    for place in ("/{token}", "/{token}/scene/{key}"):
        routes += [Route(f"{place}/", served.page), Route(f"{place}/{{name}}", served.page)]
    return Guard(Starlette(routes=routes, lifespan=lifespan), address)


class _Served:
    """The answers to requests."""

    def __init__(self, rooms: Rooms, thumbnail: Callable[[Path], bytes] | None, policy: str) -> None:
        self.rooms, self.policy, self._draw = rooms, policy, thumbnail
        self.files = {path.name: path for path in PAGE.iterdir() if path.suffix in TYPES}
        self._thumbnails: dict[str, tuple[int, bytes]] = {}  # by key: time of change and PNG
        self._drawing = asyncio.Lock()  # one thumbnail at a time

    async def page(self, request: Request) -> Response:
        first = "gallery.html" if self.rooms.is_folder and "key" not in request.path_params else "index.html"
        file = self.files.get(request.path_params.get("name") or first)
        if file is None:
            return PlainTextResponse("not found\n", 404, HEADERS)
        headers = {**HEADERS, "Content-Security-Policy": self.policy}
        return Response(file.read_bytes(), media_type=TYPES[file.suffix], headers=headers)

    async def picture(self, request: Request) -> Response:
        kind, room = request.path_params["kind"], self.rooms.get(request.path_params.get("key", ""))
        current = None if room is None else room.session.studio.current
        if room is None or kind not in PICTURES or current is None:
            return PlainTextResponse("there is no picture yet\n", 404, HEADERS)
        data = await asyncio.to_thread(encoded, current, kind)
        name = f"{room.session.opened.path.stem}.{kind}".encode("ascii", "replace").decode().replace('"', "_")
        return Response(data, media_type=PICTURES[kind], headers={**HEADERS, "Content-Disposition": f'attachment; filename="{name}"'})

    async def listed(self, _: Request) -> Response:
        if not self.rooms.is_folder:
            return PlainTextResponse("not found\n", 404, HEADERS)
        scene_paths = await asyncio.to_thread(self.rooms.listed)
        scenes = [{"key": key, "name": path.relative_to(self.rooms.path).as_posix()} for key, path in scene_paths.items()]
        return JSONResponse({"folder": self.rooms.path.resolve().name, "scenes": scenes}, headers=HEADERS)

    async def thumbnail(self, request: Request) -> Response:
        key = request.path_params["key"]
        path = self.rooms.listed().get(key) if self.rooms.is_folder else None
        if path is None or self._draw is None:
            return PlainTextResponse("not found\n", 404, HEADERS)
        async with self._drawing:
            try:
                changed = path.stat().st_mtime_ns
                if self._thumbnails.get(key, (0, b""))[0] != changed:
                    self._thumbnails[key] = changed, await _in_daemon(partial(self._draw, path))
            except (OSError, ValueError) as error:
                return PlainTextResponse(f"{error}\n", 422, HEADERS)
        return Response(self._thumbnails[key][1], media_type="image/png", headers=HEADERS)

    async def talk(self, websocket: WebSocket) -> None:
        key = websocket.path_params.get("key", "")
        room = await asyncio.to_thread(self.rooms.enter, key)
        if room is None:
            await websocket.close(1008)
            return
        await websocket.accept()
        page = room.hub.open()
        inbox = Inbox()
        tasks = [asyncio.create_task(page.run(_sender(websocket))), asyncio.create_task(_answer(room.session, page, inbox))]
        try:
            while (received := await websocket.receive())["type"] == "websocket.receive":
                try:
                    message = page_messages.parsed(received.get("text") or received.get("bytes") or "")
                    inbox.put(page_messages.check(message), message)
                except StateError as error:
                    page.refuse(str(error))
                await asyncio.sleep(0)  # otherwise a flood keeps all other tasks waiting
        except (WebSocketDisconnect, RuntimeError):
            pass
        finally:
            room.hub.close(page)
            self.rooms.leave(key)
            for task in tasks:
                task.cancel()
                with contextlib.suppress(asyncio.CancelledError, Exception):
                    await task


async def _answer(session: Session, page: Page, inbox: Inbox) -> None:
    """Answer the messages of a page, until cancelled."""
    while True:
        session.handle(page, await inbox.get())


async def _in_daemon(call: Callable[[], bytes]) -> bytes:
    """The result of a call in a thread that the end of the server does not wait for."""
    loop = asyncio.get_running_loop()
    done: asyncio.Future[bytes] = loop.create_future()

    def finish(result: bytes | None, error: Exception | None) -> None:
        if done.cancelled():
            return
        if error is not None:
            done.set_exception(error)
        else:
            done.set_result(result or b"")

    def run() -> None:
        result, error = None, None
        try:
            result = call()
        except Exception as fault:
            error = fault
        with contextlib.suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(finish, result, error)

    threading.Thread(target=run, daemon=True).start()
    return await done


def _sender(websocket: WebSocket) -> Callable[[str | bytes], Awaitable[None]]:
    async def send(data: str | bytes) -> None:
        if isinstance(data, str):
            await websocket.send_text(data)
        else:
            await websocket.send_bytes(data)

    return send


def encoded(current: Current, kind: str) -> bytes:
    """The picture that the window shows as the bytes of a file; all channels of a finished one as EXR."""
    shown, plan = current.shown, current.plan
    image = current.finished
    if image is None:
        height, width = shown.rgba.shape[:2]
        image = Image(width, height, {"rgba": shown.rgba}, {})
    look = image_files.Look.of(plan, current.exposure)
    with tempfile.TemporaryDirectory(prefix="maquette-") as folder:
        path = Path(folder) / f"picture.{kind}"
        image_files.write(image, path, look, {"backend": plan["backend"], "exposure": current.exposure})
        return path.read_bytes()


class Server(uvicorn.Server):
    """A server on a bound socket. `run_until` serves until Ctrl-C or `should_exit`."""

    def __init__(self, app: ASGIApp, bound: socket.socket) -> None:
        super().__init__(
            uvicorn.Config(
                app, log_level="error", access_log=False, lifespan="on", ws="websockets-sansio", ws_max_size=MAX_MESSAGE,
                ws_per_message_deflate=False, server_header=False, date_header=False, timeout_graceful_shutdown=1,
            )
        )  # fmt: skip
        self.bound = bound

    def serve_here(self) -> None:
        """Serve in this thread. Raises KeyboardInterrupt after Ctrl-C in the main thread."""
        self.run(sockets=[self.bound])
