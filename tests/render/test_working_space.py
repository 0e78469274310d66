"""Tests of working spaces: each kind of colour against the product in that space, by a matt wall under a coloured light."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import OpenImageIO as oiio
import pytest
from maquette.compiler import ir
from maquette.compiler.plan import plan as planner
from maquette.compiler.plan.plan import Plan, PlanError
from maquette.compiler.scene import validate
from maquette.compiler.texture_graph.graph_builder import GraphBuilder
from maquette.compiler.texture_graph.opcodes import U, V
from maquette.lang import color_spaces
from maquette.render import working_space
from maquette.render.image import image_files, image_reader
from maquette.render.image.image import Image

SPACES = [space for space in color_spaces.WORKING if space != "rec709"]
LIGHT = (1.0, 0.4, 0.1)
COLOR = (0.8, 0.1, 0.3)
SCENE = """
plane(material: MATERIAL)
directional(from: [0, 1, 0], color: rgb(1, 0.4, 0.1), illuminance: 3.141592653589793)
camera(position: [0, 1, 0], look_at: [0, 0, 0], up: [0, 0, -1], width: 0.1)
render(size: [4, 4], samples: 1, background: #000)
"""


def matrix(source: str, target: str) -> np.ndarray:
    return np.array(color_spaces.matrix(color_spaces.WORKING[source], color_spaces.WORKING[target]))


def product(space: str, *colors: tuple[float, ...]) -> np.ndarray:
    """Rec.709 of the product of Rec.709 colours in a working space."""
    into = matrix("rec709", space)
    return matrix(space, "rec709") @ np.prod([into @ np.array(color) for color in colors], axis=0)


def drawn(folder: Path, material: str, space: str, backend: str = "reference", **more: Any) -> np.ndarray:
    scene = maquette.load_text(SCENE.replace("MATERIAL", material), folder)
    return np.asarray(scene.render(working_space=space, backend=backend, threads=1, **more))[1, 1, :3]


def write_picture(path: Path, color: tuple[float, ...]) -> None:
    spec = oiio.ImageSpec(2, 2, 3, "float")
    out: Any = oiio.ImageOutput.create(str(path))
    out.open(str(path), spec)
    out.write_image(np.full((2, 2, 3), color, np.float32))
    out.close()


@pytest.mark.parametrize("space", SPACES)
@pytest.mark.parametrize(
    "material",
    [
        "lambert(rgb(0.8, 0.1, 0.3))", "lambert(checker(rgb(0.8, 0.1, 0.3), rgb(0.8, 0.1, 0.3)))",
        "lambert(pattern(|x, y, z| rgb(0.8, 0.1 + 0 * x, 0.3)))", 'lambert(image("a.exr"))',
        "principled(rgb(0.8, 0.1, 0.3), ior: 1.0000001, roughness: 1)",
    ],
)  # fmt: skip
def test_colours_of_surfaces(tmp_path: Path, material: str, space: str) -> None:
    write_picture(tmp_path / "a.exr", COLOR)
    assert drawn(tmp_path, material, space) == pytest.approx(product(space, COLOR, LIGHT), abs=2e-6)


@pytest.mark.parametrize("backend", ["ray", "raster"])
def test_other_backends(tmp_path: Path, backend: str) -> None:
    write_picture(tmp_path / "a.exr", COLOR)
    for material in ('lambert(image("a.exr"))', "lambert(pattern(|x, y, z| rgb(0.8, 0.1 + 0 * x, 0.3)))"):
        assert drawn(tmp_path, material, "acescg", backend) == pytest.approx(product("acescg", COLOR, LIGHT), abs=2e-6)


def test_greys_stay_and_numbers_are_not_converted(tmp_path: Path) -> None:
    write_picture(tmp_path / "a.exr", COLOR)
    for material in ("lambert(rgb(0.3, 0.3, 0.3))", "lambert(pattern(|x, y, z| 0.3 + 0 * x))"):
        assert drawn(tmp_path, material, "acescg") == pytest.approx(0.3 * np.array(LIGHT), abs=1e-6), material
    numbers = ", ".join(f'{name}: image("a.exr")' for name in ("roughness", "metallic", "opacity", "normal_map"))
    text = f'principled(image("a.exr"), {numbers})'
    scene = maquette.load_text(SCENE.replace("MATERIAL", text), tmp_path)
    plan = _plan(scene, "acescg")
    tables = working_space.scene_in(scene, plan)[0].tables
    row = int(tables.instances.material[0])
    textures = {slot: int(tables.materials.textures[row, slot]) for slot in ir.Slot}
    read = {slot: _first_texel(tables, texture) for slot, texture in textures.items() if texture >= 0}
    into = matrix("rec709", "acescg")
    assert read.pop(ir.Slot.DIFFUSE) == pytest.approx(into @ np.array(COLOR), abs=1e-6)
    assert len(read) == 4
    assert all(texel == pytest.approx(COLOR, abs=1e-7) for texel in read.values())


def _first_texel(tables: ir.Tables, texture: int) -> np.ndarray:
    return tables.images.texels[tables.images.first[tables.textures.image[texture]], :3]


def _plan(scene: ir.Scene, space: str) -> Plan:
    return planner.make_plan(scene, ir.Settings(working_space=space))


def test_each_slot_is_a_colour_or_a_number() -> None:
    """A new slot needs a line in ir.COLOR_SLOTS, or here."""
    numbers = {
        ir.Slot.SHININESS, ir.Slot.IOR, ir.Slot.OPACITY, ir.Slot.ROUGHNESS, ir.Slot.METALLIC, ir.Slot.COAT, ir.Slot.COAT_ROUGHNESS,
        ir.Slot.NORMAL, ir.Slot.COAT_NORMAL, ir.Slot.BUMP, ir.Slot.PRIORITY, ir.Slot.WEIGHT, ir.Slot.SHEEN_ROUGHNESS, ir.Slot.RADIUS,
        ir.Slot.BASE_WEIGHT, ir.Slot.DIFFUSE_ROUGHNESS, ir.Slot.SPECULAR_WEIGHT, ir.Slot.ANISOTROPY, ir.Slot.ROTATION, ir.Slot.COAT_IOR,
        ir.Slot.COAT_ANISOTROPY, ir.Slot.COAT_ROTATION, ir.Slot.COAT_DARKENING, ir.Slot.FUZZ, ir.Slot.FUZZ_ROUGHNESS, ir.Slot.FILM,
        ir.Slot.FILM_THICKNESS, ir.Slot.FILM_IOR, ir.Slot.TRANSMISSION_WEIGHT, ir.Slot.SUBSURFACE_WEIGHT, ir.Slot.THIN_WALLED,
        ir.Slot.DISPERSION, ir.Slot.SUBSURFACE_ANISOTROPY, ir.Slot.FLAKE_SIZE, ir.Slot.FLAKE_TILT, ir.Slot.FLAKE_COVERAGE,
        ir.Slot.FLAKE_SEED,
    }  # fmt: skip
    coefficients = {ir.Slot.ABSORPTION}
    assert set(ir.Slot) == ir.COLOR_SLOTS | numbers | coefficients
    assert not ir.COLOR_SLOTS & (numbers | coefficients)


@pytest.mark.parametrize("space", SPACES)
def test_backgrounds_and_emission(tmp_path: Path, space: str) -> None:
    """Colours that light meets once come back as they were."""
    text = "camera(position: [0, 0, 5])\nrender(size: [8, 8], samples: 1)\nsphere(1, material: emissive(rgb(0.8, 0.1, 0.3)))"
    scene = maquette.load_text(text, tmp_path)
    picture = np.asarray(scene.render(working_space=space, backend="reference", background=(0.1, 0.7, 0.2), threads=1))
    assert picture[0, 0, :3] == pytest.approx([0.1, 0.7, 0.2], abs=1e-6)
    assert picture[4, 4, :3] == pytest.approx(COLOR, abs=1e-6)


def test_media_keep_their_transmittance() -> None:
    """The colour that is left after a mean free path is the converted one; equal coefficients stay."""
    text = "fog(absorption: rgb(0.2, 1, 3), scattering: rgb(0.1, 0.4, 0.2))\nsphere(1, material: glass(inside: rgb(0.5, 0.5, 0.5)))"
    scene = maquette.load_text(text + "\nsky()\ncamera(position: [0, 0, 5])")
    tables = working_space.scene_in(scene, _plan(scene, "acescg"))[0].tables
    before, after = (t.media.absorption[0] + t.media.scattering[0] for t in (scene.tables, tables))
    into = matrix("rec709", "acescg")
    assert np.exp(-after / before.mean()) == pytest.approx(into @ np.exp(-before / before.mean()), rel=1e-12)
    assert tables.media.scattering[0] / after == pytest.approx(into @ (scene.tables.media.scattering[0] / before), rel=1e-12)
    row = tables.instances.material[0]
    assert (tables.materials.values[row, ir.Slot.ABSORPTION] == scene.tables.materials.values[row, ir.Slot.ABSORPTION]).all()


def test_colours_of_vertices(tmp_path: Path) -> None:
    ply = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {c}\n" for c in "xyz")
    ply += "".join(f"property uchar {c}\n" for c in ("red", "green", "blue"))
    ply += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "a.ply").write_text(ply + "-9 0 9 255 0 0\n9 0 9 255 0 0\n0 0 -9 255 0 0\n3 0 1 2\n", encoding="ascii")
    text = SCENE.replace("plane(material: MATERIAL)", 'mesh("a.ply", material: lambert(#fff))')
    picture = np.asarray(maquette.load_text(text, tmp_path).render(working_space="acescg", backend="reference"))
    assert picture[1, 1, :3] == pytest.approx(product("acescg", (1, 0, 0), LIGHT), abs=2e-6)


def test_files_have_the_working_space_and_are_read_back(tmp_path: Path) -> None:
    scene = maquette.load_text(SCENE.replace("MATERIAL", "lambert(rgb(0.8, 0.1, 0.3))"), tmp_path)
    image = scene.render(working_space="acescg", backend="reference", aov=("albedo", "normal"))
    image.save(tmp_path / "a.exr")
    source: Any = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    assert source.spec().getattribute("chromaticities") == pytest.approx(color_spaces.AP1)
    stored = source.read_image(0, 0, 0, 3, oiio.FLOAT)[1, 1]
    source.close()
    assert stored == pytest.approx(matrix("rec709", "acescg") @ np.asarray(image)[1, 1, :3], abs=1e-6)
    again = image_reader.read(tmp_path / "a.exr")
    for name in ("rgba", "albedo", "normal"):
        assert again.channels[name] == pytest.approx(image.channels[name], abs=2e-6)
    image.save(tmp_path / "a.png")
    plain = Image(4, 4, {"rgba": image.channels["rgba"]})
    plain.save(tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_an_exr_with_odd_chromaticities_is_read_as_rec709(tmp_path: Path) -> None:
    image = Image(2, 2, {"rgba": np.full((2, 2, 4), 0.5, np.float32)})
    image_files.write(image, tmp_path / "a.exr", image_files.Look(), {})
    buffer = oiio.ImageBuf(str(tmp_path / "a.exr"))
    buffer.specmod().attribute("chromaticities", oiio.TypeDesc("float[8]"), (0.0,) * 8)
    buffer.write(str(tmp_path / "odd.exr"))
    read = image_reader.read(tmp_path / "odd.exr")
    assert (read.channels["rgba"] == 0.5).all()
    assert [message for message, _ in read.metadata["faults"]] == [
        "the chromaticities of the picture are not of a colour space: its colours are read as Rec.709"
    ]


def test_a_scene_without_the_setting_is_the_same_object(tmp_path: Path) -> None:
    scene = maquette.load_text(SCENE.replace("MATERIAL", "lambert(#f00)"), tmp_path)
    plan = _plan(scene, "rec709")
    assert working_space.scene_in(scene, plan) == (scene, plan)


def test_colours_beyond_rec709_are_clipped_there_and_kept_in_wider_spaces(tmp_path: Path) -> None:
    """A pure green of ACEScg under white light."""
    write_picture(tmp_path / "a.exr", (0.0, 1.0, 0.0))
    text = SCENE.replace("MATERIAL", 'lambert(image("a.exr", space: "acescg"))').replace("rgb(1, 0.4, 0.1)", "#fff")
    scene = maquette.load_text(text, tmp_path)
    green = matrix("acescg", "rec709") @ np.array([0.0, 1.0, 0.0])
    assert min(green) < -0.1
    narrow, wide = (np.asarray(scene.render(working_space=s, backend="reference"))[1, 1, :3] for s in ("rec709", "acescg"))
    assert narrow == pytest.approx(np.maximum(green, 0.0), abs=1e-6)
    assert wide == pytest.approx(green, abs=1e-6)


def test_the_greatest_pattern(tmp_path: Path) -> None:
    body = " + ".join(f"noise({k + 1} * x, y, z)" for k in range(90))
    scene = maquette.load_text(SCENE.replace("MATERIAL", f"lambert(pattern(|x, y, z| rgb({body}, 0.1, 0.2)))"), tmp_path)
    tape = int(scene.tables.tapes.count.max())
    assert tape < 509
    if tape + 15 > 509:
        with pytest.raises(PlanError, match="with a working space at most 494 are drawn"):
            working_space.scene_in(scene, _plan(scene, "acescg"))
    else:
        assert int(working_space.scene_in(scene, _plan(scene, "acescg"))[0].tables.tapes.count.max()) <= tape + 15


@pytest.mark.long
def test_graphs_of_textures(tmp_path: Path) -> None:
    """A tape that looks a picture up gives Rec.709; the picture stays as it is, and its result is converted."""
    write_picture(tmp_path / "a.exr", COLOR)
    scene = maquette.load_text(SCENE.replace("MATERIAL", 'lambert(image("a.exr"))'), tmp_path)
    builder = GraphBuilder()
    tape = builder.finish(*builder.look_up(0, U, V)[:3])
    t, first = scene.tables, len(scene.tables.pools.code)
    tapes = {"first": [first], "count": [len(tape.code)], "first_constant": [len(t.pools.constants)], "constant_count": [1],
             "results": [[*tape.results, 0]], "result_count": [3]}  # fmt: skip
    pools = t.pools._replace(code=np.concatenate([t.pools.code, tape.code]), constants=np.append(t.pools.constants, tape.constants))
    columns = {name: np.concatenate([column, column]) for name, column in t.textures._asdict().items()}
    columns["kind"][1], columns["tape"][1], columns["image"][1] = ir.TextureKind.FORMULA, 0, -1
    slots = np.where(t.materials.textures >= 0, 1, -1).astype(np.int32)
    tables = t._replace(pools=pools, tapes=ir.table_of("tapes", tapes), textures=ir.table_of("textures", columns))
    graph = replace(scene, tables=tables._replace(materials=t.materials._replace(textures=slots)))
    assert validate.validate(graph)[1] is not None
    for backend in ("reference", "ray"):
        picture = np.asarray(maquette.render(graph, working_space="acescg", backend=backend, threads=1))
        assert picture[1, 1, :3] == pytest.approx(product("acescg", COLOR, LIGHT), abs=2e-6)
