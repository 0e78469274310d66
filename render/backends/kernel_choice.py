"""Chooses kernels for a picture: specialised to its scene, or general ones, so that no picture waits for the compiler.

Specialised kernels hold only the features of a scene. General kernels hold every feature and branch at run time; one set draws all
scenes, with bit for bit the same result. A picture takes specialised kernels if they are on disk. Otherwise it takes general ones, while
another process compiles the specialised kernels for its later tiles and for the next picture. If neither is on disk, this process
compiles the specialised kernels first. MAQUETTE_KERNELS=special or general selects one kind.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from ...compiler import ir
from ...compiler.io import confinement, environment
from ...compiler.plan.plan import Plan
from ...compiler.scene import serialize
from .. import packing
from ..film.deadline import Deadline
from ..jit import compile_process, kernel_cache
from ..types import Film, FirstHits, Tile, View
from . import prepare

VARIABLE = "MAQUETTE_KERNELS"
CHANGE = 8.0  # times the seconds of making a renderer, that a budget must have left for another one
CHOICES = ("auto", "special", "general")


def backend_of(name: str) -> Any:
    """A backend's renderer class."""
    if name == "raster":
        from .raster import Renderer
    elif name == "reference":
        from .reference import Renderer
    else:
        from .ray import Renderer
    return Renderer


def make_renderer(scene: ir.Scene, plan: Plan, view: View, general: bool) -> Any:
    """Prepare a picture for general or specialised kernels, compile or load these, and return its renderer."""
    return backend_of(plan["backend"])(prepare.prepare(scene, plan, view, general), plan, view)


def describe(scene: ir.Scene, plan: Plan) -> tuple[str, str]:
    """(kind of the kernels that a picture would take now, whether they are ready and their names), without compiling any."""
    if plan["backend"] == "reference":
        return "none", "the reference backend runs in numpy"
    for general in (False, True):
        with kernel_cache.recording() as names, kernel_cache.compiled_only():
            try:
                make_renderer(scene, plan, View(plan["camera"], *plan["size"]), general)
            except kernel_cache.NotCompiled:
                continue
        short = sorted({name.removeprefix("render.") for name in names})
        return "general" if general else "specialised", f"ready: {', '.join(short)}"
    return "specialised", "compiled when the scene is first rendered"


def choose_renderer(scene: ir.Scene, plan: Plan, view: View) -> Any:
    """The renderer of a picture. Raises SettingError for a value of MAQUETTE_KERNELS that is not in CHOICES."""
    make = partial(make_renderer, scene, plan, view)
    asked = environment.read_choice(VARIABLE, CHOICES)
    if plan["backend"] == "reference" or asked != "auto":
        return make(asked == "general" and plan["backend"] != "reference")
    try:
        with kernel_cache.compiled_only():
            return make(False)
    except kernel_cache.NotCompiled as missing:
        wanted = missing
    began = time.perf_counter()
    try:
        with kernel_cache.compiled_only():
            general = make(True)
    except kernel_cache.NotCompiled:
        return make(False)
    compiling = _compile_later(wanted.key, scene, plan, view)
    return Changeover(general, make, compiling, (view.width, view.height), time.perf_counter() - began)


def _compile_later(key: str, scene: ir.Scene, plan: Plan, view: View) -> Callable[[], bool]:
    """Let another process compile a picture's specialised kernels; return whether it is still to end.

    A confined process cannot write the cache, so nothing is compiled for the next picture.
    """
    if confinement.is_confined():
        return lambda: False
    about = {"plan": packing.plan_to(plan), "threads": plan["threads"], "view": view}
    return compile_process.run_later(key, compile_special, lambda: packing.pack(about, serialize.to_arrays(scene)))


def compile_special(message: bytes) -> None:
    """Compile the specialised kernels of a packed picture."""
    about, arrays = packing.unpack(message)
    plan = packing.plan_from(about["plan"], about["threads"])
    scene = serialize.from_arrays({name: array.copy() for name, array in arrays.items()})  # writable: kernels have other types for views
    make_renderer(scene, plan, View(*about["view"]), False)


class Changeover:
    """A renderer with general kernels that goes on with specialised ones when another process has compiled these."""

    def __init__(
        self, general: Any, make: Callable[[bool], Any], compiling: Callable[[], bool], size: tuple[int, int], seconds: float = 0.0
    ) -> None:  # fmt: skip
        """`compiling()` returns whether the other process is still at work; the renderer of a `size` took `seconds` to make."""
        self.current, self.used = general, [general]
        self._make, self._compiling = make, compiling
        self._open = general.whole is None
        self._lock = threading.Lock()
        self._deadline, self._size, self._seconds, self._resized = Deadline(), size, seconds, False

    def __getattr__(self, name: str) -> Any:
        return getattr(self.current, name)

    def limit_time(self, deadline: Deadline) -> None:
        """See film.Renderer."""
        self._deadline = deadline
        self.current.limit_time(deadline)

    def resize(self, width: int, height: int) -> bool:
        """See film.Renderer; the kernels stay while the size is another."""
        done = self.current.resize(width, height)
        self._resized = done and (width, height) != self._size
        return done

    def refresh(self, samples: int) -> None:
        """See film.Renderer."""
        self._advance()
        self.current.refresh(samples)

    def sample(self, tile: Tile, first: Any, count: Any, total: int, film: Film) -> None:
        """See film.Renderer."""
        if self.current.round is None:
            self._advance()
        self.current.sample(tile, first, count, total, film)

    def first(self, tile: Tile, samples: range, total: int) -> Iterator[FirstHits]:
        """See film.Renderer."""
        return self.current.first(tile, samples, total)

    def limit(self, bounces: int) -> None:
        """Set the limit on bounces; from now on the kernels stay."""
        self._open = False
        self.current.limit(bounces)

    def _advance(self) -> None:
        """Take specialised kernels if they are ready."""
        if not self._open or self._resized or self._deadline.left() < CHANGE * self._seconds or self._compiling():
            return
        with self._lock:
            if not self._open:
                return
            self._open = False
            try:
                with kernel_cache.compiled_only():
                    special = self._make(False)
            except kernel_cache.NotCompiled:
                return
            special.continue_from(self.current)
            special.limit_time(self._deadline)
            self.current = special
            self.used.append(special)
