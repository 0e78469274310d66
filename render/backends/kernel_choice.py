"""Chooses kernels for a picture: specialised to its scene, or general ones, so that no picture waits for the compiler.

Specialised kernels hold only the features of a scene. General kernels hold every feature and branch at run time; one set draws all
scenes, with bit for bit the same result and about as fast. A picture takes specialised kernels if they are on disk, otherwise general
ones. If neither is on disk, this process compiles the specialised kernels, as they are fewer. MAQUETTE_KERNELS=special or general selects
one kind.
"""

from __future__ import annotations

import contextlib
import importlib
from typing import Any

from ...compiler import ir
from ...compiler.io import environment
from ...compiler.plan.plan import Plan
from ..jit import kernel_cache
from ..types import View
from . import prepare

VARIABLE = "MAQUETTE_KERNELS"
CHOICES = ("auto", "special", "general")


def backend_of(name: str) -> Any:
    """A backend's renderer class: `Renderer` of the module of its name, which is loaded for a picture alone."""
    return importlib.import_module(f".{name}", __package__).Renderer


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
    choice = environment.read_choice(VARIABLE, CHOICES)
    if plan["backend"] == "reference" or choice != "auto":
        return make_renderer(scene, plan, view, choice == "general" and plan["backend"] != "reference")
    for general in (False, True):
        with contextlib.suppress(kernel_cache.NotCompiled), kernel_cache.compiled_only():
            return make_renderer(scene, plan, view, general)
    return make_renderer(scene, plan, view, False)
