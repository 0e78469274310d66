"""Options of stages: purposes, mask, session layer, lights, conform policy, render settings, frames and times."""

import math

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.importers.stage_options import StageOptions
from maquette.compiler.importers.usd import stage
from maquette.compiler.ir.single_sided import SINGLE_SIDED
from maquette.lang.diagnostics import SceneError
from maquette.render import camera
from maquette.render.types import View

from .stages import SQUARE, read

PURPOSES = "".join(f'def Cube "{p}" {{ uniform token purpose = "{p}" }}\n' for p in ("default", "render", "proxy", "guide"))
CAMERA = """def Camera "main_cam" { float horizontalAperture = 20
    float verticalAperture = 10
    float horizontalApertureOffset = 2
    float focalLength = 50 }
def Cube "c" {}
"""


@pytest.mark.parametrize(
    ("purposes", "expected"),
    [
        (None, ["/default", "/render"]),
        (("proxy",), ["/default", "/proxy"]),
        (("default",), ["/default"]),
        (("render", "proxy", "guide"), ["/default", "/render", "/proxy", "/guide"]),
    ],
)
def test_purposes(tmp_path, purposes, expected):
    assert list(read(tmp_path, PURPOSES, options=StageOptions(purposes=purposes))[0].names.instances) == expected


def test_what_a_purpose_hides_is_noted(tmp_path):
    _, messages = read(tmp_path, PURPOSES)
    assert messages == [
        "x.usda</proxy>: note: 1 prim of the purpose proxy is not drawn\n  --purposes default,render,proxy draws them too"
    ]


def test_visibility_by_purpose(tmp_path):
    text = """def Xform "a" (prepend apiSchemas = ["VisibilityAPI"]) { uniform token renderVisibility = "invisible"
        def Cube "r" { uniform token purpose = "render" }
        def Cube "d" {} }"""
    assert read(tmp_path, text)[0].names.instances == ("/a/d",)


def test_a_mask_reads_some_prims_and_what_they_use(tmp_path):
    text = """def Cube "a" (prepend apiSchemas = ["MaterialBindingAPI"]) { rel material:binding = </looks/m> }
    def Cube "b" {}
    def Scope "looks" { def Material "m" { token outputs:surface.connect = </looks/m/s.outputs:surface>
        def Shader "s" { uniform token info:id = "UsdPreviewSurface"
            token outputs:surface } } }"""
    scene, messages = read(tmp_path, text, options=StageOptions(mask=("/a",)))
    assert (scene.names.instances, scene.names.materials, messages) == (("/a",), ("m",), [])
    assert read(tmp_path, text, options=StageOptions(mask=("a b",)))[1] == [
        "x.usda: error: `a b` is not a path of a prim\n  write --mask /World/Chair"
    ]
    messages = read(tmp_path, text, options=StageOptions(mask=("/z", "/b")))[1]
    assert messages == ["x.usda: warning: the stage has no prim `/z`, which --mask names"]


def test_a_session_layer_goes_over_the_stage(tmp_path):
    layer = tmp_path / "over.usda"
    layer.write_text('#usda 1.0\nover "c" {\ndouble size = 6\n}\n')
    scene, _ = read(tmp_path, 'def Cube "c" {}', options=StageOptions(session_layer=layer))
    assert scene.tables.geometries.parameters[0, 0] == 3


def test_no_default_light(tmp_path):
    assert len(read(tmp_path, 'def Cube "c" {}')[0].tables.lights.kind) == 1
    scene, _ = read(tmp_path, 'def Cube "c" {}', options=StageOptions(default_light=False))
    assert (len(scene.tables.lights.kind), len(scene.tables.cameras.fit)) == (0, 1)


@pytest.mark.parametrize(
    ("conform", "size", "half"),  # half the width and height of the picture at distance 1; the film is 0.2 by 0.1
    [
        ("vertical", (400, 100), (0.4, 0.1)),
        ("horizontal", (400, 100), (0.2, 0.05)),
        ("expand", (400, 100), (0.4, 0.1)),
        ("crop", (400, 100), (0.2, 0.05)),
        ("expand", (100, 100), (0.2, 0.2)),
        ("crop", (100, 100), (0.1, 0.1)),
        (None, (200, 100), (0.2, 0.1)),
    ],
)
def test_conform(tmp_path, conform, size, half):
    scene, messages = read(tmp_path, CAMERA, options=StageOptions(conform=conform, size=size))
    c = scene.tables.cameras
    aspect = size[0] / size[1]
    wide = c.extent[0] if c.fit[0] == ir.Fit.HORIZONTAL else c.extent[0] * aspect
    assert (wide, wide / aspect) == pytest.approx(half)
    assert c.shift[0, 0] * 2 * wide == pytest.approx(2 / 50)  # the offset is in the film's unit, whatever the picture
    assert messages == []


@pytest.mark.parametrize(
    ("conform", "size", "pixel", "half"),
    [
        ("expandAperture", (200, 200), 2.0, (0.2, 0.1)),  # the picture is as wide as its pixels together
        ("adjustApertureHeight", (200, 100), 2.0, (0.2, 0.05)),
        ("adjustPixelAspectRatio", (100, 200), 3.0, (0.2, 0.1)),  # the policy replaces the aspect of the pixels
    ],
)
def test_pixels_that_are_not_square(tmp_path, conform, size, pixel, half):
    settings = f"""def RenderSettings "s" {{ uniform int2 resolution = {size}
        uniform float pixelAspectRatio = {pixel}
        uniform token aspectRatioConformPolicy = "{conform}" }}"""
    scene, messages = read(tmp_path, CAMERA + settings, 'renderSettingsPrimPath = "/s"')
    assert (np.array(camera.half_extent(scene.tables, View(0, *size))), messages) == (pytest.approx(half), [])


def test_a_pixel_aspect_that_is_no_number_counts_as_1(tmp_path):
    settings = """def RenderSettings "s" { uniform float pixelAspectRatio = -2 }"""
    scene, messages = read(tmp_path, CAMERA + settings, 'renderSettingsPrimPath = "/s"')
    assert scene.tables.cameras.pixel_aspect[0] == 1
    assert messages == ["x.usda</s>: warning: the pixelAspectRatio -2 counts as 1"]


def test_another_aspect_is_noted(tmp_path):
    assert read(tmp_path, CAMERA, options=StageOptions(size=(100, 100)))[1] == [
        "x.usda</main_cam>: note: the picture's aspect 1 is not the film's 2: the film's height is kept, its sides are cut off\n"
        "  --conform vertical, horizontal, expand, crop or pixels selects the part"
    ]


SETTINGS = """def Scope "Render" {
    def RenderSettings "s" { uniform int2 resolution = (100, 50)
        uniform token aspectRatioConformPolicy = "adjustApertureHeight"
        uniform token[] includedPurposes = ["default", "proxy"]
        uniform bool disableDepthOfField = 1
        rel camera = </cam>
        rel products = </Render/p> }
    def RenderProduct "p" { uniform int2 resolution = (200, 200)
        uniform float4 dataWindowNDC = (0, 0.5, 0.25, 1) } }
def Camera "cam" { float fStop = 2
    float focusDistance = 3 }
"""


def test_render_settings(tmp_path):
    text, header = SETTINGS + PURPOSES, 'renderSettingsPrimPath = "/Render/s"'
    scene, messages = read(tmp_path, text, header)
    asked = scene.settings
    assert (asked.size, asked.camera, asked.crop) == ((200, 200), "/cam", (0, 0, 50, 100))  # the product's values go first
    assert scene.names.instances == ("/default", "/proxy")
    c = scene.tables.cameras
    assert (scene.names.cameras, c.fit[0], c.lens[0]) == (("/cam",), ir.Fit.HORIZONTAL, 0)
    assert [m for m in messages if "purpose" not in m] == []
    scene, _ = read(tmp_path, text, header, options=StageOptions(size=(64, 32), purposes=("render",)))  # the command line precedes
    assert (scene.settings.size, scene.settings.crop, scene.names.instances) == ((64, 32), None, ("/default", "/render"))
    assert read(tmp_path, text)[0].settings == ir.Settings()  # no prim is named
    assert read(tmp_path, text, options=StageOptions(render_settings="/Render/p"))[0].settings.size == (200, 200)


def test_wrong_render_settings(tmp_path):
    assert read(tmp_path, SETTINGS, options=StageOptions(render_settings="/cam"))[1] == [
        "x.usda: error: `/cam` is not a RenderSettings or RenderProduct prim\n  the stage has /Render/s, /Render/p"
    ]
    scene, messages = read(tmp_path, 'def Cube "c" {}', 'renderSettingsPrimPath = "/none"')
    assert (len(scene.names.instances), messages) == (
        1, ["x.usda: warning: `/none` is not a RenderSettings or RenderProduct prim: the renderSettingsPrimPath of the stage has no effect"]
    )  # fmt: skip
    text = SETTINGS.replace("</cam>", "</gone>") + 'def Cube "c" {}'
    scene, messages = read(tmp_path, text, 'renderSettingsPrimPath = "/Render/s"')
    assert scene.settings.camera is None
    assert messages == ["x.usda: warning: the render settings name the camera `/gone`, which is not there"]


def test_exposure_of_a_camera(tmp_path):
    """UsdGeomCamera: 2^exposure · time · iso · responsivity / (100 · fStop²)."""
    text = 'def Camera "main_cam" { float exposure = 1\nfloat exposure:time = 0.5\nfloat exposure:iso = 400\nfloat exposure:fStop = 4 }'
    assert read(tmp_path, text)[0].tables.cameras.exposure[0] == pytest.approx(math.log2(2 * 0.5 * 400 / 100 / 16))
    assert np.isnan(read(tmp_path, 'def Camera "main_cam" {}')[0].tables.cameras.exposure[0])


HELD = """#usda 1.0
(
    startTimeCode = 1
    endTimeCode = 3
    timeCodesPerSecond = 24
)
def Cube "c"
{
    token visibility.timeSamples = { 1: "invisible", 2: "inherited" }
}
"""


def test_a_time_in_seconds_does_not_fall_beside_a_held_sample(tmp_path):
    path = tmp_path / "held.usda"
    path.write_text(HELD)
    assert len(load.load(path, time=0.0416).names.instances) == 1  # 1 + 0.9984 time codes
    assert len(load.load(path, time=0.04).names.instances) == 0
    assert stage.time_codes(path) == (1, 3)


def test_options_of_stages_are_refused_elsewhere(tmp_path):
    (tmp_path / "a.scene").write_text("sphere(1)\n")
    with pytest.raises(SceneError) as caught:
        load.load(tmp_path / "a.scene", stage=StageOptions(complexity=2, default_light=False))
    assert [(d.message, d.hint) for d in caught.value.diagnostics] == [
        ("only USD stages have complexity", "leave out --complexity"),
        ("only USD stages have no default light", "leave out --no-default-light"),
    ]
    words = StageOptions(variants={"/a:b": "c"}, purposes=("render", "proxy"), complexity=2, default_light=False).words()
    assert " ".join(words) == "--variant /a:b=c --purposes render,proxy --complexity high --no-default-light"


def test_an_asset_is_seen_from_three_quarters_and_sharp(tmp_path):
    scene, messages = read(tmp_path, 'def Cube "c" {}', options=StageOptions(as_asset=True, size=(64, 64)))
    assert messages == []
    assert (scene.names.cameras, scene.names.lights) == (("default",), ("sun", "sky"))
    more = "float fStop = 2\nfloat focusDistance = 4\ndouble shutter:close = 1"
    camera = CAMERA.replace("float focalLength = 50", f"float focalLength = 50\n{more}")
    scene, _ = read(tmp_path, camera, options=StageOptions(as_asset=True))
    c = scene.tables.cameras
    assert (scene.names.cameras, c.lens[0], c.shutter[0], scene.names.lights) == (("/main_cam",), 0, 0, ("sun", "sky"))


@pytest.mark.parametrize(
    ("more", "culled"), [("", True), ("uniform bool doubleSided = true", False), ("uniform bool doubleSided = false", True)]
)
def test_meshes_that_are_not_double_sided(tmp_path, more, culled):
    text = f'def Mesh "m" {{ {SQUARE}\n{more} }}\ndef Cube "c" {{}}'
    for options, expected in ((StageOptions(), [7, 7]), (StageOptions(cull_backfaces=True), [7 | SINGLE_SIDED if culled else 7, 7])):
        scene, messages = read(tmp_path, text, options=options)
        assert messages == []
        assert scene.tables.instances.visible.tolist() == expected
    assert StageOptions(cull_backfaces=True).words() == ["--cull-backfaces"]
