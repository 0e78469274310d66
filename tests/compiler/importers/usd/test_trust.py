"""Stages read what a scene may read: layers, value clips, pictures and profiles elsewhere need --allow."""

from __future__ import annotations

import os
import zipfile
from pathlib import Path

import pytest
from maquette.compiler import load
from maquette.compiler.importers.stage_options import StageOptions
from maquette.compiler.importers.usd import stage as usd_stage
from maquette.lang.diagnostics import Diagnostics, SceneError, render_text

BALL = '#usda 1.0\n(\n    defaultPrim = "Ball"\n)\ndef Sphere "Ball"\n{\n    double radius = 1\n}\n'
USES = '#usda 1.0\ndef "Far" (\n    references = @../elsewhere/ball.usda@\n)\n{\n}\n'
PAINTED = """#usda 1.0
def Sphere "Ball" (prepend apiSchemas = ["MaterialBindingAPI"])
{
    rel material:binding = </Paint>
}
def Material "Paint"
{
    token outputs:surface.connect = </Paint/Surface.outputs:surface>
    def Shader "Surface"
    {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor.connect = </Paint/Picture.outputs:rgb>
        token outputs:surface
    }
    def Shader "Picture"
    {
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @../elsewhere/paint.png@
        float3 outputs:rgb
    }
}
"""


@pytest.fixture
def home(tmp_path: Path) -> Path:
    for folder in ("home", "elsewhere"):
        (tmp_path / folder).mkdir()
    (tmp_path / "elsewhere" / "ball.usda").write_text(BALL)
    (tmp_path / "elsewhere" / "paint.png").write_bytes(b"not read")
    (tmp_path / "home" / "uses.usda").write_text(USES)
    (tmp_path / "home" / "painted.usda").write_text(PAINTED)
    (tmp_path / "home" / "layers.scene").write_text('usd("uses.usda")\n')
    (tmp_path / "home" / "pictures.scene").write_text('usd("painted.usda")\n')
    return tmp_path / "home"


def test_layers_elsewhere_are_refused(home: Path) -> None:
    with pytest.raises(SceneError) as caught:
        load.load(home / "layers.scene")
    errors = [d for d in caught.value.diagnostics if d.severity == "error"]
    assert [d.message for d in errors] == ["`uses.usda` reads outside: `../elsewhere/ball.usda` lies outside of the scene's folder"]
    assert errors[0].hint == f"use --allow {home.parent / 'elsewhere'} to let scenes read it"


def test_allowed_layers_are_read(home: Path) -> None:
    scene = load.load(home / "layers.scene", allow=(home.parent / "elsewhere",))
    assert len(scene.tables.instances.geometry) == 1


def test_pictures_elsewhere_are_not_read(home: Path) -> None:
    said = Diagnostics()
    scene = load.load(home / "pictures.scene", diagnostics=said)
    assert len(scene.tables.images.first) == 0
    expected = "the picture `../elsewhere/paint.png` lies outside of the scene's folder: its fallback is drawn"
    assert [d.message for d in said.items] == [expected]


CLIPS = """def Sphere "Far" (
    clips = {
        dictionary default = {
            asset[] assetPaths = [@%s@]
            asset manifestAssetPath = @%s@
            string primPath = "/Ball"
            double2[] active = [(0, 0)]
            double2[] times = [(0, 0)]
        }
    }
)"""
TEMPLATE = """def Sphere "Far" (
    clips = {
        dictionary default = {
            string templateAssetPath = "%s"
            double templateStartTime = 1
            double templateEndTime = 2
            double templateStride = 1
            string primPath = "/Ball"
        }
    }
)"""
FAR = "lies outside of the scene's folder: it is left out"
LINK = "is a link that leads outside of the scene's folder: it is left out"


def said(path: Path, **more: object) -> tuple[int, list[str]]:
    """The number of shapes of a stage, and the warnings."""
    found = Diagnostics()
    scene = load.load(path, diagnostics=found, **more)  # pyright: ignore[reportArgumentType]
    text = [render_text(d, lambda file: None).replace(f"{path.parent}/", "").partition(" --allow")[0] for d in found.items]
    return len(scene.tables.instances.geometry), [line for line in text if ": warning: " in line]


def arcs(asset: str) -> dict[str, str]:
    """Statements of a stage with an asset, in each way that a layer refers to another."""
    return {
        "reference": f'def "Far" (references = @{asset}@)',
        "one of two references": f'def "Far" (references = [@{asset}@, @near.usda@])',
        "payload": f'def "Far" (payload = @{asset}@)',
        "in a class": f'class "C"\n{{\n    over "Far" (references = @{asset}@)\n    {{\n    }}\n}}\ndef "D" (inherits = </C>)',
        "in a variant": (
            'def "Far" (\n    variants = {\n        string v = "a"\n    }\n    prepend variantSets = "v"\n)\n{\n    variantSet "v" = {\n'
            f'        "a" (references = @{asset}@) {{\n        }}\n    }}\n}}\ndef "Other"'
        ),
        "clips": CLIPS % (asset, asset),
    }


@pytest.mark.parametrize("way", arcs(""))
@pytest.mark.parametrize("asset", ["../elsewhere/ball.usda", "{folder}/elsewhere/ball.usda", "./link.usda", "./links/ball.usda"])
def test_a_stage_reads_its_own_folder(home: Path, way: str, asset: str) -> None:
    """The rest is drawn."""
    (home / "link.usda").symlink_to("../elsewhere/ball.usda")
    (home / "links").symlink_to("../elsewhere")
    (home / "near.usda").write_text(BALL)
    asset = asset.format(folder=home.parent)
    (home / "x.usda").write_text(f'#usda 1.0\n{arcs(asset)[way]}\n{{\n}}\ndef Cube "Own"\n{{\n}}\n')
    count, warnings = said(home / "x.usda")
    assert count == 1 + (way in ("clips", "one of two references"))
    assert len(warnings) == 1
    assert f"`{asset}` {LINK if 'link' in asset else FAR}\n  use" in warnings[0]
    assert said(home / "x.usda", allow=[home.parent / "elsewhere"]) == (2, [])


@pytest.mark.parametrize("asset", ["../elsewhere/c.#.usda", "./c.#.usda", "./links/c.#.usda"])
def test_templates_of_clips(home: Path, asset: str) -> None:
    (home / "links").symlink_to("../elsewhere")
    for number in (1, 2):
        (home.parent / "elsewhere" / f"c.{number}.usda").write_text(BALL)
        (home / f"c.{number}.usda").symlink_to(f"../elsewhere/c.{number}.usda")
    (home / "x.usda").write_text(f"#usda 1.0\n{TEMPLATE % asset}\n{{\n}}\n")
    count, warnings = said(home / "x.usda")
    assert count == 1
    assert warnings == [f"x.usda</Far>: warning: `{asset}` {FAR if '..' in asset else LINK}\n  use"]


def test_sublayers_and_layers_below_them(home: Path) -> None:
    (home / "below.usda").write_text(USES)
    (home / "x.usda").write_text("#usda 1.0\n(\n    subLayers = [@../elsewhere/ball.usda@, @below.usda@]\n)\n")
    count, warnings = said(home / "x.usda")
    assert count == 0
    assert f"x.usda: warning: `../elsewhere/ball.usda` {FAR}\n  use" in warnings
    assert f"below.usda</Far>: warning: `../elsewhere/ball.usda` {FAR}\n  use" in warnings


def test_many_prims_are_one_warning(home: Path) -> None:
    prims = "".join(f'def "P{k}" (references = @../elsewhere/ball.usda@)\n{{\n}}\n' for k in range(3))
    (home / "x.usda").write_text(f"#usda 1.0\n{prims}")
    assert said(home / "x.usda")[1][0] == f"x.usda</P0>: warning: `../elsewhere/ball.usda` {FAR}, here and at 2 other prims\n  use"


def test_expressions_are_followed(home: Path) -> None:
    """Variables of the root layer are stronger than those of the layers below."""
    (home / "below.usda").write_text(
        '#usda 1.0\n(\n    defaultPrim = "B"\n    expressionVariables = {\n        string W = "home"\n    }\n)\n'
        'def "B" (references = @`"../${W}/ball.usda"`@)\n{\n}\n'
    )
    (home / "x.usda").write_text(
        '#usda 1.0\n(\n    expressionVariables = {\n        string W = "elsewhere"\n    }\n)\ndef "Far" (references = @below.usda@)\n{\n}\n'
    )
    count, warnings = said(home / "x.usda")
    assert count == 0
    assert warnings[0] == f'below.usda</B>: warning: `"../${{W}}/ball.usda"` {FAR}\n  use'


def test_the_current_folder_is_no_search_path(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """usd-core looks there first. What lies beside the root layer is drawn instead."""
    monkeypatch.chdir(home.parent / "elsewhere")
    (home / "sub").mkdir()
    (home / "sub" / "below.usda").write_text('#usda 1.0\n(\n    defaultPrim = "B"\n)\ndef "B" (references = @ball.usda@)\n{\n}\n')
    (home / "x.usda").write_text('#usda 1.0\ndef "Far" (references = @./sub/below.usda@)\n{\n}\n')
    count, warnings = said(home / "x.usda")
    assert (count, warnings[0]) == (0, f"below.usda</B>: warning: `ball.usda` {FAR}\n  use")
    (home / "ball.usda").write_text(BALL)
    assert said(home / "x.usda") == (1, [])


def test_layers_in_packages(home: Path) -> None:
    text = f'#usda 1.0\ndef "A" (references = @{home.parent}/elsewhere/ball.usda@)\n{{\n}}\ndef Cube "C"\n{{\n}}\n'
    with zipfile.ZipFile(home / "x.usdz", "w", zipfile.ZIP_STORED) as file:
        file.writestr("a.usda", text)
    count, warnings = said(home / "x.usdz")
    assert (count, warnings) == (1, [f"x.usdz</A>: warning: `{home.parent}/elsewhere/ball.usda` {FAR}\n  use"])


def test_a_folder_whose_name_looks_like_a_package(home: Path) -> None:
    folder = home / "set[1]"
    folder.mkdir()
    (folder / "ball.usda").write_text(BALL)
    (folder / "x.usda").write_text(USES.replace("../elsewhere/", ""))
    assert said(folder / "x.usda") == (1, [])


def test_other_variants_stay_inside(home: Path) -> None:
    (home / "below.usda").write_text('#usda 1.0\n(\n    defaultPrim = "Far"\n)\n' + USES.removeprefix("#usda 1.0\n"))
    (home / "x.usda").write_text(
        '#usda 1.0\ndef "V" (\n    variants = {\n        string v = "a"\n    }\n    prepend variantSets = "v"\n)\n{\n'
        '    variantSet "v" = {\n        "a" {\n        }\n        "b" (references = @below.usda@) {\n        }\n    }\n}\n'
    )
    count, warnings = said(home / "x.usda", stage=StageOptions(variants={"/V:v": "b"}))
    assert (count, warnings[0]) == (0, f"below.usda</Far>: warning: `../elsewhere/ball.usda` {FAR}\n  use")


@pytest.mark.parametrize("options", [{"mask": ("/Far",)}, {"session_layer": "session.usda"}])
def test_masks_and_session_layers(home: Path, options: dict[str, object]) -> None:
    (home / "session.usda").write_text(USES.replace("Far", "Farther"))
    if "session_layer" in options:
        options = {"session_layer": home / "session.usda"}
    count, warnings = said(home / "uses.usda", stage=StageOptions(**options))  # pyright: ignore[reportArgumentType]
    assert count == 0
    assert f"uses.usda</Far>: warning: `../elsewhere/ball.usda` {FAR}\n  use" in warnings


def test_pictures_profiles_and_tiles(home: Path) -> None:
    """Tiles inside are drawn."""
    (home / "t.1001.png").symlink_to("../elsewhere/paint.png")
    stage = PAINTED.replace("../elsewhere/paint.png", "./t.<UDIM>.png") + (
        'def DomeLight "L"\n{\n    asset inputs:texture:file = @../elsewhere/paint.png@\n}\n'
        'def SphereLight "S" (prepend apiSchemas = ["ShapingAPI"])\n{\n    asset inputs:shaping:ies:file = @../elsewhere/paint.png@\n}\n'
    )
    (home / "x.usda").write_text(stage)
    warnings = said(home / "x.usda")[1]
    elsewhere = "`../elsewhere/paint.png` lies outside of the scene's folder"
    assert f"x.usda</Paint/Picture>: warning: the picture `./t.1001.png` {LINK}\n  use" in warnings
    assert f"x.usda</L>: warning: the picture {elsewhere}: its fallback is drawn\n  use" in warnings
    assert f"x.usda</S>: warning: the IES profile {elsewhere}: it is left out\n  use" in warnings


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_the_range_of_frames_reads_the_root_layer_alone(home: Path) -> None:
    """A sublayer that is a pipe would be waited for."""
    os.mkfifo(home / "pipe.usda")
    head = "#usda 1.0\n(\n    subLayers = [@pipe.usda@]\n    startTimeCode = 1\n    endTimeCode = 9\n    framesPerSecond = 12\n)\n"
    (home / "x.usda").write_text(head)
    assert usd_stage.time_codes(home / "x.usda") == (1, 9)
    assert usd_stage.time_codes_per_second(home / "x.usda") == 12
