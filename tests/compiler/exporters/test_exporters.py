"""What convert writes for Mitsuba and POV-Ray: whole small files, meshes and pictures, and all that is said not to be carried."""

from __future__ import annotations

import re
from pathlib import Path
from xml.etree import ElementTree

import maquette
import numpy as np
import pytest
from click.testing import CliRunner
from maquette.cli.main import cli
from maquette.compiler.exporters import export
from maquette.compiler.exporters.mitsuba import lights, materials, shapes
from maquette.compiler.exporters.mitsuba import scene as mitsuba_scene
from maquette.compiler.exporters.povray import scene as povray_scene
from maquette.compiler.exporters.povray import shapes as povray_shapes
from maquette.compiler.mesh import shells
from maquette.materials import metal
from maquette.materials.optics import metals
from maquette.measure.peers import registry
from maquette.render.tessellation import scene_meshes

from ...measure.peers import peer_scenes as scenes

SMALL = """render(size: [8, 4])
camera(position: [0, 1, 4], look_at: [0, 1, 0], fov: 90deg)
plane(y: 0, material: lambert(checker(rgb(0.5, 0.5, 0.5), rgb(0.25, 0, 0), size: 2)))
sphere(1, center: [0, 1, 0], material: mirror(rgb(0.5, 0.75, 1)))
point(position: [0, 4, 0], intensity: 2)
"""
MITSUBA = """<scene version="3.0.0">
    <integrator type="path">
        <integer name="max_depth" value="4"/>
        <integer name="rr_depth" value="1048576"/>
    </integrator>
    <sensor type="perspective">
        <float name="fov" value="126.869897646"/>
        <string name="fov_axis" value="x"/>
        <float name="principal_point_offset_x" value="0"/>
        <float name="principal_point_offset_y" value="0"/>
        <float name="near_clip" value="0.0001"/>
        <float name="far_clip" value="10000000"/>
        <transform name="to_world">
            <matrix value="-1 0 0 0 0 1 0 1 0 0 -1 4 0 0 0 1"/>
        </transform>
        <film type="hdrfilm">
            <integer name="width" value="8"/>
            <integer name="height" value="4"/>
            <string name="pixel_format" value="rgb"/>
            <string name="component_format" value="float32"/>
            <string name="file_format" value="openexr"/>
            <rfilter type="box"/>
        </film>
        <sampler type="multijitter">
            <integer name="sample_count" value="16"/>
            <integer name="seed" value="0"/>
        </sampler>
    </sensor>
    <bsdf type="twosided" id="material0">
        <bsdf type="diffuse">
            <texture type="checkerboard" name="reflectance">
                <rgb name="color0" value="0.5, 0.5, 0.5"/>
                <rgb name="color1" value="0.25, 0, 0"/>
            </texture>
        </bsdf>
    </bsdf>
    <bsdf type="twosided" id="material1">
        <bsdf type="conductor">
            <string name="material" value="none"/>
            <rgb name="specular_reflectance" value="0.5, 0.75, 1"/>
        </bsdf>
    </bsdf>
    <shape type="ply">
        <string name="filename" value="small.0.ply"/>
        <boolean name="face_normals" value="false"/>
        <transform name="to_world">
            <matrix value="1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"/>
        </transform>
        <ref id="material0"/>
    </shape>
    <shape type="sphere">
        <float name="radius" value="1"/>
        <point name="center" x="0" y="1" z="0"/>
        <ref id="material1"/>
    </shape>
    <emitter type="point">
        <point name="position" x="0" y="4" z="0"/>
        <rgb name="intensity" value="2, 2, 2"/>
    </emitter>
</scene>
"""
POVRAY = """#version 3.7;
global_settings { assumed_gamma 1.0 max_trace_level 3 adc_bailout 0.0001 ambient_light rgb 1 }
camera { perspective location <0, 1, 4> direction <0, 0, -1> right <4, 0, 0> up <0, 2, 0> }
background { rgb <0, 0, 0> }
light_source { <0, 4, 0> rgb <31830988.6184, 31830988.6184, 31830988.6184> fade_power 2 fade_distance 0.0001 }
plane {
  <0, 1, 0>, 0
  texture {
    pigment { checker rgb <0.5, 0.5, 0.5>, rgb <0.25, 0, 0> matrix <2, 0, 0, 0, 0, -2, 0, 1, 0, 0, -0.5, 0> }
    finish { diffuse 1 ambient rgb <0, 0, 0> }
  }
  matrix <1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0>
}
sphere {
  0, 1
  texture {
    pigment { rgb <0, 0, 0> }
    finish { diffuse 0 ambient rgb <0, 0, 0> reflection { rgb <0.5, 0.75, 1> } }
  }
  matrix <1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 0>
}
"""
WRITERS = {"mitsuba": mitsuba_scene.write, "povray": povray_scene.write}


def written(name: str, folder: Path, text: str, **settings: object) -> export.Export:
    scene, plan = scenes.compiled(folder, text, **settings)
    return WRITERS[name](scene, plan, "small", scene_meshes.make_tessellator(scene, plan))


@pytest.mark.parametrize(("name", "whole"), [("mitsuba", MITSUBA), ("povray", POVRAY)])
def test_a_small_scene_is_written_whole(name: str, whole: str, tmp_path: Path) -> None:
    assert written(name, tmp_path, SMALL, samples=16, bounces=2).text == whole


def test_a_plane_is_a_wide_square_with_cells_for_coordinates(tmp_path: Path) -> None:
    made = written("mitsuba", tmp_path, SMALL, samples=16, bounces=2)
    header, _, body = made.files["small.0.ply"].partition(b"end_header\n")
    assert header.decode().split("\n")[:3] == ["ply", "format binary_little_endian 1.0", "element vertex 600"]
    vertices = np.frombuffer(body[: 600 * 8 * 4], "<f4").reshape(600, 8)
    assert np.abs(vertices[:, 0]).max() > 1e5
    np.testing.assert_allclose(vertices[:, 6:], np.stack([vertices[:, 0], -vertices[:, 2]], axis=1) / 4, rtol=1e-6)  # two cells of 2 m


def test_meshes_keep_their_corners(tmp_path: Path) -> None:
    shell = shells.Shell(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]], np.int32))
    data = shapes.ply(shell)
    assert data.startswith(
        b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    )
    assert data.endswith(b"\x03" + np.array([0, 1, 2], "<i4").tobytes())
    turned = shells.flip(shell)
    assert turned.triangles.tolist() == [[2, 1, 0]]


def test_pictures_keep_their_rows() -> None:
    pixels = np.arange(12, dtype=np.float32).reshape(2, 2, 3)
    assert materials.pfm(pixels) == b"PF\n2 2\n-1.0\n" + pixels[::-1].tobytes()


def test_a_dome_is_the_same_between_its_rows() -> None:
    pixels = np.array([1.0, 3.0, 7.0])[:, None, None] * np.ones((3, 4, 3))
    assert lights.envmap_rows(pixels)[:, 0, 0].tolist() == [1, 1, 2, 3, 5, 7, 7]


def test_a_pattern_lies_where_its_matrix_says() -> None:
    frame = np.array([[2.0, 0.5, 0.1], [-0.3, 1.0, 0.7], [0, 0, 1]])
    text = povray_shapes.pattern_matrix(frame)
    back = np.array([float(v) for v in text.removeprefix("matrix <").removesuffix(">").split(",")]).reshape(4, 3)
    x, z = 1.3, -0.4
    s, t = (frame @ [x, -z, 1.0])[:2]
    np.testing.assert_allclose(np.array([s, t, 0.5]) @ back[:3] + back[3], [x, 0.0, z], atol=1e-12)


@pytest.mark.parametrize(
    ("name", "line", "said"),
    [
        ("mitsuba", "sphere(1, material: phong(#808080))", "3:21: a Phong highlight is carried as one of microfacets of the same width"),
        (
            "mitsuba", 'sphere(1, material: phong(#808080, specular: 0, shading: "gouraud"))',
            "3:21: light at vertices (gouraud) is not carried: it is computed at every point",
        ),
        ("mitsuba", "ambient(#808080)", "3:1: ambient light is not carried: Mitsuba has none"),
        ("mitsuba", "point(position: [0, 2, 0], falloff: [1, 0, 1])", "3:1: a fall-off other than 1/d² is not carried"),
        *(
            (name, "point(position: [0, 2, 0], receivers: [])\nsphere(1)\nsun()",
             "3:1: `receivers` and `blockers` are not carried: the light lights every object, and each casts shadows")
            for name in ("mitsuba", "povray")
        ),
        ("mitsuba", "point(position: [0, 2, 0], shadows: false)\nsun()", "3:1: a light without shadows is not carried"),
        (
            "mitsuba", "sphere(1, material: mirror())\nsun(angle: 1deg)",
            "4:1: a sun's disk is seen in mirrors and glass in Mitsuba, and not here",
        ),
        ("mitsuba", "quadric([1, -1, 1, 0, 0, 0, 0, 0, 0, -0.2])", "3:1: an endless quadric is not carried"),
        (
            "mitsuba", 'sphere(1, material: lambert(checker(mapping: "projected")))',
            "3:29: the mapping projected is not carried: Mitsuba takes a surface's own coordinates",
        ),
        (
            "mitsuba", "sphere(1, material: glass())\npoint(position: [0, 0.1, 0])",
            "4:1: a light or a camera inside glass is not carried: Mitsuba scales its light by the index",
        ),
        ("povray", "sun(angle: 1deg)", "3:1: a sun's size is not carried: POV-Ray draws lights without extent"),
        ("povray", "sphere(1)\nsky()", "4:1: a sky lights nothing in POV-Ray: it draws lights without extent"),
        (
            "povray", "sphere(1, material: phong(#808080, specular: #ff0000))",
            "3:21: a highlight's colour is not carried",
        ),
        ("povray", "sphere(1, material: phong(#808080, normalized: true))", "3:21: a normalized highlight is not carried"),
        ("povray", 'sphere(1, material: metal("gold"))', "3:21: microfacets are not carried"),
        ("mitsuba", 'sphere(1, material: metal("gold", roughness: 0.5))',
            "3:21: light that bounces between facets is not carried: rough surfaces are darker"),
        ("povray", "sphere(1, material: phong(#808080, transmission: 0.5))", "3:21: k_t is not carried"),
    ],
)  # fmt: skip
def test_what_is_not_carried_is_said_with_its_place(name: str, line: str, said: str, tmp_path: Path) -> None:
    text = f"render(size: [8, 4])\ncamera(position: [0, 1, 4], look_at: [0, 1, 0])\n{line}\n"
    (peer,) = registry.find([name])
    assert f"{tmp_path / 'scene.scene'}:{said}" in peer.unsupported(*scenes.compiled(tmp_path, text))


def test_metals_keep_what_they_reflect_along_the_normal_and_at_grazing_angles() -> None:
    """Indices for Mitsuba's conductor, from the two reflectances of a row: the measured metals' own come out again, nearly."""
    for name in ("gold", "copper", "titanium"):
        f0, edge = (np.array(c) for c in metals.reflectance(name))
        n, k = metal.indices_of(f0, edge)
        assert metals.conductor(n, k, 1.0) == pytest.approx(np.minimum(f0, 0.9999), abs=1e-9)
        schlick = (f0 + (1 - f0) * (1 - metals.LOWEST) ** 5) * edge
        assert metals.conductor(n, k, metals.LOWEST) == pytest.approx(schlick, abs=0.02)


def test_microfacets_and_blends_are_written(tmp_path: Path) -> None:
    text = 'sphere(1, material: blend(metal("gold", roughness: 0.2), glass(roughness: 0.1), 0.25))'
    found = written("mitsuba", tmp_path, SMALL.replace("mirror(rgb(0.5, 0.75, 1))", text.split("material: ", 1)[1][:-1]))
    for part in ('<bsdf type="blendbsdf"', '<float name="weight" value="0.25"/>', "roughconductor", "roughdielectric", 'value="0.04"'):
        assert part in found.text, part


def test_what_the_plan_asks_is_said(tmp_path: Path) -> None:
    text = scenes.VIEW + scenes.FLOOR + scenes.MIRROR + scenes.LAMP
    (mitsuba, povray) = registry.find(["mitsuba", "povray"])
    place = tmp_path / "scene.scene"
    assert mitsuba.unsupported(*scenes.compiled(tmp_path, text, filter="gaussian")) == [
        "the filter gaussian is not carried: Mitsuba cuts its gaussian at four deviations, not three",
        f"{place}:3:23: rays go on at mirrors and glass only: Mitsuba's paths go on at matt surfaces too",
    ]
    assert mitsuba.unsupported(*scenes.compiled(tmp_path, text, bounces=0)) == [
        f"{place}:4:44: mirrors and glass are black without bounces here, and not in Mitsuba"
    ]
    assert povray.unsupported(*scenes.compiled(tmp_path, text, bounces=2)) == [
        f"{place}:3:23: matt surfaces light each other here, and not in POV-Ray"
    ]


def test_an_unknown_peer_is_refused() -> None:
    with pytest.raises(ValueError, match=r"no peer is called `mitsuva`; there are mitsuba, povray\. did you mean `mitsuba`\?"):
        registry.find(["povray", "mitsuva"])


def test_a_peer_that_is_not_there_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert registry.find(["povray"])[0].missing == "POV-Ray is not installed: apt install povray"
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert registry.find(["mitsuba"])[0].missing == "Mitsuba is not installed: pip install mitsuba"


@pytest.mark.parametrize(("name", "files"), [("out.xml", {"out.xml", "out.0.ply"}), ("out.pov", {"out.pov"}), ("out.npz", {"out.npz"})])
def test_convert_writes_its_files(name: str, files: set[str], tmp_path: Path) -> None:
    (tmp_path / "small.scene").write_text(SMALL)
    (tmp_path / "made").mkdir()
    plan = [] if name == "out.npz" else ["--plan", "filter=box", "--bounces", "2"]
    done = CliRunner().invoke(cli, ["convert", str(tmp_path / "small.scene"), str(tmp_path / "made" / name), *plan])
    assert done.exit_code == 0, done.stderr
    assert {path.name for path in (tmp_path / "made").iterdir()} == files
    if name == "out.npz":
        assert maquette.load(tmp_path / "made" / name).names.instances == maquette.load(tmp_path / "small.scene").names.instances


def test_convert_says_what_it_leaves_out(tmp_path: Path) -> None:
    (tmp_path / "ball.scene").write_text("sphere(1, material: phong(#808080))\npoint(position: [0, 3, 0])\n")
    done = CliRunner().invoke(cli, ["convert", str(tmp_path / "ball.scene"), str(tmp_path / "ball.xml"), "--plan", "filter=box"])
    assert done.exit_code == 0
    assert "ball.scene:1:21: warning: a Phong highlight is carried as one of microfacets of the same width" in done.stderr
    assert "specular: 0, or lambert(…)" in done.stderr


@pytest.mark.parametrize(("model", "factor"), [("phong", 4.0), ("blinn_phong", 1.0)])
def test_mitsuba_has_the_highlight_of_gltf(model: str, factor: float, tmp_path: Path) -> None:
    """A rough plastic, whose α is the square of glTF's roughness: √(2 / (n + 2)) for half vectors."""
    text = f"sphere(1, material: {model}(#808080, specular: 0.4, shininess: 60))\npoint(position: [0, 3, 0])\n"
    (tmp_path / "ball.scene").write_text(text)
    for name in ("ball.xml", "ball.glb"):
        assert CliRunner().invoke(cli, ["convert", str(tmp_path / "ball.scene"), str(tmp_path / name)]).exit_code == 0
    plastic = ElementTree.parse(tmp_path / "ball.xml").find(".//bsdf[@type='roughplastic']")
    assert plastic is not None
    width = float(plastic.find("float[@name='alpha']").get("value"))  # type: ignore[union-attr, arg-type]
    assert width == pytest.approx((2.0 / (60.0 * factor + 2.0)) ** 0.5)
    roughness = float(re.search(rb'"roughnessFactor": ?([\d.]+)', (tmp_path / "ball.glb").read_bytes())[1])  # type: ignore[index]
    assert width == pytest.approx(roughness**2, rel=1e-5)


@pytest.mark.parametrize(
    ("texture", "alpha", "loss"),
    [
        ("checker(rgb(1, 1, 1), rgb(0, 0, 0))", 0.25, "a texture of roughness is carried as its mean"),
        ("stripes(rgb(1, 1, 1), rgb(0.2, 0, 0))", 0.36, "a texture of roughness is carried as its mean"),
        ("pattern(|x, y, z| 0.5 + 0.4 * sin(9 * x))", 1.0, "warning: a pattern"),
    ],
)
def test_a_roughness_that_varies_is_carried_to_mitsuba_as_its_mean(texture: str, alpha: float, loss: str, tmp_path: Path) -> None:
    (tmp_path / "ball.scene").write_text(f'sphere(1, material: metal("gold", roughness: {texture}))\npoint(position: [0, 3, 0])\n')
    result = CliRunner().invoke(cli, ["convert", str(tmp_path / "ball.scene"), str(tmp_path / "ball.xml")])
    assert result.exit_code == 0, result.stderr
    assert loss in result.stderr
    width = ElementTree.parse(tmp_path / "ball.xml").find(".//bsdf[@type='roughconductor']/float[@name='alpha']")
    assert width is not None
    assert float(width.get("value", "nan")) == pytest.approx(alpha)


def test_a_shining_ball_alone_has_as_many_triangles_as_another(tmp_path: Path) -> None:
    sizes = []
    for material in ("lambert()", "emissive()"):
        (tmp_path / "ball.scene").write_text(f"sphere(1, material: {material})\nplane(y: -1)\n")
        assert CliRunner().invoke(cli, ["convert", str(tmp_path / "ball.scene"), str(tmp_path / "ball.glb")]).exit_code == 0
        sizes.append((tmp_path / "ball.glb").stat().st_size)
    assert sizes[1] < 1.1 * sizes[0]


def test_a_saved_ir_takes_no_picture_options(tmp_path: Path) -> None:
    (tmp_path / "ball.scene").write_text("sphere(1)\n")
    done = CliRunner().invoke(cli, ["convert", str(tmp_path / "ball.scene"), str(tmp_path / "ball.npz"), "--size", "10x10"])
    assert done.exit_code == 2
    assert "give options of the picture to `maquette render OUT.npz`" in done.stderr


@pytest.mark.parametrize("ending", ["glb", "usda", "xml", "pov"])
def test_a_quadratic_fall_off_is_one_by_the_square(ending: str, tmp_path: Path) -> None:
    """1/(2 d²) is half the light at 1/d²; every format has that."""
    (tmp_path / "a.scene").write_text("sphere(1)\npoint(position: [0, 3, 0], intensity: 8, falloff: [0, 0, 2])\n")
    (tmp_path / "b.scene").write_text("sphere(1)\npoint(position: [0, 3, 0], intensity: 4)\n")
    said = [CliRunner().invoke(cli, ["convert", str(tmp_path / f"{k}.scene"), str(tmp_path / f"{k}.{ending}")]).stderr for k in "ab"]
    assert "fall-off" not in said[0]
    first, other = ((tmp_path / f"{k}.{ending}").read_bytes().replace(b"a.", b"").replace(b"b.", b"") for k in "ab")
    assert first == other


def test_gltf_tells_of_a_fall_off_that_it_lacks(tmp_path: Path) -> None:
    (tmp_path / "a.scene").write_text("sphere(1)\npoint(position: [0, 3, 0], falloff: [1, 0, 0])\n")
    said = CliRunner().invoke(cli, ["convert", str(tmp_path / "a.scene"), str(tmp_path / "a.glb")]).stderr
    assert "a.scene:2:1: warning: a fall-off other than 1/d² is not carried\n" in said


@pytest.mark.parametrize("options", ["", ', shape: "disk"', ", look_at: [2, 0, 1]", ', look_at: [2, 5, 1], shape: "disk"'])
def test_area_lights_of_usd_shine_where_ours_do(options: str, tmp_path: Path) -> None:
    """The exporter turned plates the wrong way once: lamps under a ceiling lit the ceiling."""
    (tmp_path / "a.scene").write_text(f"sphere(1)\narea([1, 3, 0.5]{options})\n")
    CliRunner().invoke(cli, ["convert", str(tmp_path / "a.scene"), str(tmp_path / "a.usda")], catch_exceptions=False)
    frames = []
    for ending in ("scene", "usda"):
        tables = maquette.load(tmp_path / f"a.{ending}").tables
        frames.append(tables.transforms.matrix[tables.lights.transform[0]])
    assert np.allclose(frames[1][:, 1:], frames[0][:, 1:], atol=1e-6)  # +y, towards which it emits, +z, and the position
