"""Warnings name faulty pictures of textures, UDIM tiles, lights, domes and displacement."""

import pytest
from PIL import Image

from ..stages import read
from ..test_displacement import BOTH, OUTPUT, PICTURE, ST
from ..test_materials import stage

TOLD = "the picture `p.gif` has 2 frames: the first is drawn\n  to draw another, write it to a file of its own"
TEXTURE = 'def Shader "t" { uniform token info:id = "UsdUVTexture"\nasset inputs:file = @%s@\nfloat3 outputs:rgb }'
DIFFUSE = "color3f inputs:diffuseColor.connect = </m/t.outputs:rgb>"
MOVED = "float inputs:displacement.connect = </m/t.outputs:r>\ntoken outputs:displacement"


def animation(path):
    red, blue = (Image.new("RGB", (4, 4), color) for color in ("#ff0000", "#0000ff"))
    red.save(path, save_all=True, append_images=[blue])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (stage(DIFFUSE, TEXTURE % "p.gif"), f"x.usda</m/t>: warning: {TOLD}"),
        (stage(DIFFUSE, TEXTURE % "p.<UDIM>.gif"), f"x.usda</m/t>: warning: {TOLD.replace('p.gif', 'p.1001.gif')}"),
        (stage(MOVED, PICTURE.replace("p.png", "p.gif"), ST).replace(OUTPUT, BOTH), f"x.usda</m/t>: warning: {TOLD}"),
        ('def RectLight "l" { asset inputs:texture:file = @p.gif@\n}\ndef Cube "c" {}', f"x.usda</l>: warning: {TOLD}"),
        ('def DomeLight "l" { asset inputs:texture:file = @p.gif@\n}\ndef Cube "c" {}', f"x.usda</l>: warning: {TOLD}"),
        (
            'def DomeLight "l" { asset inputs:texture:file = @p.gif@\ntoken inputs:texture:format = "angular" }\ndef Cube "c" {}',
            f"x.usda</l>: warning: {TOLD}",
        ),
    ],
)  # fmt: skip
def test_each_use_of_a_picture_tells_of_its_further_frames(tmp_path, text, expected):
    animation(tmp_path / "p.gif")
    animation(tmp_path / "p.1001.gif")
    assert [message for message in read(tmp_path, text)[1] if "note: displacement" not in message] == [expected]


def test_the_picture_of_a_light_that_cannot_be_read(tmp_path):
    (tmp_path / "p.png").write_bytes(b"no picture")
    text = 'def RectLight "l" { asset inputs:texture:file = @p.png@\n}\ndef Cube "c" {}'
    hint = "its format is not known: write it as PNG, JPEG, TIFF, WebP, EXR or HDR"
    assert read(tmp_path, text)[1] == [f"x.usda</l>: warning: cannot read the picture `p.png`\n  {hint}"]
