"""Analytic shapes, one module each: schema, parameters, bounds, rays, coordinates, solid, triangles and exported forms.

A shape is a member of ir.GeometryKind and the module with its name here. May import: lang.schema, compiler.formula, render.lanes.
Begin with `contract.py`, then `torus.py`.
"""

from importlib import import_module

from ..compiler import ir
from .contract import Shape

OTHERS = (ir.GeometryKind.MESH, ir.GeometryKind.FORMULA)
"""The kinds of geometries that are not analytic shapes."""
SHAPES: dict[int, Shape] = {
    kind: import_module(f".{kind.name.lower()}", __name__)  # type: ignore[misc]
    for kind in ir.GeometryKind
    if kind not in OTHERS
}
"""The module of each kind."""
