"""Random scenes of all shapes and materials: the ray backend equals the reference, pixel by pixel.

Where a pixel differs, the reference itself must change there when the eye moves by rounding: an outline, a shadow's edge or the rim of a
reflection runs through that very sample.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.plan import plan
from maquette.compiler.scene import transforms, validate
from maquette.compiler.scene.builder import SceneBuilder
from maquette.compiler.scene.row_records import CameraData, Input, InstanceData, LightData, MaterialData, TextureData, lambert
from maquette.render import render_scene

from ..render.geometry.test_analytic_shapes import SHAPES
from ..render.tables import looking, matrix
from ..render.tracing import wavy

Slot, Model = ir.Slot, ir.MaterialModel
SIZE = (20, 14)
SAME = 2e-4  # of a pixel's largest channel


def materials(builder: SceneBuilder, random: np.random.Generator, holes: bool) -> list[int]:
    """Matte, glossy, mirror, glass and checkered materials; with `holes`, some are partly transparent."""

    def color() -> tuple[float, float, float]:
        r, g, b = random.uniform(0.1, 0.9, 3).tolist()
        return (r, g, b)

    checker = builder.texture(TextureData(ir.TextureKind.CHECKER, size=0.0, mapping=ir.TextureMapping(random.integers(0, 3))))
    shiny = {Slot.DIFFUSE: Input(color()), Slot.SPECULAR: Input(color()), Slot.SHININESS: Input.number(random.uniform(1, 100))}
    made = [
        lambert(color()), lambert(color(), checker), MaterialData(Model.PHONG, shiny),
        MaterialData(Model.BLINN_PHONG, shiny, normalized=True), MaterialData(Model.MIRROR, {Slot.REFLECTION: Input(color())}),
        MaterialData(Model.GLASS, {Slot.TRANSMISSION: Input(color()), Slot.IOR: Input.number(random.uniform(1.1, 2.0))}),
    ]  # fmt: skip
    if holes:
        mask = builder.texture(TextureData(ir.TextureKind.STRIPES, channel=0))
        made.append(replace(made[2], inputs={**shiny, Slot.OPACITY: Input.number(1.0, mask)}))
        made.append(replace(made[0], inputs={**made[0].inputs, Slot.OPACITY: Input.number(random.uniform(0.2, 0.8))}))
    return [builder.material(m) for m in made]


def any_scene(seed: int, holes: bool) -> ir.Scene:
    """A dozen rotated, stretched and mirrored objects of random size and position, under several lights."""
    random = np.random.default_rng(seed)
    size, away = 10.0 ** random.choice([-3, 0, 3]), random.choice([0.0, 10.0, 1e4])
    middle = away * size * np.array([0.6, 0.3, -0.7])
    builder = SceneBuilder()
    rows = materials(builder, random, holes)

    def place() -> np.ndarray:
        turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
        stretch = np.diag(random.uniform(0.3, 1.2, 3) * random.choice([-1, 1], 3) * size)
        return matrix(middle + random.uniform(-2.5, 2.5, 3) * size, turn @ stretch)

    for name in random.choice(list(SHAPES), 9):
        kind, parameters = SHAPES[name]
        builder.instance(InstanceData(builder.geometry(kind, parameters), builder.transform(place()), int(random.choice(rows))))
    for cells in (3, 9):
        data = wavy(cells, seed)
        builder.instance(InstanceData(builder.mesh(data), builder.transform(place()), int(random.choice(rows))))
    for _ in range(2):
        x, y, z = (middle + random.normal(size=3) * 6 * size).tolist()
        builder.light(LightData(ir.LightKind.POINT, (20 * size**2,) * 3, position=(x, y, z)))
    direction = transforms.unit(random.normal(size=3))
    assert direction is not None
    builder.light(LightData(ir.LightKind.DIRECTIONAL, (2.0, 1.9, 1.7), direction=tuple(direction.tolist())))
    builder.light(LightData(ir.LightKind.AMBIENT, (0.1, 0.1, 0.1)))
    eye = middle + np.array([1.0, 1.5, 7.0]) * size
    for off in (0.0, 1.0, -1.0):  # the same eye, and two a rounding error beside it
        shift = off * 1e-9 * (1.0 + away) * size * np.array([1.0, 0.7, 0.4])
        frame = builder.transform(looking((eye + shift).tolist(), (middle + shift).tolist()))
        builder.camera(CameraData(frame, math.tan(0.45), name=f"{off:g}"))
    made, found = validate.validate(builder.finish("any"))
    assert not found.failed
    return made


def drawn(scene: ir.Scene, backend: str, camera: str = "0") -> np.ndarray:
    """(h, w, 4)."""
    asked = ir.Settings(size=SIZE, samples=1, bounces=4, backend=backend, camera=camera, background=(0.2, 0.3, 0.4))
    decided = plan.make_plan(scene, asked, {"interreflection": "off"})
    image = render_scene.draw(scene, decided)
    assert np.isfinite(image.channels["rgba"]).all()
    assert image.metadata["issues"] == 0  # no sample was left out
    return image.channels["rgba"].astype(float)


def apart(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(h, w) whether two pictures differ."""
    scale = np.maximum(np.abs(a).max(axis=-1), 1e-3 * np.abs(a).max())
    return np.abs(a - b).max(axis=-1) > SAME * scale


@pytest.mark.long
@pytest.mark.parametrize("holes", [False, True])
@example(seed=956)  # a mesh's shadow on itself, in vectors with pixels of the background
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=8, deadline=None)
def test_any_scene_is_drawn_as_the_reference_draws_it(holes, seed):
    scene = any_scene(seed, holes)
    expected = drawn(scene, "reference")
    different = apart(expected, drawn(scene, "ray"))
    if different.any():
        unsure = apart(expected, drawn(scene, "reference", "1")) | apart(expected, drawn(scene, "reference", "-1"))
        assert not (different & ~unsure).any(), np.argwhere(different & ~unsure).tolist()
    assert different.mean() < 0.03


@pytest.mark.parametrize("backend", ["ray", "raster", "reference"])
def test_a_checker_on_meshes_without_attributes_is_its_first_colour(backend):
    """No mesh has normals, colours or uv: the attribute tables are empty."""
    builder = SceneBuilder()
    checker = builder.texture(TextureData(ir.TextureKind.CHECKER, color_a=(1.0, 0.5, 0.25), color_b=(0.0, 0.0, 0.0)))
    white = builder.material(lambert((1.0, 1.0, 1.0), checker))
    builder.instance(InstanceData(builder.mesh(wavy(3)), builder.transform(matrix(np.zeros(3), 4.0 * np.eye(3))), white))
    builder.light(LightData(ir.LightKind.AMBIENT, (1.0, 1.0, 1.0)))
    builder.camera(CameraData(builder.transform(looking([0.1, 5.0, 0.2], [0.0, 0.0, 0.0])), math.tan(0.3), name="0"))
    scene, found = validate.validate(builder.finish("bare"))
    assert not found.failed
    assert len(scene.tables.attributes.first) == 0
    rgba = drawn(scene, backend)
    assert np.allclose(rgba, (1.0, 0.5, 0.25, 1.0), atol=1e-6)
