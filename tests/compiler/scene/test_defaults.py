"""What a scene leaves out: the added camera sees everything, the added light is said, and nothing is added that is there."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.compiler import ir
from maquette.compiler.scene import defaults, transforms

extents = st.floats(1e-3, 1e3)
boxes = st.tuples(st.tuples(*[st.floats(-100, 100)] * 3), st.tuples(extents, extents, extents)).map(
    lambda b: np.array([b[0], np.add(b[0], b[1])])
)


@pytest.mark.long
@given(boxes, st.floats(0.1, 2.5), st.floats(0.2, 5))
def test_a_framed_box_fills_the_picture_to_the_margin(bounds: np.ndarray, fov: float, aspect: float) -> None:
    eye, target = defaults.framing(bounds, fov, aspect)
    frame = transforms.looking(tuple(eye), tuple(target), (0, 1, 0))
    assert frame is not None
    corners = np.array([[bounds[i, 0], bounds[j, 1], bounds[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    x, y, z = ((corners - eye) @ frame[:3, :3]).T
    up = math.tan(fov / 2)
    used = max(np.abs(x / z / (up * aspect)).max(), np.abs(y / z / up).max())
    assert (z < 0).all()
    assert 0.3 < used < 1


def test_a_sphere_alone_is_framed_and_lit(compiled) -> None:
    scene = compiled("sphere(1, center: [5, 1, 0])")
    assert [d.split(":")[0] for d in scene.defaults] == ["camera", "sun", "sky"]
    t = scene.tables
    assert t.lights.kind.tolist() == [ir.LightKind.SUN, ir.LightKind.SKY]
    assert t.lights.color[:, 0].sum() == pytest.approx(math.pi * 0.75 + 0.25)
    frame = t.transforms.matrix[t.cameras.transform[0]]
    to_center = np.array([5, 1, 0]) - frame[:, 3]
    assert -frame[:, 2] == pytest.approx(to_center / np.linalg.norm(to_center))


def test_a_white_surface_facing_the_default_sun_shows_one() -> None:
    assert defaults.SUN / math.pi + defaults.SKY == pytest.approx(1)


def test_what_is_there_is_not_added(compiled) -> None:
    scene = compiled("sphere(1)\ncamera([0, 1, 5])\npoint([0, 3, 3])")
    assert scene.defaults == ()
    assert (len(scene.tables.cameras.extent), len(scene.tables.lights.kind)) == (1, 1)


FLAME = "box(1, medium: medium(emission: 2, density: |x, y, z| max(0.4 - y, 0)))\nplane(y: -1)\n"
LAMP = "torus(0.3, 0.1, center: [0, 2, 0], material: emissive(#ffffff))\n"  # no row of lights


@pytest.mark.parametrize(("text", "added"), [
    (FLAME, False),
    ("box(1, material: glass(), medium: medium(emission: 2))", False),
    (FLAME + "render(bounces: 4)", False),
    (FLAME + "render(bounces: 0)", True),  # nothing that emits lights the rest
    (FLAME + 'render(backend: "raster")', True),
    ("box(1, medium: medium(emission: 0, absorption: 1))", True),
    ("box(1, medium: medium(#ffffff, depth: 1))", True),  # scatters light, and has none
    (LAMP + "box(1, material: subsurface(#ffffff, radius: 0.1))", False),
    (LAMP + "box(1, medium: medium(#ffffff, depth: 1))", False),
    (LAMP + "fog(visibility: 10m)", False),
    (LAMP + "box(1, material: glass(), medium: medium(absorption: 1))", True),  # no paths are traced
])  # fmt: skip
def test_what_emits_is_a_light_where_paths_are_traced(compiled, text: str, added: bool) -> None:
    kinds = compiled(text).tables.lights.kind.tolist()
    assert kinds == ([ir.LightKind.SUN, ir.LightKind.SKY] if added else [])


def test_endless_things_are_left_out_of_the_frame(compiled) -> None:
    with_floor, alone = (compiled(text + "sphere(0.2, center: [0, 7, 0])\nsun()") for text in ("plane(y: 0)\n", ""))
    a, b = (s.tables.transforms.matrix[s.tables.cameras.transform[0]] for s in (with_floor, alone))
    assert np.array_equal(a, b)


def test_a_plane_alone_is_seen_from_near_the_origin(compiled) -> None:
    scene = compiled("plane(y: 0)\nsun()")
    assert scene.defaults[0].endswith("frames the origin, as nothing is bounded")


def test_the_sentences(compiled) -> None:
    assert compiled("box(2)").defaults == (
        "camera: the scene has none; one at [2.347, 1.707, 4.267] with a fov of 40deg frames the bounded objects",
        "sun: the scene has no light; one from [1, 2, 1.5] with 2.356 lx",
        "sky: the scene has no light; an even one of 0.25 nit",
    )


def test_nothing_at_all_is_a_warning_and_a_scene(said) -> None:
    assert said("") == "a.scene: warning: there is nothing to draw: the picture will be empty\n  place a shape, for example sphere(1)"
