"""Stand-ins of models: which models have one, its bounds, and the pictures of cards at their places."""

import numpy as np
import OpenImageIO as oiio
import pytest
from maquette.compiler import ir

from ....files import write_image
from .stages import attribute, corners, kinds, read, slot, world

BALL = 'def Sphere "s" { double radius = 1\ndouble3 xformOp:translate = (0, 0, 4)\nuniform token[] xformOpOrder = ["xformOp:translate"] }'


def model(attributes: str, kind: str = "component", inside: str = BALL, more: str = "") -> str:
    meta = f'prepend apiSchemas = ["GeomModelAPI"]\nkind = "{kind}"'
    return f'def Xform "m" (\n{meta}\n) {{ {attributes}\n{more}\n{inside} }}'


def bounds(scene: ir.Scene) -> np.ndarray:
    every = np.concatenate([corners(scene, k).reshape(-1, 3) for k in range(len(scene.tables.instances.geometry))])
    return np.array([every.min(axis=0), every.max(axis=0)])


def test_bounds_are_thin_bars_around_the_model(tmp_path):
    scene, messages = read(tmp_path, model('uniform token model:drawMode = "bounds"\nuniform float3 model:drawModeColor = (1, 0.5, 0)'))
    assert messages == []
    assert (kinds(scene), slot(scene, "DIFFUSE")) == (["MESH"], [1, 0.5, 0])
    width = 0.005 * np.sqrt(12)
    assert bounds(scene) == pytest.approx(np.array([[-1, -1, 3], [1, 1, 5]]) + np.array([[-0.5], [0.5]]) * width)
    assert len(corners(scene)) == 12 * 12  # twelve edges of six faces
    assert not (np.abs(corners(scene) - [0, 0, 4]).max(axis=2) < 0.9).any()  # hollow


def test_a_model_with_bounds_moves_with_its_prim(tmp_path):
    place = 'double3 xformOp:translate = (5, 0, 0)\nuniform token[] xformOpOrder = ["xformOp:translate"]'
    scene, _ = read(tmp_path, model('uniform token model:drawMode = "bounds"', more=place))
    assert world(scene)[:, 3].tolist() == [5, 0, 0]
    assert bounds(scene).mean(axis=0) == pytest.approx([5, 0, 4])


def test_the_hint_precedes_the_computed_extent(tmp_path):
    hint = "float3[] extentsHint = [(-2, -2, -2), (2, 2, 2)]"
    scene, _ = read(tmp_path, model('uniform token model:drawMode = "bounds"', more=hint))
    assert bounds(scene).mean(axis=0) == pytest.approx([0, 0, 0])


def test_an_origin_is_three_axes(tmp_path):
    scene, messages = read(tmp_path, model('uniform token model:drawMode = "origin"'))
    assert messages == []
    assert bounds(scene) == pytest.approx(np.array([[-0.005] * 3, [1.005] * 3]))
    assert slot(scene, "DIFFUSE") == pytest.approx([0.18] * 3)


@pytest.mark.parametrize(
    ("kind", "attributes", "replaced"),
    [
        ("component", 'uniform token model:drawMode = "bounds"', True),
        ("component", 'uniform token model:drawMode = "default"', False),
        ("component", "", False),
        ("component", 'uniform token model:drawMode = "bounds"\nuniform bool model:applyDrawMode = 0', False),
        ("group", 'uniform token model:drawMode = "bounds"', False),
        ("group", 'uniform token model:drawMode = "bounds"\nuniform bool model:applyDrawMode = 1', True),
    ],
)
def test_which_models_are_replaced(tmp_path, kind, attributes, replaced):
    scene, messages = read(tmp_path, model(attributes, kind))
    assert (kinds(scene), messages) == (["MESH" if replaced else "SPHERE"], [])


def test_the_mode_is_inherited(tmp_path):
    below = model("").replace('"m"', '"below"')
    assert kinds(read(tmp_path, model('uniform token model:drawMode = "origin"', "group", below))[0]) == ["MESH"]
    own = model('uniform token model:drawMode = "default"').replace('"m"', '"below"')
    assert kinds(read(tmp_path, model('uniform token model:drawMode = "origin"', "group", own))[0]) == ["SPHERE"]


def test_a_model_without_extent(tmp_path):
    scene, messages = read(tmp_path, model('uniform token model:drawMode = "bounds"', inside="") + '\ndef Cube "c" {}')
    assert messages == ["x.usda</m>: warning: this model has no extent: its bounds are not drawn"]
    assert kinds(scene) == ["BOX"]


CARDS = 'uniform token model:drawMode = "cards"'


def quads(scene: ir.Scene) -> np.ndarray:
    """Bounds (n, 2, 3) of each instance."""
    every = [corners(scene, k).reshape(-1, 3) for k in range(len(scene.tables.instances.geometry))]
    return np.array([[c.min(axis=0), c.max(axis=0)] for c in every])


def test_cards_without_pictures_are_six_in_the_color(tmp_path):
    scene, messages = read(tmp_path, model(CARDS + "\nuniform float3 model:drawModeColor = (0, 1, 0)"))
    assert (messages, len(quads(scene)), slot(scene, "DIFFUSE", 5)) == ([], 6, [0, 1, 0])
    middle = [[0, 0, 4]] * 6
    assert quads(scene).mean(axis=1) == pytest.approx(np.array(middle), abs=1e-3)  # a cross
    boxes = quads(read(tmp_path, model(CARDS + '\nuniform token model:cardGeometry = "box"'))[0])
    assert boxes.mean(axis=1).tolist() == [[1, 0, 4], [0, 1, 4], [0, 0, 5], [-1, 0, 4], [0, -1, 4], [0, 0, 3]]


@pytest.mark.parametrize("box", [False, True])
def test_cards_face_outward(tmp_path, box):
    scene, _ = read(tmp_path, model(CARDS + ('\nuniform token model:cardGeometry = "box"' if box else "")))
    outward = [np.cross(c[0, 1] - c[0, 0], c[0, 2] - c[0, 0]) for c in (corners(scene, k) for k in range(6))]
    signs = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, -1, 0], [0, 0, -1]]
    assert np.sign(np.round(outward, 6)).tolist() == signs


@pytest.mark.parametrize(
    ("face", "own", "opposite"),  # where the picture's s and t increase on its card and on the other, by axis
    [
        ("XPos", ((0, 1, 0), (0, 0, 1)), ((0, 1, 0), (0, 0, 1))),
        ("XNeg", ((0, -1, 0), (0, 0, 1)), ((0, -1, 0), (0, 0, 1))),
        ("YPos", ((-1, 0, 0), (0, 0, 1)), ((-1, 0, 0), (0, 0, 1))),
        ("YNeg", ((1, 0, 0), (0, 0, 1)), ((1, 0, 0), (0, 0, 1))),
        ("ZPos", ((1, 0, 0), (0, 1, 0)), ((1, 0, 0), (0, 1, 0))),
        ("ZNeg", ((1, 0, 0), (0, -1, 0)), ((1, 0, 0), (0, -1, 0))),
    ],
)
def test_a_picture_is_on_both_cards_of_its_axis(tmp_path, face, own, opposite):
    """Seen from outside with z up a picture is upright; the card behind it shows it mirrored, at the same place."""
    write_image(tmp_path / "a.png", np.full((2, 2, 4), 255, np.uint8))
    scene, messages = read(tmp_path, model(f"{CARDS}\nasset model:cardTexture{face} = @a.png@"))
    assert (messages, len(quads(scene))) == ([], 2)
    names = [scene.names.geometries[g] for g in scene.tables.instances.geometry]
    for k, name in enumerate(names):
        place, at = corners(scene, k).reshape(-1, 3), attribute(scene, "uvs", k).reshape(-1, 2)
        slopes = np.linalg.lstsq(np.column_stack([at, np.ones(len(at))]), place, rcond=None)[0][:2]
        expected = own if name == f"m {face}" else opposite
        assert np.sign(np.round(slopes, 6)).tolist() == [list(map(float, way)) for way in expected], name


def test_cards_are_cut_out_by_the_opacity_of_their_picture(tmp_path):
    pixels = np.zeros((1, 2, 4), np.uint8)
    pixels[0, 0] = 255
    write_image(tmp_path / "a.png", pixels)
    scene, _ = read(tmp_path, model(f"{CARDS}\nasset model:cardTextureXPos = @a.png@"))
    t = scene.tables
    row = t.instances.material[0]
    assert t.materials.threshold[row] == pytest.approx(0.1)
    assert t.materials.textures[row, ir.Slot.OPACITY] >= 0
    assert t.materials.textures[row, ir.Slot.DIFFUSE] >= 0


def test_a_missing_picture_shows_the_color(tmp_path):
    text = f"{CARDS}\nasset model:cardTextureYNeg = @gone.png@\nuniform float3 model:drawModeColor = (1, 0, 0)"
    scene, messages = read(tmp_path, model(text))
    assert messages == ["x.usda</m>: warning: there is no picture `gone.png`: its fallback is drawn"]
    assert [slot(scene, "DIFFUSE", k) for k in (0, 1)] == [[1, 0, 0]] * 2


def test_simple_visibility_leaves_out_the_cards_across_the_up_axis(tmp_path):
    text = model(f'{CARDS}\nuniform token model:cardGeometry = "box"\nuniform token model:cardVisibility = "simple"')
    y_up = quads(read(tmp_path, text, 'upAxis = "Y"')[0])
    assert y_up.mean(axis=1).tolist() == [[1, 0, 4], [0, 0, 5], [-1, 0, 4], [0, 0, 3]]


def test_a_card_by_the_matrix_of_its_picture(tmp_path):
    """A worldtoscreen matrix of a scale by ½ about (1, 0, 3): the card is a square of side 4 there."""
    matrix = np.diag([0.5, 0.5, 0.5, 1.0])
    matrix[3, :3] = -0.5 * np.array([1.0, 0.0, 3.0])
    spec = oiio.ImageSpec(2, 2, 4, "float")
    spec.attribute("worldtoscreen", "matrix44", tuple(matrix.reshape(-1)))
    out = oiio.ImageOutput.create(str(tmp_path / "a.exr"))
    assert out is not None
    out.open(str(tmp_path / "a.exr"), spec)
    out.write_image(np.ones((2, 2, 4), np.float32))
    out.close()
    write_image(tmp_path / "b.png", np.full((2, 2, 4), 255, np.uint8))
    files = "asset model:cardTextureXPos = @a.exr@\nasset model:cardTextureYPos = @b.png@"
    scene, messages = read(tmp_path, model(f'{CARDS}\nuniform token model:cardGeometry = "fromTexture"\n{files}'))
    assert messages == ["x.usda</m>: warning: the card of `b.png` is not drawn: its metadata have no worldtoscreen matrix"]
    assert quads(scene).tolist() == [[[-1, -2, 3], [3, 2, 3]]]
