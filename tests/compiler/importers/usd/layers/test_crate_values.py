"""Values of binary layers that declare more items than their bytes can hold: they are named and left out, and the rest is drawn."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

import struct
import zipfile

import pytest
from maquette.compiler.importers.stage_options import StageOptions
from maquette.compiler.importers.usd import stage
from maquette.compiler.importers.usd.layers import crate_check, crate_values, packages
from maquette.compiler.io.sandbox import Files
from maquette.lang.diagnostics import Diagnostics
from pxr import Sdf

from .....fuzz import crates
from ..stages import kinds, load

STAGE = """#usda 1.0
def Mesh "m" (
    customData = { double[] extra = [1, 2, 3, 4.5, 6, 7] }
)
{
    int[] faceVertexCounts = [COUNTS]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    point3f[] points.timeSamples = { 1: [(0, 0, 0), (1, 0, 0), (0, 1, 7)] }
    token[] names = ["a", "b", "c", "d", "e"]
}
def Sphere "s"
{
}
"""
SHORT, LONG = "3, 3, 3", ", ".join(["3"] * 20)


def written(path, counts: str) -> bytearray:
    """The bytes of a binary file of STAGE."""
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    layer.ImportFromString(STAGE.replace("COUNTS", counts))
    layer.Export(str(path))
    return bytearray(path.read_bytes())


def lengthened(data: bytearray, before: bytes, after: bytes, count: int) -> bytes:
    """A file in which the array of length `before`, followed by `after`, declares `count` items."""
    at = data.index(before + after)
    data[at : at + 8] = struct.pack("<Q", count)
    return bytes(data)


@pytest.mark.parametrize("name", ["faceVertexCounts", "faceVertexIndices", "points", "names", "/m customData"])
def test_an_array_that_is_longer_than_the_file(tmp_path, name):
    path = tmp_path / "x.usdc"
    data = written(path, SHORT)
    starts = {
        "faceVertexCounts": (3, struct.pack("<3i", 3, 3, 3)), "faceVertexIndices": (3, struct.pack("<3i", 0, 1, 2)),
        "points": (3, struct.pack("<6f", 0, 0, 0, 1, 0, 0)), "names": (5, b""), "/m customData": (6, struct.pack("<2d", 1, 2)),
    }  # fmt: skip
    count, after = starts[name]
    path.write_bytes(lengthened(data, struct.pack("<Q", count), after, 10**9))
    scene, messages = load(path)
    assert "SPHERE" in kinds(scene)
    where = name if name.startswith("/") else f"/m.{name}"
    room = messages[0].split("the file has ")[1].split(" ")[0]
    assert messages[0] == (
        f"x.usdc: warning: the value of `{where}` is left out: it declares 1,000,000,000 items, and the file has {room} bytes for them"
    )


@pytest.mark.parametrize("count", [10**7, 10**9])
def test_a_compressed_array(tmp_path, count):
    """20 equal counts take 15 bytes: as many bytes hold 10⁷ items at most in theory, and a small file may not declare 10⁹."""
    path = tmp_path / "x.usdc"
    data = written(path, LONG)
    path.write_bytes(lengthened(data, struct.pack("<Q", 20), b"", count))
    (found,) = crate_values.excessive(path.read_bytes())
    assert found.why.startswith(f"it declares {count:,} items, and the file has ")
    assert crate_values.paths(path.read_bytes(), [found]) == ["/m.faceVertexCounts"]


def test_many_items_in_a_large_file(tmp_path):
    """Bytes enough for 20 million items, in a file of which 16 million and 4 for each byte are read."""
    path = tmp_path / "x.usdc"
    data = written(path, LONG)
    data = lengthened(data, struct.pack("<Q", 20), b"", 20_000_000)
    (found,) = crate_values.excessive(data + bytes(40_000))
    assert found.why == (
        "it declares 20,000,000 items, and compressed ones are at most 16,000,000 in a file, and 4 for each of its bytes: "
        "a .usda file has no such limit"
    )
    assert crate_values.excessive(data + bytes(2_000_000)) == []


def test_values_in_values_without_end(tmp_path):
    """The dictionary of a dictionary is the dictionary itself, twice: 2ⁿ values in n levels."""
    path = tmp_path / "x.usdc"
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    layer.ImportFromString(
        '#usda 1.0\ndef Sphere "s" ( customData = { dictionary a = { int i = 7 }\ndictionary b = { int i = 8 } } )\n{\n}\n'
    )
    layer.Export(str(path))
    data = bytearray(path.read_bytes())
    (rep,) = [each for each in crates.read(bytes(data)).reps if each >> 48 & 255 == 31]
    place = (rep & (1 << 48) - 1) + 8
    for _ in range(2):
        place += 4 + struct.unpack_from("<Q", data, place + 4)[0]
        struct.pack_into("<Q", data, place, rep)
        place += 8
    path.write_bytes(data)
    scene, messages = load(path)
    assert kinds(scene) == ["SPHERE"]
    assert messages[0] == (
        "x.usdc: warning: the value of `/s customData` is left out: it holds values in values, over 64 deep or more than 1,000,000"
    )


ROOT = '#usda 1.0\ndef "r" (\n    references = @./part.usdc@</s>\n)\n{\n}\ndef Cone "c"\n{\n}\n'


def packed(folder, name: str, files: dict[str, str | bytes]):
    """The path of a package with these files."""
    with zipfile.ZipFile(folder / name, "w") as made:
        for inner, data in files.items():
            made.writestr(inner, data)
    return folder / name


def excess(folder) -> bytes:
    """A file whose faceVertexIndices are too many."""
    return lengthened(written(folder / "part.usdc", SHORT), struct.pack("<Q", 3), struct.pack("<3i", 0, 1, 2), 10**9)


LEFT_OUT = "x.usdz[part.usdc]: warning: the value of `/m.faceVertexIndices` is left out: it declares 1,000,000,000 items"


def test_the_rest_of_a_package_is_drawn(tmp_path):
    """A value of the first layer, and of one that it refers to."""
    path = packed(tmp_path, "x.usdz", {"part.usdc": excess(tmp_path)})
    scene, messages = load(path)
    assert kinds(scene) == ["SPHERE"]
    assert messages[0].startswith(LEFT_OUT)
    assert not any("error" in message for message in messages)
    assert stage.time_codes(path) is None
    scene, messages = load(packed(tmp_path, "x.usdz", {"root.usda": ROOT, "part.usdc": excess(tmp_path)}))
    assert kinds(scene) == ["SPHERE", "CONE"]
    assert messages[0].startswith(LEFT_OUT)
    assert len(messages) == 1
    with zipfile.ZipFile(tmp_path / "x.usdz", "a") as files:
        assert files.testzip() is None  # it is as it was
        assert files.namelist() == ["root.usda", "part.usdc"]


def test_files_of_a_package_are_read_from_it(tmp_path):
    """The layers that replace others refer to pictures and layers of the package."""
    scene, messages = load(packed(tmp_path, "x.usdz", {"a/root.usda": ROOT, "a/part.usdc": excess(tmp_path), "a/b.png": b""}))
    assert kinds(scene) == ["SPHERE", "CONE"]
    assert len(messages) == 1
    opened = stage.open_(tmp_path / "x.usdz", "x.usdz", Files(tmp_path), Diagnostics(), None)
    assert opened is not None
    assert opened.files[0] == str(tmp_path / "x.usdz")
    (part,) = (layer for layer in opened.stand_ins if layer.identifier.endswith("part.usdc]"))
    assert part.ComputeAbsolutePath("./b.png") == f"{tmp_path}/x.usdz[a/b.png]"


def test_a_package_that_a_layer_refers_to(tmp_path):
    packed(tmp_path, "x.usdz", {"root.usda": ROOT.replace('def "r"', 'def "p"', 1), "part.usdc": excess(tmp_path)})
    for target in ("x.usdz@</p>", "x.usdz[part.usdc]@</s>"):
        (tmp_path / "y.usda").write_text(f'#usda 1.0\ndef "r" (\n    references = @./{target}\n)\n{{\n}}\ndef Cube "c"\n{{\n}}\n')
        scene, messages = load(tmp_path / "y.usda")
        assert kinds(scene) == ["SPHERE", "BOX"]
        assert messages[0].startswith(LEFT_OUT)
        assert len(messages) == 1


def test_a_variant_of_a_package_keeps_its_replacement(tmp_path):
    """A layer that only another variant refers to is not read from the file when that is selected."""
    root = """#usda 1.0
def "r" (
    variants = {
        string v = "a"
    }
    prepend variantSets = "v"
)
{
    variantSet "v" = {
        "a" {
            def Cone "c"
            {
            }
        }
        "b" (
            prepend references = @./part.usdc@</m>
        ) {
        }
    }
}
"""
    path = packed(tmp_path, "x.usdz", {"root.usda": root, "part.usdc": excess(tmp_path)})
    opened = stage.open_(path, "x.usdz", Files(tmp_path), Diagnostics(), None, options=StageOptions(variants={"/r:v": "b"}))
    assert opened is not None
    mesh = opened.stage.GetPrimAtPath("/r")
    assert mesh.GetAttribute("faceVertexCounts").Get() is not None
    assert mesh.GetAttribute("faceVertexIndices").Get() is None


def test_a_layer_of_a_package_that_cannot_be_read(tmp_path):
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    layer.ImportFromString(STAGE.replace("COUNTS", SHORT))
    layer.Export(str(tmp_path / "part.usdc"))
    data = bytearray((tmp_path / "part.usdc").read_bytes())
    (toc,) = struct.unpack_from("<Q", data, 16)
    struct.pack_into("<Q", data, toc, 1 << 40)
    scene, messages = load(packed(tmp_path, "x.usdz", {"root.usda": ROOT, "part.usdc": bytes(data)}))
    assert kinds(scene) == ["CONE"]
    assert messages[0] == "x.usdz[part.usdc]: warning: this layer cannot be read: its table of contents is longer than the file"
    scene, messages = load(packed(tmp_path, "x.usdz", {"part.usdc": bytes(data), "root.usda": ROOT}))
    assert messages == ["x.usdz: error: cannot read the stage `x.usdz`: `part.usdc`: its table of contents is longer than the file"]


def test_sections_of_old_versions_end_in_the_file(tmp_path):
    path = tmp_path / "x.usdc"
    data = written(path, SHORT)
    data[8:11] = bytes((0, 0, 1))
    (toc,) = struct.unpack_from("<Q", data, 16)
    struct.pack_into("<QQ", data, toc + 8 + 16, 1 << 59, 0)
    path.write_bytes(data)
    assert crate_check.fault(path) == "its section TOKENS ends beyond the file"


@pytest.mark.assets
def test_sound_files_have_none(assets):
    found = [path for path in sorted(assets.rglob("*.usd*")) if path.suffix in (".usd", ".usdc", ".usdz")]
    said = Diagnostics()
    assert not any(packages.replaced(path, said) if path.suffix == ".usdz" else crate_values.read(path, said) for path in found)
    assert said.items == []
