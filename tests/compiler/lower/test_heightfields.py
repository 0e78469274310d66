"""Heightfields: heights where they belong, volumes of closed forms, units, solids, and whole messages."""

from __future__ import annotations

import math

import numpy as np
import pytest
import trimesh
from maquette.compiler import ir, load
from maquette.lang.diagnostics import Diagnostics

from ..mesh.test_swept import of_scene

oiio = pytest.importorskip("OpenImageIO")
REST = "\ncamera([0, 1, 5])\nsun()\n"


def picture(path, values: np.ndarray) -> None:
    """Writes heights (rows, columns) in 0..1 as a float picture of one channel."""
    rows, columns = values.shape
    out = oiio.ImageOutput.create(str(path))
    out.open(str(path), oiio.ImageSpec(columns, rows, 1, "float"))
    out.write_image(values.astype(np.float32)[..., None])
    out.close()


def height_at(made: trimesh.Trimesh, x: float, z: float) -> float:
    near = np.linalg.norm(made.vertices[:, [0, 2]] - (x, z), axis=1)
    return float(made.vertices[near < 1e-6, 1].max())


def test_rows_begin_at_the_far_left(compiled):
    made = of_scene(compiled("heightfield([[1, 2, 3], [4, 5, 6]], size: [4, 2])" + REST))
    assert len(made.faces) == 4
    found = [height_at(made, x, z) for z in (-1, 1) for x in (-2, 0, 2)]
    assert found == pytest.approx([1, 2, 3, 4, 5, 6])
    assert (made.face_normals[:, 1] > 0).all()


def test_a_picture_lies_as_it_is_seen(compiled, tmp_path):
    values = np.array([[0, 0.25, 0.5], [1, 0.75, 0.125]])
    picture(tmp_path / "a.exr", values)
    scene = compiled('heightfield("a.exr", size: [4, 2], height: 2)' + REST)
    made = of_scene(scene)
    assert [height_at(made, x, z) for z in (-1, 1) for x in (-2, 0, 2)] == pytest.approx((2 * values).ravel())
    pools = scene.tables.pools
    uv = pools.values[-12:].reshape(-1, 2)  # of the vertices: v = 1 is the picture's first row
    positions = pools.positions + scene.tables.geometries.origin[0]
    assert uv[:, 0] == pytest.approx(positions[:, 0] / 4 + 0.5)
    assert uv[:, 1] == pytest.approx(0.5 - positions[:, 2] / 2)
    assert str(tmp_path / "a.exr") in scene.files


def test_a_colour_picture_counts_by_its_luminance(compiled, tmp_path):
    out = oiio.ImageOutput.create(str(tmp_path / "a.exr"))
    out.open(str(tmp_path / "a.exr"), oiio.ImageSpec(2, 2, 3, "float"))
    out.write_image(np.array([[[1, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 1, 1]]], np.float32))
    out.close()
    made = of_scene(compiled('heightfield("a.exr", size: 2)' + REST))
    assert [height_at(made, x, z) for z in (-1, 1) for x in (-1, 1)] == pytest.approx([0.2126, 0.7152, 0.0722, 1])


def test_channels_that_are_no_heights_are_named(compiled, tmp_path):
    spec = oiio.ImageSpec(2, 2, 2, "float")
    spec.channelnames = ("Y", "mask")
    out = oiio.ImageOutput.create(str(tmp_path / "a.exr"))
    out.open(str(tmp_path / "a.exr"), spec)
    out.write_image(np.array([[[1, 9], [2, 9]], [[3, 9], [4, 9]]], np.float32))
    out.close()
    found = Diagnostics()
    (tmp_path / "a.scene").write_text('heightfield("a.exr", size: 2)' + REST)
    scene = load.load(tmp_path / "a.scene", diagnostics=found)
    assert [height_at(of_scene(scene), x, z) for z in (-1, 1) for x in (-1, 1)] == pytest.approx([1, 2, 3, 4])
    assert [(d.severity, d.message, d.hint) for d in found.items] == [
        ("warning", "of the picture `a.exr`, the channel `mask` is not drawn", "to draw them, write them to files of their own")
    ]


@pytest.mark.parametrize("unit", ["m", "mm", "cm"])
def test_a_formula_is_in_the_unit_of_its_file(compiled, unit):
    """A paraboloid y = (x² + z²) / 2 of its unit."""
    metres = {"m": 1, "mm": 1e-3, "cm": 0.01}[unit]
    made = of_scene(compiled(f"unit {unit}\nheightfield(|x, z| (x^2 + z^2) / 2, size: [4, 2], steps: 8)" + REST))
    x, y, z = made.vertices.T / metres
    assert made.bounds[:, 0] / metres == pytest.approx([-2, 2])
    assert made.bounds[:, 2] / metres == pytest.approx([-1, 1])
    assert y == pytest.approx((x**2 + z**2) / 2, abs=1e-6)
    assert len(made.faces) == 2 * 8 * 4


def test_a_base_makes_a_solid(compiled):
    """∫ (0.3 x + 0.5) over 2 by 1 is 1, and the base 0.25 adds 0.5."""
    made = of_scene(compiled("heightfield(|x, z| 0.3 * x + 0.5, size: [2, 1], steps: 10, base: 0.25)" + REST))
    assert made.is_watertight
    assert made.volume == pytest.approx(1.5, rel=1e-6)
    assert made.bounds[0, 1] == pytest.approx(-0.25)


@pytest.mark.long
def test_the_volume_of_a_smooth_hill(compiled):
    """∫ cos(πx/2) cos(πz/2) over [-1, 1]² is (4/π)²."""
    made = of_scene(compiled("heightfield(|x, z| cos(pi * x / 2) * cos(pi * z / 2), size: 2, base: 1)" + REST))
    assert made.is_watertight
    assert made.volume == pytest.approx((4 / math.pi) ** 2 + 4, rel=1e-4)


def test_the_surface_is_smooth_and_the_walls_are_flat(compiled):
    scene = compiled("heightfield(|x, z| 0.2 * cos(4 * x), size: 1, steps: 4, base: 1)" + REST)
    pools, count = scene.tables.pools, int(scene.tables.geometries.triangle_count[0])
    corners = pools.positions[pools.triangles[:count]].astype(np.float64)
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    face /= np.linalg.norm(face, axis=1)[:, None]
    normals = pools.values[: 9 * count].reshape(-1, 3, 3)
    along = np.einsum("tci,ti->tc", normals, face).min(axis=1)
    assert (along[:32] < 0.9999).any()  # the surface
    assert along[32:] == pytest.approx(1)


def test_a_heightfield_is_a_part_of_solids(compiled):
    made = of_scene(compiled("difference { box(2, center: [0, 0, 0]); heightfield([[0, 0], [0, 0]], size: 1, base: 0.5) }" + REST))
    assert made.is_watertight
    assert made.volume == pytest.approx(8 - 0.5, rel=1e-6)


def test_without_a_base_it_has_no_inside(said):
    found = said("difference { box(2); heightfield([[0, 0], [0, 0]]) }" + REST).splitlines()
    reason = "the mesh is open: 4 of its 5 edges have a triangle on one side only"
    assert found[0] == f"a.scene:1:22: error: `heightfield` cannot be a part of a solid: {reason}"


def test_equal_heightfields_share_a_mesh(compiled):
    scene = compiled("for (k in 0..3) { heightfield([[0, 1], [1, 0]], translate: [k, 0, 0]) }" + REST)
    assert scene.tables.geometries.kind.tolist() == [ir.GeometryKind.MESH]


@pytest.mark.parametrize(
    ("text", "message", "hint"),
    [
        ('heightfield("a.png")', "there is no picture `a.png`", "did you mean `bad.png`?"),
        ('heightfield("bad.png")', "cannot read the picture `bad.png`", None),
        ('heightfield("one.exr")', "the picture `one.exr` has 5 by 1 pixels",
         "heights take 2 by 2 pixels or more, and 4,194,304 pixels at the most"),
        ('heightfield("odd.exr")', "1 of 4 pixels of the picture `odd.exr` are infinite or no numbers", ""),
        ("heightfield([])", "heights are two rows of two or more, got 0 rows", "write [[0, 1], [1, 0]]"),
        ("heightfield([[1, 2]])", "heights are two rows of two or more, got 1 row of 2", "write [[0, 1], [1, 0]]"),
        ("heightfield([[1, 2], [1, 2, 3]])", "row 2 has 3 heights, and the first has 2", "give every row as many"),
        ("heightfield([[1, 2], [1, 2]], height: 2)", "`height` is for a picture: these heights are lengths", "leave out `height`"),
        ("heightfield(|x, z| x, height: 2)", "`height` is for a picture: these heights are a formula", "leave out `height`"),
        ('heightfield("one.exr", steps: 2)', "`steps` is for a formula: these heights are a picture", "leave out `steps`"),
        ("heightfield(|x, y, z| x)", "a formula of heights has two parameters, x and z, not 3", "write |x, z| …"),
        ("heightfield(|x, z| x < z)", "a formula of heights gives a number, not a truth value", "write |x, z| and the height there"),
        ("heightfield(|x, z| [x, z])", "a formula of heights gives a number, not a list", "write |x, z| and the height there"),
        ("heightfield(|x, z| sqrt(x))", "the formula has no value at [x, z] = [-0.5, -0.5] m",
         "keep it in the domain of its functions, by max, abs or clamp"),
        ("heightfield([[0, -1], [0, 0]], base: 50cm)", "the base ends at y = -0.5 m, and the lowest height is -1 m",
         "write a greater `base`"),
    ],
)  # fmt: skip
def test_messages(said, tmp_path, text, message, hint):
    (tmp_path / "bad.png").write_bytes(b"no picture")
    picture(tmp_path / "one.exr", np.zeros((1, 5)))
    picture(tmp_path / "odd.exr", np.array([[0, np.nan], [0, 1]]))
    found = said(text + REST).splitlines()
    assert found[0] == f"a.scene:1:1: error: {message}"
    if hint is not None:
        assert found[2].endswith(f"^ {hint}" if hint else "^")
    assert len(found) == 3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('heightfield(image("a.png"))', "expected file of a picture, formula |x, z| … or list of rows, got the texture `image`"),
        ("heightfield([1, 2])", "expected list of lengths, got the bare number 1"),
    ],
)
def test_arguments_that_do_not_fit(said, text, message):
    assert said(text + REST).splitlines()[0].split(": error: ")[1] == message
