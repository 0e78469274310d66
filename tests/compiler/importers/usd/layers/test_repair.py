"""Damaged layers: what can be read of them is drawn, and what cannot is named."""

import codecs
import zipfile

import pytest

from ..stages import kinds, load

GOOD = """#usda 1.0
def Sphere "a"
{
    double radius = 2
}
def Cube "b"
{
    double size = 3
}
"""
LOST = "this statement cannot be read and is left out"


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (codecs.BOM_UTF8 + GOOD.encode(), ["1:1: warning: a byte order mark (UTF-8) is left out"]),
        (codecs.BOM_UTF16_LE + GOOD.encode("utf-16-le"), ["1:1: warning: a byte order mark (UTF-16-LE) is left out"]),
        (GOOD.encode() + b"\x1a", ["10:1: warning: bytes that are not text are left out"]),
        (GOOD.encode() + b"\0\0", ["10:1: warning: bytes that are not text are left out"]),
        (b"\n\n" + GOOD.encode(), []),
        (GOOD.replace("}\ndef", "}\nrubbish here\ndef").encode(), [f"6:1: warning: {LOST}: `rubbish here`"]),
        (GOOD.encode() + b"end of file", [f"10:1: warning: {LOST}: `end of file`"]),
        (GOOD.replace("radius = 2", "radius = ").encode(), [f"4:1: warning: {LOST}: `double radius =`"]),
        (GOOD.replace("radius = 2", 'radius = "big"').encode(), [f'4:1: warning: {LOST}: `double radius = "big"`']),
        (GOOD.replace("radius = 2", "radius = \udc80").encode(errors="surrogateescape"), [
            "4:1: warning: bytes that are not text are left out", f"4:1: warning: {LOST}: `double radius =`"]),
        (GOOD.replace("size = 3", "size = 3\n    float3[] extent = [(0, 0, 0),\n        (1, 1)]").encode(), [
            f"9:1: warning: {LOST}: `float3[] extent = [(0, 0, 0),`"]),
        (GOOD.rstrip().rstrip("}").encode(), ["9:1: warning: the file ends early: it is read as if its prims ended there"]),
    ],
)  # fmt: skip
def test_a_damaged_text_file_is_drawn(tmp_path, data, expected):
    path = tmp_path / "x.usda"
    path.write_bytes(data)
    scene, messages = load(path)
    assert kinds(scene) == ["SPHERE", "BOX"]
    assert [message.splitlines()[0] for message in messages] == [f"x.usda:{message}" for message in expected]


def test_a_layer_that_is_referred_to_is_repaired(tmp_path):
    (tmp_path / "part.usda").write_bytes(codecs.BOM_UTF8 + GOOD.encode())
    (tmp_path / "x.usda").write_text('#usda 1.0\ndef "r" (\n    references = @part.usda@</b>\n)\n{\n}\n')
    scene, messages = load(tmp_path / "x.usda")
    assert kinds(scene) == ["BOX"]
    assert messages == ["part.usda:1:1: warning: a byte order mark (UTF-8) is left out"]


def test_formats_under_the_name_of_the_other(tmp_path):
    from pxr import Sdf

    layer = Sdf.Layer.CreateAnonymous(".usda")  # pyright: ignore[reportAttributeAccessIssue]
    layer.ImportFromString(GOOD)
    layer.Export(str(tmp_path / "a.usdc"))
    (tmp_path / "x.usda").write_bytes((tmp_path / "a.usdc").read_bytes())
    scene, messages = load(tmp_path / "x.usda")
    assert kinds(scene) == ["SPHERE", "BOX"]
    assert messages == ["x.usda:1:1: warning: this file is binary, and its name ends as those of text"]
    (tmp_path / "y.usdc").write_text(GOOD)
    scene, messages = load(tmp_path / "y.usdc")
    assert kinds(scene) == ["SPHERE", "BOX"]
    assert messages == ["y.usdc:1:1: warning: this file is text, and its name ends as those of binary files"]


def test_a_package_that_begins_with_a_picture(tmp_path):
    with zipfile.ZipFile(tmp_path / "x.usdz", "w", zipfile.ZIP_STORED) as package:
        package.writestr("a.png", b"no picture")
        package.writestr("b.usda", GOOD)
    scene, messages = load(tmp_path / "x.usdz")
    assert kinds(scene) == ["SPHERE", "BOX"]
    assert messages == ["x.usdz: warning: the first file of the package is not a layer: `b.usda` is drawn"]


def test_a_file_without_a_sound_prim_is_an_error(tmp_path):
    (tmp_path / "x.usda").write_text("#usda 1.0\ndef Cube {\n")
    _, messages = load(tmp_path / "x.usda")
    assert len(messages) == 1
    assert messages[0].startswith("x.usda:2:1: error: cannot read the stage `x.usda`")


DEPTHS = "brackets nest in more than 1,000 levels here: what the deeper ones hold is left out"


def nested(levels: int) -> str:
    """A stage with a sphere under `levels` prims in each other, and a cube."""
    return '#usda 1.0\n# {{{ "\n' + 'def "a" {\n' * levels + 'def Sphere "s" {\n}\n' + "}\n" * levels + 'def Cube "b" {\n}\n'


@pytest.mark.long
@pytest.mark.parametrize("levels", [1001, 100_000])
@pytest.mark.parametrize("packed", [False, True])
def test_prims_that_nest_too_deep_are_left_out(tmp_path, levels, packed):
    path = tmp_path / "x.usda"
    path.write_text(nested(levels))
    if packed:
        with zipfile.ZipFile(tmp_path / "x.usdz", "w") as files:
            files.write(path, path.name)
    scene, messages = load(tmp_path / "x.usdz" if packed else path)
    assert kinds(scene) == ["BOX"]
    assert [m.splitlines()[0] for m in messages] == [f"{'x.usdz[x.usda]' if packed else 'x.usda'}:1003:1: warning: {DEPTHS}"]


def test_brackets_of_strings_and_comments_nest_nothing(tmp_path):
    path = tmp_path / "x.usda"
    path.write_text(nested(900) + 'def Cone "c" (\n    doc = """' + "((\n" * 600 + '"""\n) {\n}\n' + "# [{\n" * 600)
    scene, messages = load(path)
    assert sorted(kinds(scene)) == ["BOX", "CONE", "SPHERE"]
    assert messages == []


@pytest.mark.parametrize("first", ["x.usda", "y.usda"])
def test_damaged_text_in_a_package_is_repaired(tmp_path, first):
    texts = {"x.usda": GOOD.replace("radius = 2", "radius = "), "y.usda": '#usda 1.0\ndef "r" (\n    references = @x.usda@</b>\n)\n{\n}\n'}
    with zipfile.ZipFile(tmp_path / "x.usdz", "w") as files:
        for name in sorted(texts, key=lambda name: name != first):
            files.writestr(name, texts[name])
    scene, messages = load(tmp_path / "x.usdz")
    assert kinds(scene) == (["SPHERE", "BOX"] if first == "x.usda" else ["BOX"])
    assert messages == [f"x.usdz[x.usda]:4:1: warning: {LOST}: `double radius =`"]


@pytest.mark.parametrize(
    ("entry", "fault"),
    [
        ('upAxis = "Q"', "the value of `upAxis` is `Q`, neither Y nor Z"),
        ("metersPerUnit = 0", "the value of `metersPerUnit` is 0, not above 0"),
        ("metersPerUnit = nan", "the value of `metersPerUnit` is not finite"),
        ("timeCodesPerSecond = -24", "the value of `timeCodesPerSecond` is -24, not above 0"),
        ("endTimeCode = inf", "the value of `endTimeCode` is not finite"),
    ],
)  # fmt: skip
def test_metadata_without_a_meaning_take_their_default(tmp_path, entry, fault):
    (tmp_path / "x.usda").write_text(GOOD.replace("1.0\n", f"1.0\n(\n    {entry}\n)\n"))
    scene, messages = load(tmp_path / "x.usda")
    assert kinds(scene) == ["SPHERE", "BOX"]
    assert messages == [f"x.usda: warning: {fault}: its default is used"]


@pytest.mark.parametrize(
    ("text", "line", "shown", "found"),
    [
        ('def Sphere "s"\n{\n    double radius = ? }\ndef Cube "c"\n{\n}\n', 4, "double radius = ? }", ["/s", "/c"]),
        (
            'def Xform "x"\n{\n    def Sphere "s"\n    {\n        double radius = [1, }\n}\ndef Cube "c" {}\n',
            6,
            "double radius = [1, }",
            ["/x/s", "/c"],
        ),
        ('def Sphere "s" (\n    kind = ? )\n{\n}\ndef Cube "c" {}\n', 3, "kind = ? )", ["/s", "/c"]),
        ('def Sphere "s"\n{\n    double radius = ? # }\n}\ndef Cube "c" {}\n', 4, "double radius = ? # }", ["/s", "/c"]),
        ('def Sphere "s"\n{\n    double radius = (1,\n}\ndef Cube "c" {}\n', 4, "double radius = (1,", ["/s", "/c"]),
        ('def Sphere "s"\n{\n}\n}\ndef Cube "c" {}\n', 5, "}", ["/s", "/c"]),
    ],
)
def test_brackets_of_a_statement_that_is_left_out_still_close(tmp_path, text, line, shown, found):
    (tmp_path / "x.usda").write_text("#usda 1.0\n" + text)
    scene, messages = load(tmp_path / "x.usda")
    assert messages == [f"x.usda:{line}:1: warning: {LOST}: `{shown}`"]
    assert list(scene.names.instances) == found


@pytest.mark.parametrize("text", ['def Mesh "m"\n{\n    point3f[] points = [(0,0,0) (1,0,0)]\n}\n', 'def Xform "x"\n{\n'])
def test_a_damaged_stage_of_which_nothing_is_left_is_an_error(tmp_path, text):
    (tmp_path / "x.usda").write_text("#usda 1.0\n" + text)
    messages = load(tmp_path / "x.usda")[1]
    assert messages[1] == (
        "x.usda: error: cannot read the stage `x.usda`: nothing is left to draw without the statements that cannot be read\n"
        "  correct those that the warnings name, or export it again"
    )
