"""Stages that a scene uses read what the scene may read: layers and pictures elsewhere need --allow."""

from __future__ import annotations

from pathlib import Path

import pytest
from maquette.compiler import load
from maquette.lang.diagnostics import Diagnostics, SceneError

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
    assert [d.message for d in errors] == ["`uses.usda` reads `ball.usda`, which lies outside of the scene's folder"]
    assert errors[0].hint == f"use --allow {home.parent / 'elsewhere'} to let scenes read it"


def test_allowed_layers_are_read(home: Path) -> None:
    scene = load.load(home / "layers.scene", allow=(home.parent / "elsewhere",))
    assert len(scene.tables.instances.geometry) == 1


def test_a_stage_that_is_rendered_itself_is_the_users_choice(home: Path) -> None:
    assert len(load.load(home / "uses.usda").tables.instances.geometry) == 1


def test_pictures_elsewhere_are_not_read(home: Path) -> None:
    said = Diagnostics()
    scene = load.load(home / "pictures.scene", diagnostics=said)
    assert len(scene.tables.images.first) == 0
    expected = "the picture `../elsewhere/paint.png` lies outside of the scene's folder: its fallback is drawn"
    assert [d.message for d in said.items] == [expected]
