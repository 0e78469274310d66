"""Solids with `round:`: fillets in closed form, and surfaces that stay where they are."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from maquette.compiler import load
from maquette.compiler.formula import numpy_interpreter
from maquette.compiler.formula.opcodes import ARCS
from maquette.compiler.formula.tape import Tape, load_tape

MM = 1e-3
PLATE = "box([40, 10, 40], center: [0, 5, 0])"
BOSS = "box([20, 30, 20], center: [0, 15, 0])"
WALLS = ("box([20, 2, 20], center: [0, -1, 0])", "box([2, 20, 20], center: [-9, 10, 0])", "box([20, 20, 2], center: [0, 10, -9])")


class Field:
    """The field of a solid, in mm, at points (3, n) in mm."""

    def __init__(self, tmp_path: Path, text: str) -> None:
        path = tmp_path / "a.scene"
        path.write_text(f"unit mm\ncamera([0, 0, 900])\n{text}\n", encoding="utf-8")
        tables = load.load(path).tables
        self.frame = tables.transforms.inverse[int(tables.instances.transform[0])]
        self.tape: Tape = load_tape(tables, int(tables.geometries.tape[int(tables.instances.geometry[0])]))

    def __call__(self, at: np.ndarray) -> np.ndarray:
        local = self.frame[:, :3] @ (np.asarray(at, float) * MM) + self.frame[:, 3:]
        return numpy_interpreter.points(self.tape, *local)[0] / MM

    @property
    def arcs(self) -> int:
        return int((np.isin(self.tape.code[:, 0], list(ARCS))).sum())


def scattered(reach: float, count: int = 40_000) -> np.ndarray:
    return np.random.default_rng(3).uniform(-reach, reach, (3, count))


def test_faces_that_stand_flush_stay(tmp_path):
    """A plate and a block that stands on the ground with it: a fillet of radius 4 where the block leaves the plate, and no more."""
    solid = Field(tmp_path, f"union(round: 4) {{ {PLATE}; {BOSS} }}")
    x, y, z = at = scattered(32, 400_000)
    plate, boss = (np.maximum(np.maximum(abs(x), abs(z)) - a, abs(y - h) - h) for a, h in ((20, 5), (10, 15)))
    beside = np.maximum(abs(x), abs(z)) - 10
    fillet = (y > 10) & (beside > 0) & (y < 14) & (beside < 4) & (np.hypot(14 - y, 4 - beside) >= 4)
    assert np.array_equal(solid(at) <= 0, (np.minimum(plate, boss) <= 0) | fillet)
    below = np.stack([np.linspace(-19.9, 19.9, 4001), np.full(4001, -1e-6), np.zeros(4001)])
    assert (solid(below) > 0).all()
    assert (solid(below * [[1], [-1], [1]]) < 0).all()


@pytest.mark.parametrize("angle", [30, 45, 60, 90, 120, 150, 175])
def test_at_an_angle_a_fillet_is_a_circle_that_touches_both_faces(tmp_path, angle):
    """Plates at a free angle φ: the circle's centre is r / sin(φ/2) from the seam, on the bisector."""
    turned = f"box([105, 10, 40], center: [47.5, 5, 0], rotate: [0deg, 0deg, {angle}deg])"
    solid = Field(tmp_path, f"union(round: 2) {{ box([200, 20, 40], center: [0, -10, 0]); {turned} }}")
    free = math.radians(angle)
    centre = np.array([[math.cos(free / 2)], [math.sin(free / 2)], [0.0]]) * 2 / math.sin(free / 2)
    turns = np.linspace(free - 1.5 * math.pi, -0.5 * math.pi, 41)
    arc = centre + 2 * np.stack([np.cos(turns), np.sin(turns), 0 * turns])
    assert abs(solid(arc)).max() < 1e-12


def test_a_pin_on_a_plate(tmp_path):
    """Plane and cylinder: the fillet is a part of a torus of radii R + r and r."""
    solid = Field(tmp_path, f"union(round: 4) {{ {PLATE}; cylinder(8, 20, center: [0, 15, 0]) }}")
    turn, down = np.random.default_rng(1).uniform(0, 2 * math.pi, 500), np.random.default_rng(2).uniform(math.pi, 1.5 * math.pi, 500)
    ring = 12 + 4 * np.cos(down)
    assert abs(solid(np.stack([ring * np.cos(turn), 14 + 4 * np.sin(down), ring * np.sin(turn)]))).max() < 1e-12


@pytest.mark.parametrize(
    "parts",
    [
        "box([40, 10, 20], center: [0, 5, 0]); cylinder(10, 10, center: [20, 5, 0]); cylinder(10, 10, center: [-20, 5, 0])",  # a link
        "box(20); sphere(10)", "box(20); sphere(10, center: [0, 20, 0])", "sphere(10); sphere(10, center: [20, 0, 0])",
        "sphere(10); sphere(10, center: [20.5, 0, 0])", "cylinder(5, 20); sphere(5, center: [0, 10, 0])",
        "cylinder(5, 20); cylinder(5, 10, center: [0, 15, 0])", "torus(10, 3); box([30, 6, 30])", "capsule(4, 18); cylinder(4, 6)",
        "box(20); box(20, center: [20, 0, 0])", "box([10, 20, 20]); box([10, 20, 20], center: [13, 0, 0])",
        "box(20, rotate: [0, 30deg, 0]); box(20, center: [20, 0, 0], rotate: [0, 30deg, 0])",
    ],
)  # fmt: skip
def test_flush_tangent_and_opposite_faces_stay(tmp_path, parts):
    """Convex joints and gaps: nothing meets at an angle that a fillet could fill, and nothing moves."""
    rounded, sharp, at = Field(tmp_path, f"union(round: 4) {{ {parts} }}"), Field(tmp_path, f"union {{ {parts} }}"), scattered(32)
    assert np.array_equal(rounded(at) <= 0, sharp(at) <= 0)


def test_far_from_a_seam_nothing_moves(tmp_path):
    parts = f"{PLATE}; sphere(9, center: [4, 16, 3]); cylinder(6, 50, center: [-4, 10, 2])"
    rounded, sharp, at = Field(tmp_path, f"union(round: 2) {{ {parts} }}"), Field(tmp_path, f"union {{ {parts} }}"), scattered(32)
    x, y, z = at
    fields = np.stack([
        np.maximum(np.maximum(abs(x), abs(z)) - 20, abs(y - 5) - 5), np.sqrt((x - 4) ** 2 + (y - 16) ** 2 + (z - 3) ** 2) - 9,
        np.maximum(np.hypot(x + 4, z - 2) - 6, abs(y - 10) - 25),
    ])  # fmt: skip
    second = np.sort(fields, axis=0)[1]
    expected = sharp(at)
    far = (second > 2 * (1 + math.sqrt(0.75))) & (expected >= 0)
    assert abs(rounded(at) - expected)[far].max() < 1e-12


@pytest.mark.long
def test_three_parts_do_not_depend_on_their_order(tmp_path):
    parts, at = (*WALLS, "sphere(3, center: [3, 1, 0])", "cylinder(4, 20, center: [3, 0, 3])"), scattered(22)
    orders = list(itertools.permutations(parts))[::23]
    first, *others = (Field(tmp_path, f"union(round: 2) {{ {'; '.join(order)} }}")(at) for order in orders)
    for other in others:
        assert abs(other - first).max() < 1e-13


@pytest.mark.parametrize("kind", ["union", "intersection"])
def test_three_faces_meet_in_a_ball(tmp_path, kind):
    """In the corner of three walls, and at the corner of three slabs, the surface is a sphere of the radius."""
    if kind == "union":
        solid, centre, side = Field(tmp_path, f"union(round: 2) {{ {'; '.join(WALLS)} }}"), (-6.0, 2.0, -6.0), -1
    else:
        slabs = "box([20, 200, 200]); box([200, 20, 200]); box([200, 200, 20])"
        solid, centre, side = Field(tmp_path, f"intersection(round: 2) {{ {slabs} }}"), (8.0, 8.0, 8.0), 1
    way = side * abs(np.random.default_rng(2).normal(size=(3, 500)))
    assert abs(solid(np.array(centre)[:, None] + 2 * way / np.linalg.norm(way, axis=0))).max() < 1e-12


def test_the_edge_of_a_hole_is_round_and_its_faces_stay(tmp_path):
    solid = Field(tmp_path, "difference(round: 1) { box([40, 10, 40]); cylinder(6, 40); box([10, 10, 10], center: [15, 0, 15]) }")
    turn, down = np.random.default_rng(1).uniform(0, 2 * math.pi, 500), np.random.default_rng(2).uniform(0.5 * math.pi, math.pi, 500)
    ring = 7 + np.cos(down)
    assert abs(solid(np.stack([ring * np.cos(turn), 4 + np.sin(down), ring * np.sin(turn)]))).max() < 1e-12
    notch = np.stack([np.full(50, 12.0), np.linspace(-4.999, 4.999, 50), np.full(50, 12.0)])
    assert (solid(notch) > 0).all()  # cut down to flush faces, above and below
    flush = np.stack([np.full(50, 5.0), np.full(50, 5.0), np.linspace(-17, 17, 50)])
    assert abs(solid(flush)[abs(flush[2]) > 8]).max() < 1e-12


def test_fillets_of_fillets(tmp_path):
    """A hole through the plate of a bracket: the bracket's fillet keeps its radius, the hole's edge has its own."""
    bracket = "union(round: 4) { box([60, 6, 30], center: [0, 3, 0]); box([6, 40, 30], center: [-27, 20, 0]) }"
    solid = Field(tmp_path, f"difference(round: 1) {{ {bracket}; cylinder(5, 40, center: [10, 0, 0]) }}")
    turns = np.linspace(math.pi, 1.5 * math.pi, 41)
    inner = np.stack([-20 + 4 * np.cos(turns), 10 + 4 * np.sin(turns), 0 * turns])
    assert abs(solid(inner)).max() < 1e-12
    down = np.linspace(0.5 * math.pi, math.pi, 41)
    edge = np.stack([10 + 6 + np.cos(down), 5 + np.sin(down), 0 * down])
    assert abs(solid(edge)).max() < 1e-12


def test_an_offset_moves_a_fillet_and_a_shell_has_its_inside(tmp_path):
    """A fillet of radius 4 has radius 3 one millimetre further out, and 5 on the inside of a shell of 1."""
    union = f"union(round: 4) {{ {PLATE}; {BOSS} }}"
    turns = np.linspace(math.pi, 1.5 * math.pi, 41)[1:-1]
    for text, radius in ((f"offset(1) {{ {union} }}", 3), (f"shell(1) {{ {union} }}", 5)):
        arc = np.stack([14 + radius * np.cos(turns), 14 + radius * np.sin(turns), 0 * turns])
        assert abs(Field(tmp_path, text)(arc)).max() < 1e-12


def test_operations_only_where_surfaces_meet(tmp_path):
    """Parts without a seam have the tape of a sharp union."""
    apart = "sphere(5); box(4, center: [20, 0, 0]); cylinder(3, 8, center: [0, 20, 0])"
    rounded, sharp = (Field(tmp_path, f"union({how}) {{ {apart} }}").tape for how in ("round: 1", ""))
    assert sorted(rounded.code[:, 0].tolist()) == sorted(sharp.code[:, 0].tolist())
    assert Field(tmp_path, f"union(round: 4) {{ {PLATE}; {BOSS} }}").arcs == 1
