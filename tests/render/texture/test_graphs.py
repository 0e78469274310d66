"""Texture graphs: kernels against the numpy definition, MaterialX's noise against a port of its source, pictures in graphs."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import ir
from maquette.compiler.formula.opcodes import Op
from maquette.compiler.formula.tape import Tape, load_tape
from maquette.compiler.scene import defaults, serialize
from maquette.compiler.scene.builder import SceneBuilder
from maquette.compiler.scene.row_records import Input, InstanceData, MaterialData, TextureData
from maquette.compiler.scene.validate import validate
from maquette.compiler.texture_graph import evaluate, noise
from maquette.compiler.texture_graph.graph_builder import GraphBuilder, TooLarge
from maquette.compiler.texture_graph.opcodes import MOST_ROWS, NORMAL_X, STREAMS, U, V
from maquette.compiler.texture_graph.opcodes import Op as G
from maquette.render.texture import graphs

from .. import tables as make
from . import mx_noise

K = ir.GeometryKind
NOISES = {
    G.PERLIN2: lambda p: mx_noise.perlin(p[:2])[0], G.PERLIN3: lambda p: mx_noise.perlin(p)[0],
    **{op: lambda p, k=k: mx_noise.perlin(p[:2])[1][k] for k, op in enumerate((G.PERLIN2_R, G.PERLIN2_G, G.PERLIN2_B))},
    **{op: lambda p, k=k: mx_noise.perlin(p)[1][k] for k, op in enumerate((G.PERLIN3_R, G.PERLIN3_G, G.PERLIN3_B))},
    G.CELL1: lambda p: mx_noise.cell(p[:1]), G.CELL2: lambda p: mx_noise.cell(p[:2]), G.CELL3: lambda p: mx_noise.cell(p),
    **{op: lambda p, k=k: mx_noise.cell((*p, k)) for k, op in enumerate((G.CELL4_0, G.CELL4_1, G.CELL4_2))},
}  # fmt: skip


def never(texture, s, t):
    raise AssertionError("this graph has no picture")


@pytest.mark.parametrize("op", NOISES, ids=lambda op: op.name)
def test_noise_is_that_of_the_published_source(op):
    points = np.random.default_rng(int(op)).uniform(-40.0, 40.0, (40, 3))
    values = noise.point(noise.NumpyMath(), op, *points.T[: {G.CELL1: 1, G.CELL2: 2}.get(op, 2 if op <= G.PERLIN2_B else 3)])
    np.testing.assert_allclose(values, [NOISES[op](tuple(p)) for p in points], rtol=0, atol=1e-12)
    assert values.std() > 0.1


def test_noise_far_away_is_finite():
    for op in NOISES:
        value = noise.point(noise.NumpyMath(), op, *(np.array([1e300, -1e12, 3e9]),) * 3)[2:]
        assert np.isfinite(value).all(), op


def graph(builder, *rows):
    """Graphs of noise, streams, and a picture whose coordinates another picture bends."""
    picture = builder.texture(TextureData(ir.TextureKind.IMAGE, image=builder.image(rows[0])))
    b = GraphBuilder()
    place = [b.scale(k, 3.0) for k in (0, 1, 2)]
    first = b.look_up(picture, b.scale(U, 2.0), V)
    second = b.look_up(picture, b.add(U, first[0]), b.add(V, first[1]))
    graphs_ = [
        b.finish(*(b.offset(b.op(op, *place), 1.0) for op in (G.PERLIN3_R, G.PERLIN3_G, G.PERLIN3_B))),
        b.finish(b.offset(b.op(G.PERLIN2, b.scale(U, 9.0), b.scale(V, 7.0)), 1.0), b.op(G.CELL3, *place), b.op(Op.ABS, NORMAL_X)),
        b.finish(second[0], b.multiply(second[1], first[2]), b.op(G.CELL4_1, *place)),
        b.finish(U),
        b.finish(b.constant(0.25)),
    ]
    return [builder.texture(TextureData(ir.TextureKind.FORMULA, tape=builder.tape(tape))) for tape in graphs_]


@pytest.mark.long
def test_kernels_draw_the_definition():
    """Each graph on a sphere and a box, through the compiled integrator, whose emission is the texture."""
    texels = np.asarray(np.random.default_rng(0).random((5, 7, 4)), np.float32)

    def prepare(builder):
        return [MaterialData(ir.MaterialModel.EMISSIVE, {ir.Slot.EMISSION: Input(texture=row)}) for row in graph(builder, texels)]

    kinds = [(K.SPHERE, (1.0,)), (K.BOX, (1.0, 0.8, 0.6)), (K.TORUS, (1.0, 0.3)), (K.SPHERE, (0.8,)), (K.BOX, (0.7, 0.7, 0.7))]
    tables = make.scene([(*kind, make.matrix((3 * k, 0, 0), make.turn(1, 0.4)), k) for k, kind in enumerate(kinds)], prepare=prepare)
    tables = graphs.with_lookups(tables)
    x = np.linspace(-1.2, 13.2, 150)
    ray = make.rays(np.stack([x, 0.2 * np.sin(9 * x) + 0.3, 0 * x + 5], axis=1), (0.02, -0.05, -1))
    defined, _ = make.radiance(tables, ray)
    drawn, _ = make.radiance_in_kernel(tables, ray)
    assert all(np.ptp(defined[:, 30 * k : 30 * k + 30]) > 0.1 for k in range(5))
    assert np.abs(defined - drawn).max() < 1e-12


def test_constants_fold_and_equal_operations_share():
    b = GraphBuilder()
    assert b.number(b.add(b.constant(2.0), b.multiply(b.constant(3.0), b.constant(0.5)))) == 3.5
    assert b.add(U, V) == b.add(V, U)
    assert b.mix(U, V, b.constant(1.0)) == V
    assert b.number(b.op(G.CELL2, b.constant(3.2), b.constant(-1.5))) == pytest.approx(mx_noise.cell((3.2, -1.5)), abs=1e-12)
    tape = b.finish(b.add(U, V), b.constant(7.0), V)
    assert len(tape.code) == 1
    assert [float(r[0]) for r in evaluate.results(tape, [np.array([k]) for k in range(8)], never)] == [7.0, 7.0, 4.0]


def test_a_division_by_zero_is_no_number_and_too_many_operations_raise():
    b = GraphBuilder()
    (value,) = evaluate.results(b.finish(b.divide(U, b.constant(0.0))), [np.ones(1)] * 8, never)
    assert not np.isfinite(value).any()
    for _ in range(MOST_ROWS):
        last = b.op(Op.SIN, U if not b.rows[1:] else len(b.rows) + 2)
    assert last < STREAMS[0]
    with pytest.raises(TooLarge, match=str(MOST_ROWS)):
        [b.op(Op.COS, b.offset(U, k)) for k in range(1, 10)]
    assert STREAMS[0] > MOST_ROWS


def complete(builder):
    """A scene with a shape, a camera and lights."""
    builder.instance(InstanceData(builder.geometry(K.SPHERE, (1.0,)), 0, builder.default_material()))
    defaults.add(builder, ir.Settings())
    return builder.finish()


@pytest.mark.parametrize("fault", ["operand", "picture", "channel", "surface"])
def test_a_graph_that_does_not_hold_together_is_an_error(fault):
    """An operand that is not yet defined, a look-up of no picture, one without its channels, and a graph as a surface."""
    b, graph = SceneBuilder(), GraphBuilder()
    picture = b.texture(TextureData(ir.TextureKind.IMAGE, image=b.image(np.ones((1, 1, 4), np.float32))))
    texels = graph.look_up(picture, U, V)
    tape = graph.finish(graph.add(texels[0], texels[3]))
    code, constants = tape.code.copy(), tape.constants.copy()
    if fault == "operand":
        code[-1, 1] = U + 900
    elif fault == "picture":
        constants[:] = 7.0
    elif fault == "channel":
        code[1, 0] = int(Op.COPY)
    row = b.tape(Tape(code, constants, tape.results))
    b.texture(TextureData(ir.TextureKind.FORMULA, tape=row))
    if fault == "surface":
        b.formula(Tape(code, constants, tape.results), np.array([[-1.0] * 3, [1.0] * 3]), (0.0,) * 6)
    _, diagnostics = validate(complete(b))
    assert any("its code does not hold together" in item.message for item in diagnostics.items)


def test_a_graph_survives_being_saved(tmp_path):
    b, graph = SceneBuilder(), GraphBuilder()
    picture = b.texture(TextureData(ir.TextureKind.IMAGE, image=b.image(np.ones((1, 1, 4), np.float32))))
    tape = graph.finish(*graph.look_up(picture, U, graph.op(G.PERLIN2, U, V))[:3])
    b.texture(TextureData(ir.TextureKind.FORMULA, tape=b.tape(tape)))
    scene, diagnostics = validate(complete(b))
    assert diagnostics.items == []
    path = tmp_path / "a.npz"
    serialize.save(scene, path)
    tables = serialize.load(path).tables
    again = load_tape(tables, int(tables.textures.tape[1]))
    assert (again.code.tolist(), again.constants.tolist(), again.results) == (tape.code.tolist(), tape.constants.tolist(), tape.results)
