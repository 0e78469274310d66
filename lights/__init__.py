"""Kinds of lights, one module each: elements of the language, form, emission by direction, and forms of other programs.

A light is a member of ir.LightKind and the module with its name here. May import: lang.schema, compiler.formula, shapes.
Begin with `contract.py`, then `spot.py`.
"""

from importlib import import_module

from ..compiler import ir
from .contract import Form, Light

LIGHTS: dict[int, Light] = {kind: import_module(f".{kind.name.lower()}", __name__) for kind in ir.LightKind}  # type: ignore[misc]
"""The module of each kind."""


def of_forms(*forms: Form) -> tuple[int, ...]:
    """The kinds of lights of these forms."""
    return tuple(int(kind) for kind, light in LIGHTS.items() if light.FORM in forms)


RECTANGLES, DISKS, SPHERES = of_forms(Form.RECTANGLE), of_forms(Form.DISK), of_forms(Form.SPHERE)
SURFACES = of_forms(Form.RECTANGLE, Form.DISK, Form.SPHERE)
"""Kinds with an area, in the frame of their transform."""
POINTS = of_forms(Form.POINT)
"""Kinds without an extent, at their position."""
PLACED = POINTS + SURFACES
DISTANT = of_forms(Form.DISTANT)
SKIES = of_forms(Form.SKY)
AMBIENT = of_forms(Form.AMBIENT)
SUNS = tuple(kind for kind in DISTANT if LIGHTS[kind].HAS_ANGLE)
"""Distant kinds with an angular radius."""
SOFT = SUNS + SKIES + SURFACES
"""Kinds with an extent, which take random numbers."""
DIRECTED = DISTANT + tuple(kind for kind in POINTS if LIGHTS[kind].profile is not None)
"""Kinds with a direction of unit length."""
PROFILED = tuple(int(kind) for kind, light in LIGHTS.items() if light.profile is not None)
"""Kinds whose emission depends on the angle from their axis."""
PICTURED = tuple(int(kind) for kind, light in LIGHTS.items() if light.HAS_IMAGE)
"""Kinds whose radiance is an image."""
