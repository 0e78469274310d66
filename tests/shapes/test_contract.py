"""Each shape answers all that the stages ask of it, and its answers agree with each other."""

from __future__ import annotations

import inspect
import math
import subprocess
import sys

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.catalogue import CATALOGUE
from maquette.compiler.formula import numpy_interpreter
from maquette.compiler.formula.builder import Builder
from maquette.compiler.formula.solid_fields import NoSolid
from maquette.lang.schema.argument_types import REQUIRED, catalogue
from maquette.render.geometry import analytic_shapes
from maquette.render.tessellation import analytic_shapes as tessellation
from maquette.shapes import SHAPES
from maquette.shapes.contract import Shape
from maquette.shapes.lanes import HELPERS

ROWS = {
    "rectangle": (0.5, 0.4), "cylinder": (0.5, 0.6, 1.0), "cone": (0.5, 0.2, 0.6, 1.0), "torus": (0.6, 0.2), "capsule": (0.3, 0.4),
    "box": (0.5, 0.4, 0.3), "quadric": (1.0, -1.0, 1.0, 0, 0, 0, 0, 0, 0, -0.2, 1.0, 1.0, 1.0),
}  # fmt: skip
NAMES = sorted({*Shape.__annotations__, *(name for name, _ in inspect.getmembers(Shape, inspect.isfunction) if not name.startswith("_"))})


def lacking(shape: object) -> list[str]:
    return [name for name in NAMES if not hasattr(shape, name)]


def row_of(shape: Shape) -> list[float]:
    """Parameters of a shape: of ROWS, else by the defaults of its first element."""
    name = shape.KIND.name.lower()
    if name in ROWS:
        return list(ROWS[name])
    entry, parameters, _ = shape.ELEMENTS[0]
    return list(parameters({arg.name: arg.default for arg in entry.args if arg.default is not REQUIRED}))


def rays(shape: Shape, p: list[float], count: int = 4000) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Origins, directions, t and parts of the rays that hit."""
    rng = np.random.default_rng(1)
    o, d = rng.normal(size=(3, count)) * 2.0, rng.normal(size=(3, count)) * 0.4
    o *= 4.0 / np.linalg.norm(o, axis=0)
    d -= o
    table = np.zeros((1, ir.PARAMETERS))
    table[0, : len(p)] = p
    kind, g = np.full(count, int(shape.KIND)), np.zeros(count, np.int64)
    with np.errstate(all="ignore"):
        t, part = analytic_shapes.intersect(kind, table, g, tuple(o), tuple(d), np.zeros(count), np.full(count, np.inf))
    hit = np.isfinite(t)
    return o[:, hit], d[:, hit], t[hit], np.broadcast_to(part, (count,))[hit]


shapes = pytest.mark.parametrize("shape", SHAPES.values(), ids=lambda shape: shape.KIND.name.lower())


@shapes
def test_a_shape_answers_everything(shape: Shape) -> None:
    assert not lacking(shape), f"shapes/{shape.KIND.name.lower()}.py lacks {', '.join(lacking(shape))}"
    unmarked = [name for name in ("hit", "normal", "uv") if getattr(shape, name) not in HELPERS]
    assert not unmarked, f"shapes/{shape.KIND.name.lower()}.py: @helper is missing at {', '.join(unmarked)}"


def test_an_element_has_one_shape() -> None:
    with pytest.raises(ValueError, match=r"^two elements are called torus$"):
        catalogue(CATALOGUE.values(), [CATALOGUE["torus"]])


@pytest.mark.long
def test_the_compiler_loads_shapes_without_llvm() -> None:
    code = "import sys, maquette.compiler.load; print(sorted({'numba', 'llvmlite'} & sys.modules.keys()))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


def test_an_answer_left_out_is_named() -> None:
    class Half:
        KIND = ir.GeometryKind.SPHERE

    assert "hit" in lacking(Half)
    assert "MEASURES" in lacking(Half)
    assert "KIND" not in lacking(Half)


@shapes
def test_the_measures_fit_the_table(shape: Shape) -> None:
    assert SHAPES[shape.KIND] is shape
    assert len(row_of(shape)) == len(shape.MEASURES) <= ir.PARAMETERS
    assert all(entry.entry.category == "shape" for entry in shape.ELEMENTS)


@shapes
def test_hits_lie_in_the_bounds_and_face_outwards(shape: Shape) -> None:
    p = row_of(shape)
    o, d, t, part = rays(shape, p)
    assert len(t) > 50
    points = o + t * d
    low, high = shape.bounds(p)
    assert (points >= low[:, None] - 1e-9).all()
    assert (points <= high[:, None] + 1e-9).all()
    table = np.zeros((1, ir.PARAMETERS))
    table[0, : len(p)] = p
    kind, g = np.full(len(t), int(shape.KIND)), np.zeros(len(t), np.int64)
    n = np.stack(analytic_shapes.normal(kind, table, g, part, tuple(points)))
    assert np.linalg.norm(n, axis=0) == pytest.approx(1.0)
    if shape.is_closed(p):
        assert ((n * d).sum(axis=0) <= 1e-9).all()
    uv, metric = analytic_shapes.uv(kind, table, g, part, tuple(points))
    assert np.isfinite([*uv, *metric]).all()
    assert (np.array(metric) > 0.0).all()


@shapes
def test_the_solid_has_its_surface_where_rays_hit(shape: Shape) -> None:
    p, builder = row_of(shape), Builder()
    try:
        tape = builder.finish(shape.field(builder, p, (0, 1, 2)))
    except NoSolid:
        assert not shape.is_closed(p)
        return
    o, d, t, _ = rays(shape, p)
    values = np.broadcast_to(numpy_interpreter.points(tape, *(o + t * d))[0], len(t))
    assert np.abs(values).max() < 1e-8


@shapes
def test_triangles_are_within_the_tolerance(shape: Shape) -> None:
    p, tolerance = row_of(shape), 1e-3
    triangles = tessellation.tessellate(shape.KIND, p, tolerance)
    off = tessellation.deviation(shape.KIND, p, tolerance, triangles)
    assert off <= tolerance * (1 + 1e-9)
    assert off == 0.0 or not shape.EXACT
    assert not np.isnan(triangles.uvs).any()
    if np.isfinite(shape.bounds(p)).all():
        low, high = shape.bounds(p)
        assert (triangles.positions[:, :3] >= low - 1e-9).all()
        assert (triangles.positions[:, :3] <= high + 1e-9).all()
        assert np.abs(triangles.positions[:, :3].max(axis=0) - high).max() < 0.02 * math.hypot(*(high - low)) or shape.WRAPS


@shapes
def test_the_support_is_that_of_the_triangles(shape: Shape) -> None:
    p, form = row_of(shape), np.array([0.3, 0.8, -0.5])
    if shape.support is not None:
        points = tessellation.tessellate(shape.KIND, p, 1e-5).positions[:, :3]
        assert shape.support(p, form) == pytest.approx(float((points @ form).max()), abs=1e-4)
