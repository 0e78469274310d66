"""Serves requests on a worker: keeps scenes and prepared pictures, draws tiles and whole pictures. `serve` is the only task."""

from __future__ import annotations

import json
import math
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...compiler import ir
from ...compiler.plan.plan import Plan
from .. import packing, render_scene
from ..backends import light_groups
from ..film import denoise, tile_calls
from ..image import cryptomatte, image
from ..types import Tile, View
from . import identity, messages

SCENES = 4  # kept, of which the last are drawn
PICTURES = 2  # prepared pictures kept

Reply = tuple[dict[str, Any], dict[str, NDArray[Any]]]


def serve(message: bytes) -> bytes:
    """Answer a message of the client. An exception becomes {"error": its text}."""
    about, arrays = packing.unpack(message)
    try:
        return packing.pack(*_SERVICES[about["do"]](about, arrays))
    except Exception as fault:
        return packing.pack({"error": "not enough memory" if isinstance(fault, MemoryError) else f"{type(fault).__name__}: {fault}"})


# --- scenes ----------------------------------------------------------------------------------------------------------------


class Store:
    """Scenes of which parcels were offered, and their arrays by hash, each held once. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._rows: OrderedDict[str, list[list[Any]]] = OrderedDict()
        self._arrays: dict[str, NDArray[Any]] = {}
        self._parts: dict[str, tuple[bytearray, set[int]]] = {}  # arrays of which not all bytes came yet: bytes, offsets there
        self._scenes: dict[str, ir.Scene] = {}

    def offer(self, key: str, rows: list[list[Any]]) -> list[str]:
        """Note a parcel; return the hashes of the arrays that are missing. Forgets scenes that were not used for long."""
        with self._lock:
            self._rows[key] = rows
            self._rows.move_to_end(key)
            while len(self._rows) > SCENES:
                self._scenes.pop(self._rows.popitem(last=False)[0], None)
            used = {digest for some in self._rows.values() for _, digest, _, _ in some}
            for held in (self._arrays, self._parts):
                for digest in held.keys() - used:
                    del held[digest]
            return [digest for _, digest, _, _ in rows if digest not in self._arrays]

    def keep(self, digest: str, kind: str, shape: list[int], start: int, part: NDArray[np.uint8]) -> None:
        """Store the bytes of an array from number `start` on."""
        dtype = np.dtype(kind)
        with self._lock:
            if digest in self._arrays:
                return
            data, starts = self._parts.setdefault(digest, (bytearray(math.prod(shape) * dtype.itemsize), set()))
            data[start : start + len(part)] = part.data
            starts.add(start)
            if len(starts) * messages.PART >= len(data):
                self._arrays[digest] = np.frombuffer(data, dtype).reshape(shape)
                del self._parts[digest]

    def scene(self, key: str) -> ir.Scene | None:
        """The scene of a parcel; None if some of it is missing."""
        with self._lock:
            rows = self._rows.get(key)
            if rows is None or any(digest not in self._arrays for _, digest, _, _ in rows):
                return None
            self._rows.move_to_end(key)
            if key not in self._scenes:
                self._scenes[key] = messages.scene_from(rows, self._arrays)
            return self._scenes[key]


STORE = Store()


def _offer(about: Mapping[str, Any], _: Any) -> Reply:
    return {"missing": STORE.offer(about["scene"], about["rows"])}, {}


def _keep(about: Mapping[str, Any], arrays: packing.Arrays) -> Reply:
    STORE.keep(about["hash"], about["dtype"], about["shape"], about["start"], arrays["part"])
    return {}, {}


# --- pictures --------------------------------------------------------------------------------------------------------------


class Setting(NamedTuple):
    """What a renderer's samples depend on beside its picture."""

    shared: tuple[int, ...] | None = None  # the state before the round; see film.Renderer.shared
    samples: int = 0  # of the round
    bounces: int = -1  # the limit; -1: the plan's


class Picture:
    """A prepared picture, whose setting changes while no thread draws."""

    def __init__(self, scene: ir.Scene, plan: Plan) -> None:
        self.plan = plan
        self.renderer = render_scene.choose_renderer(scene, plan, View(plan["camera"], *plan["size"]))
        layers = [name for name in plan["aov"] if name in cryptomatte.LAYERS]
        self.mattes = cryptomatte.Mattes(scene, layers) if layers else None
        self.after: tuple[int, ...] = ()  # the state after the round's data were made
        self._setting, self._users, self._changed = Setting(), 0, threading.Condition()

    @contextmanager
    def use(self, setting: Setting) -> Iterator[Any]:
        """Yield the renderer in a setting, for drawing; other threads may use the same setting."""
        with self._changed:
            while self._users and self._setting != setting:
                self._changed.wait()
            if self._setting != setting:
                self._change(setting)
            self._users += 1
        try:
            yield self.renderer
        finally:
            with self._changed:
                self._users -= 1
                self._changed.notify_all()

    def _change(self, setting: Setting) -> None:
        before, self._setting = self._setting, Setting(bounces=-2)  # an exception leaves none
        if setting.shared is not None and setting[:2] != before[:2]:
            self.renderer.share(setting.shared)
            self.renderer.refresh(setting.samples)
            self.after = self.renderer.shared()
        if setting.bounces != before.bounces:
            self.renderer.limit(int(self.plan["bounces"]) if setting.bounces < 0 else setting.bounces)
        self._setting = setting


class Pictures:
    """The last prepared pictures. Threads that ask for the same one wait for its preparation."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: OrderedDict[str, tuple[threading.Lock, list[Picture]]] = OrderedDict()

    def get(self, key: str, make: Callable[[], Picture]) -> Picture:
        """The picture of a key, made if it is not kept."""
        with self._lock:
            lock, pictures = self._kept.setdefault(key, (threading.Lock(), []))
            self._kept.move_to_end(key)
            while len(self._kept) > PICTURES:
                self._kept.popitem(last=False)
        with lock:
            if not pictures:
                pictures.append(make())
            return pictures[0]


PREPARED = Pictures()


def _draw(about: Mapping[str, Any], arrays: packing.Arrays) -> Reply:
    """Answer several requests about one picture; {"missing": true} without its scene."""
    scene = STORE.scene(about["scene"])
    if scene is None:
        return {"missing": True}, {}
    plan = packing.plan_from(about["plan"], about["threads"])
    requests = about["requests"]
    if requests[0]["do"] == "picture":
        return _draw_picture(scene, plan)
    picture = PREPARED.get(json.dumps([about["scene"], about["plan"]]), lambda: Picture(scene, plan))
    began, replies, answers = time.perf_counter(), [], {}
    for k, request in enumerate(requests):
        inputs = {name.partition(".")[2]: array for name, array in arrays.items() if name.startswith(f"{k}.")}
        reply, answer = _REQUESTS[request["do"]](picture, request, inputs, began)
        replies.append(reply)
        answers |= {f"{k}.{name}": array for name, array in answer.items()}
    unproved = render_scene.count_unproved(picture.renderer)
    return {"replies": replies, "seconds": time.perf_counter() - began, "unproved": unproved}, answers


def _draw_picture(scene: ir.Scene, plan: Plan) -> Reply:
    began = time.perf_counter()
    data, arrays = messages.image_to(render_scene.draw(scene, plan))
    return {"replies": [data], "seconds": time.perf_counter() - began}, {f"0.{name}": array for name, array in arrays.items()}


def _facts(picture: Picture, request: Mapping[str, Any], arrays: packing.Arrays, began: float) -> Reply:
    r = picture.renderer
    return {"by_tile": r.by_tile, "cell": r.cell, "side": r.side, "round": r.round, "shared": r.shared()}, {}


def _refresh(picture: Picture, request: Mapping[str, Any], arrays: packing.Arrays, began: float) -> Reply:
    with picture.use(_setting(request)):
        return {"shared": picture.after}, {}


def _sample(picture: Picture, request: Mapping[str, Any], arrays: packing.Arrays, began: float) -> Reply:
    """One call of film.Renderer.sample, with the light of each group."""
    tile, first, count, film = _asked(request, arrays)
    groups = {}
    with picture.use(_setting(request)) as renderer:
        if isinstance(renderer, light_groups.Renderer):
            groups = renderer.sample_groups(tile, first, count, request["total"], film)
        else:
            renderer.sample(tile, first, count, request["total"], film)
    return {}, {**_film_arrays(film), **{f"light:{name}": light for name, light in groups.items()}}


def _batch(picture: Picture, request: Mapping[str, Any], arrays: packing.Arrays, began: float) -> Reply:
    """One call of tile_calls.draw_batch."""
    tile, first, count, film = _asked(request, arrays)
    deadline = math.inf if request["seconds"] is None else began + request["seconds"]
    with picture.use(_setting(request)) as renderer:
        reached = tile_calls.draw_batch(renderer, tile, first, count, request["total"], film, lambda: time.perf_counter() > deadline)
    return {"reached": reached}, _film_arrays(film)


def _auxiliary(picture: Picture, request: Mapping[str, Any], arrays: packing.Arrays, began: float) -> Reply:
    tile = Tile(*request["tile"])
    out = image.blank(tile.x1 - tile.x0, tile.y1 - tile.y0, tuple(request["names"]))
    with picture.use(_setting(request)) as renderer:
        tile_calls.draw_auxiliary(renderer, tile, out, request["samples"], picture.mattes)
    return {}, dict(out)


def _guides(picture: Picture, request: Mapping[str, Any], arrays: packing.Arrays, began: float) -> Reply:
    with picture.use(_setting(request)) as renderer:
        return {}, {"guides": denoise.tile_guides(renderer, Tile(*request["tile"]), request["count"], request["total"])}


def _asked(request: Mapping[str, Any], arrays: packing.Arrays) -> tuple[Tile, NDArray[np.int64], NDArray[np.int64], Any]:
    """(tile, first sample, number of samples, empty film) of a request."""
    tile = Tile(*request["tile"])
    shape = tile.y1 - tile.y0, tile.x1 - tile.x0
    first, count = (messages.counts_from(name, shape, request, arrays) for name in ("first", "samples"))
    return tile, first, count, tile_calls.blank_film(tile)


def _setting(request: Mapping[str, Any]) -> Setting:
    shared, samples, bounces = request["setting"]
    return Setting(None if shared is None else tuple(shared), samples, bounces)


def _film_arrays(film: Any) -> dict[str, NDArray[Any]]:
    return {name: array for name, array in film._asdict().items() if name != "issues" or array.any()}


_SERVICES: dict[str, Callable[[Mapping[str, Any], packing.Arrays], Reply]] = {
    "identify": lambda about, arrays: (dict(identity.identity()), {}),
    "offer": _offer,
    "keep": _keep,
    "draw": _draw,
}
_REQUESTS: dict[str, Callable[[Picture, Mapping[str, Any], packing.Arrays, float], Reply]] = {
    "facts": _facts, "refresh": _refresh, "sample": _sample, "batch": _batch, "auxiliary": _auxiliary, "guides": _guides,
}  # fmt: skip
