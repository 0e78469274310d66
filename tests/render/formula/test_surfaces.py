"""Implicit surfaces in kernels: evaluators against numpy, interpreter against compiled code, and hits against the reference."""

from __future__ import annotations

import gc
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from maquette.compiler import load
from maquette.compiler.formula import numpy_interpreter
from maquette.compiler.formula.opcodes import Op, arity
from maquette.compiler.formula.tape import Tape
from maquette.render.accel import intersect, ray_queries
from maquette.render.formula import interpreter, interval_grid, numpy_reference, scene_surfaces, tape_jit
from maquette.render.formula.evaluator_calls import interpret
from maquette.render.formula.llvm_math import LANES
from maquette.render.formula.op_codegen import WIDTHS
from maquette.render.formula.tables import END_LEAVES
from maquette.render.jit.kernel import kernel
from maquette.render.types import Ray


@kernel
def run(address, code, rows, registers, constants, state):
    """Run a program on one vector of points or boxes."""
    interpret(address, code, np.int64(0), np.int64(rows), registers, constants, np.int64(0), state, np.int64(1))


def evaluate(program: str, tape: Tape, inputs: np.ndarray) -> tuple[np.ndarray, int]:
    """(parts of the result (width, LANES), state) of a program; inputs (3, width, LANES)."""
    rows = scene_surfaces.names_of(tape)
    n, width = len(rows), WIDTHS[program]
    names, code, tapes = np.zeros((n, 4), np.int32), np.zeros((n, 8), np.int32), np.zeros((2, 4), np.int64)
    names[:], tapes[0, 1] = rows, n
    assert interval_grid.allocate_registers(names, code, tapes, 0) == 0
    registers = np.zeros((interval_grid.MAX_REGISTERS, width, LANES))
    registers[:3] = inputs
    flat, state = registers.reshape(-1), np.zeros(64, np.int64)
    run(interpreter.address(program), code, n, flat, scene_surfaces.constant_rows(tape), state)
    return flat.reshape(registers.shape)[tapes[0, 2]], int(state[0])


def single(op: Op) -> Tape:
    return Tape(np.array([[op, 0, 1 if arity(op) > 1 else 0, 2 if arity(op) > 2 else 0]], np.int32), np.zeros(0), (3,))



@pytest.mark.parametrize("op", list(Op), ids=lambda op: op.name.lower())
def test_operations_at_points_agree_with_numpy(op):
    random = np.random.default_rng(int(op))
    for _ in range(20):
        p = random.uniform(-3, 3, (3, LANES))
        values, _ = evaluate("points", single(op), p[:, None])
        expected = numpy_interpreter.points(single(op), *p)[0]
        assert np.allclose(values[0], expected, rtol=1e-13, atol=1e-14, equal_nan=True)


@pytest.mark.parametrize("op", list(Op), ids=lambda op: op.name.lower())
def test_bounds_contain_the_values(op):
    random = np.random.default_rng(100 + int(op))
    turn = 2 * np.pi if op == Op.ANGLE else 0.0
    for _ in range(40):
        low = random.uniform(-3, 3, (3, LANES))
        high = low + 10.0 ** random.uniform(-7, 0, (3, LANES))
        if op == Op.MOD:
            high[1] = low[1]
        if op == Op.POWER:
            low[0], high[0] = abs(low[0]), abs(low[0]) + high[0] - low[0]
        bounds, maybe = evaluate("boxes", single(op), np.stack([low, high], axis=1))
        for _ in range(5):
            value = numpy_interpreter.points(single(op), *(low + random.random(low.shape) * (high - low)))[0]
            inside = (value >= bounds[0]) & (value <= bounds[1])
            for off in (turn, -turn) if turn else ():
                inside |= (value + off >= bounds[0]) & (value + off <= bounds[1])
            undefined = np.isnan(value)
            assert (inside | undefined).all()
            assert (((maybe >> np.arange(LANES)) & 1 == 1) | np.isnan(bounds[0]))[undefined].all()


SURFACES = {
    "torus": "implicit(|x, y, z| (hypot(x, z) - 0.7)^2 + y^2 <= 0.09)",
    "heart": "implicit(|x, y, z| (x^2 + 2.25 * z^2 + y^2 - 1)^3 <= x^2 * y^3 + 0.1125 * z^2 * y^3)",
    "gyroid shell": "implicit(|x, y, z| abs(sin(9*x)*cos(9*y) + sin(9*y)*cos(9*z) + sin(9*z)*cos(9*x)) <= 0.2, within: sphere(1))",
    "noise": "implicit(|x, y, z| y <= 0.5 * noise(2 * x, 0, 2 * z), within: 1)",
    "teeth": "implicit(|x, y, z| hypot(x, z) + 0.05 * cos(18 * atan2(z, x)) <= 1 and abs(y) <= 0.2, within: 1.1)",
    "blend": "difference(round: 0.1) { union(round: 0.2) { sphere(0.6); box([1.6, 0.3, 0.5]) }; cylinder(0.25, 3) }",
    "thin": "implicit(|x, y, z| abs(x^2 + y^2 + z^2 - 1) <= 1e-6)",
    "cusps": "implicit(|x, y, z| 4*(2.618*x^2-y^2)*(2.618*y^2-z^2)*(2.618*z^2-x^2) - 4.236*(x^2+y^2+z^2-1)^2 == 0, within: sphere(1.7))",
    "sheet": "implicit(|x, y, z| y == 0.3 * sin(5 * x) * cos(4 * z), within: 1)",
    "partial": "implicit(|x, y, z| y <= sqrt(0.8 - x^2 - z^2) and y >= log(x + 1.2), within: 1)",
}  # fmt: skip


def scene_of(tmp_path: Path, text: str) -> Any:
    path = tmp_path / "a.scene"
    path.write_text("camera(position: [0, 0, 5])\n" + text + "\n", encoding="utf-8")
    return load.load(path)


def some_rays(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Rays from outside towards the origin, and some from inside."""
    random = np.random.default_rng(seed)
    o = random.normal(size=(count, 3))
    o *= 3 / np.linalg.norm(o, axis=1, keepdims=True)
    d = random.normal(size=(count, 3)) * 0.45 - o
    o[::4] = random.uniform(-0.9, 0.9, (len(o[::4]), 3))
    d[::4] = random.normal(size=(len(o[::4]), 3))
    return o, d / np.linalg.norm(d, axis=1, keepdims=True)


@pytest.mark.long
@pytest.mark.parametrize("name", SURFACES)
def test_hits_agree_with_the_reference(tmp_path, name):
    tables = scene_of(tmp_path, SURFACES[name]).tables
    g, row = int(tables.instances.geometry[0]), int(tables.instances.transform[0])
    assert row == 0
    o, d = some_rays(1200, 7)
    trees = ray_queries.build(tables, closed=False)
    hits = ray_queries.closest(trees, o, d)
    tape, parameters, bounds = scene_surfaces.tape_of(tables, g), tables.geometries.parameters[g], tables.geometries.bounds[g]
    n = len(o)
    t, _, _, _, doubt = numpy_reference.first_hit(tape, parameters, bounds, tuple(o.T), tuple(d.T), np.zeros(n), np.full(n, np.inf))
    sure = ~doubt
    assert sure.mean() > 0.98
    assert (np.isfinite(hits.t) == np.isfinite(t))[sure].all()
    both = np.isfinite(hits.t) & np.isfinite(t) & sure
    assert np.abs(hits.t[both] - t[both]).max(initial=0.0) < 1e-9


@pytest.mark.parametrize("name", ["blend", "gyroid shell", "noise"])
def test_compiled_code_and_interpreter_give_the_same_bits(tmp_path, name):
    tables = scene_of(tmp_path, SURFACES[name]).tables
    o, d = some_rays(2000, 3)
    trees = ray_queries.build(tables, closed=False)
    tape_jit.finish()
    addresses = trees.tables.forms.compiled.copy()
    assert addresses.all()
    results = []
    for table in (addresses, 0):
        trees.tables.forms.compiled[:] = table
        results.append(ray_queries.closest(trees, o, d))
    for compiled, interpreted in zip(*results, strict=True):
        assert np.array_equal(compiled, interpreted)


def test_rays_enter_and_leave_a_solid(tmp_path):
    """The chord of a ball given as a formula."""
    tables = scene_of(tmp_path, "implicit(|x, y, z| x^4 + y^4 + z^4 + 2*(x^2*y^2 + y^2*z^2 + z^2*x^2) <= 1)").tables
    trees = ray_queries.build(tables, closed=False)
    o = np.array([[-3.0, 0.1, 0.2]])
    d = np.array([[1.0, 0.0, 0.0]])
    first = ray_queries.closest(trees, o, d)
    assert first.t[0] == pytest.approx(3 - np.sqrt(0.95), abs=1e-12)
    inside = ray_queries.closest(trees, o + (first.t[0] + 1e-9) * d, d)
    assert inside.t[0] == pytest.approx(2 * np.sqrt(0.95), abs=1e-8)
    assert np.isinf(ray_queries.closest(trees, o + 5 * d, d).t[0])


def test_a_changed_number_compiles_nothing(tmp_path):
    text = "implicit(|x, y, z| x^4 + {0} * y^4 + z^4 <= 1)"
    before, after = (scene_of(tmp_path, text.format(k)).tables for k in (1.5, 2.5))
    assert scene_surfaces.tape_of(before, 0).structure() == scene_surfaces.tape_of(after, 0).structure()
    first = ray_queries.build(before, closed=False)
    tape_jit.finish()
    trees = ray_queries.build(after, closed=False)
    assert trees.tables.forms.compiled.all()
    assert np.array_equal(trees.tables.forms.compiled, first.tables.forms.compiled)


def different_tapes(count: int) -> list[Tape]:
    """Tapes of pairwise different structure."""
    return [Tape(np.array([[Op.ADD, k % 3, k // 3 % 3, 0], [Op.SIN, 3, 0, 0]] + [[Op.COS, 4, 0, 0]] * (k // 9), np.int32), np.zeros(0),
                 (4,)) for k in range(count)]  # fmt: skip


@pytest.mark.long
def test_code_lives_as_long_as_a_table_with_its_address(monkeypatch):
    """Of many formulas, one after the other, only the recent ones stay loaded."""
    tapes = different_tapes(3 * tape_jit.RECENT)
    assert len({tape.structure() for tape in tapes}) == len(tapes)
    first = tape_jit.addresses([tapes[0]])
    tape_jit.finish()
    place, view = first.copy(), first[:1]
    del first
    for tape in tapes[1:]:
        table = tape_jit.addresses([tape])
        tape_jit.finish()
        assert table.all()
        del table
    gc.collect()
    monkeypatch.setattr(tape_jit, "DELAY", 2.0)  # code that is not loaded is not compiled while it is asked for
    alive = [k for k, tape in enumerate(tapes) if k and tape_jit.addresses([tape]).all()]
    tape_jit.finish()
    assert alive == list(range(len(tapes)))[-tape_jit.RECENT :]
    assert (tape_jit.addresses([tapes[0]]) == place).all()  # a view kept its table alive
    assert (view == place).all()
    del view


def test_a_formula_changed_before_its_compilation_is_not_compiled(monkeypatch):
    monkeypatch.setattr(tape_jit, "DELAY", 0.5)
    tape = Tape(np.array([[Op.EXP, 0, 0, 0], [Op.SIN, 3, 0, 0], [Op.EXP, 4, 0, 0]], np.int32), np.zeros(0), (5,))
    table = tape_jit.addresses([tape])
    del table
    tape_jit.finish()
    table = tape_jit.addresses([tape])
    assert not table.any()
    tape_jit.finish()
    assert table.all()


@pytest.mark.long
def test_code_in_use_stays_loaded_while_others_come_and_go(tmp_path):
    """Hits of one formula stay the same while another thread compiles many others."""
    tables = scene_of(tmp_path, SURFACES["blend"]).tables
    o, d = some_rays(500, 4)
    trees = ray_queries.build(tables, closed=False)
    tape_jit.finish()
    expected = ray_queries.closest(trees, o, d).t

    def come_and_go() -> None:
        for tape in different_tapes(3 * tape_jit.RECENT):
            table = tape_jit.addresses([tape])
            tape_jit.finish()
            assert table.all()

    with ThreadPoolExecutor(1) as pool:
        coming = pool.submit(come_and_go)
        while not coming.done():
            assert np.array_equal(ray_queries.closest(trees, o, d).t, expected)
        coming.result()


def test_tapes_of_cells_are_simpler_than_the_whole(tmp_path):
    forms = ray_queries.build(scene_of(tmp_path, many_balls(60)).tables, closed=False)
    before = forms.tables.forms.ends.tolist()
    ray_queries.closest(forms, *some_rays(2000, 3))
    surfaces = forms.tables.forms
    assert before == [1, 0, 1, surfaces.tapes[0, 1]]  # blocks are subdivided by rays only
    leaves = int(surfaces.ends[END_LEAVES])
    assert leaves > 100
    assert surfaces.tapes[0, 1] > 500
    assert surfaces.tapes[surfaces.leaf_tape[:leaves], 1].mean() < 40


def many_balls(count: int) -> str:
    centers = np.round(np.random.default_rng(4).uniform(-0.8, 0.8, (count, 3)), 3)
    return "union {" + "\n".join(f"sphere(0.1, center: [{x}, {y}, {z}])" for x, y, z in centers.tolist()) + "}"


@pytest.mark.long
def test_the_grid_does_not_depend_on_the_threads(tmp_path, monkeypatch):
    """Any thread may subdivide a block first; the contents are the same."""
    monkeypatch.setattr(scene_surfaces, "MAX_CACHED", 1)
    tables, other_scene = (scene_of(tmp_path, many_balls(count)).tables for count in (59, 2))
    o, d = some_rays(6000, 9)
    results = []
    for count in (1, 4, 4, 4):
        ray_queries.build(other_scene, closed=False)  # takes the place of the last grid
        trees, parts = ray_queries.build(tables, closed=False), np.array_split(np.arange(len(o)), count)
        with ThreadPoolExecutor(count) as pool:
            hits = list(pool.map(lambda part, trees=trees: ray_queries.closest(trees, o[part], d[part]), parts))
        results.append([np.concatenate(column) for column in zip(*hits, strict=True)])
    for other in results[1:]:
        for a, b in zip(results[0], other, strict=True):
            assert np.array_equal(a, b)


@pytest.mark.long
def test_occlusion_agrees_with_the_reference(tmp_path):
    tables = scene_of(tmp_path, SURFACES["blend"]).tables
    o, d = some_rays(400, 12)
    ray = Ray(tuple(o.T), tuple(d.T), np.zeros(400), np.full(400, 2.9))
    plainly = intersect.occluded(intersect.Brute(), tables, ray, np.ones(400, bool))
    assert np.array_equal(ray_queries.occluded(ray_queries.build(tables, closed=False), o, d, 0.0, 2.9), plainly)
