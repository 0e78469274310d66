"""Binary layers that OpenUSD would read for minutes, or at which it would end the process: they are refused before."""

import struct
import zipfile
from dataclasses import replace

import pytest
from maquette.compiler.importers.usd.layers import crate_check

from .....fuzz import crates
from ..stages import kinds, load
from .test_missing_specs import crate, typed


def looped(made: crates.Crate) -> crates.Crate:
    """The jump of the first path with a child and a sibling leads to that child."""
    at = next(k for k, jump in enumerate(made.jumps) if jump > 0)
    return replace(made, jumps=[*made.jumps[:at], 1, *made.jumps[at + 1 :]])


def counted(made: crates.Crate, name: bytes) -> bytes:
    """A file whose section declares 2⁴⁰ items."""
    data = bytearray(crates.written(made))
    (toc,) = struct.unpack_from("<Q", data, 16)
    row = next(toc + 8 + 32 * k for k in range(6) if data[toc + 8 + 32 * k :].startswith(name))
    struct.pack_into("<Q", data, struct.unpack_from("<Q", data, row + 16)[0], 1 << 40)
    return bytes(data)


def test_paths_that_are_no_tree(tmp_path):
    path = tmp_path / "x.usdc"
    path.write_bytes(crates.written(looped(crate(path))))
    scene, messages = load(path)
    assert kinds(scene) == []
    assert messages[0] == "x.usdc: error: cannot read the stage `x.usdc`: its paths are not a tree"


def chained(made: crates.Crate, count: int) -> crates.Crate:
    """The prim /g becomes the top of a chain of prims in each other."""
    new = list(range(made.path_count, made.path_count + count))
    return replace(
        made, path_count=made.path_count + count, paths=[*made.paths[:2], *new, *made.paths[2:]],
        elements=[*made.elements[:2], *[made.elements[1]] * count, *made.elements[2:]],
        jumps=[*made.jumps[:2], *[-1] * count, *made.jumps[2:]],
    )  # fmt: skip


@pytest.mark.long
def test_paths_of_many_levels(tmp_path):
    path = tmp_path / "x.usdc"
    made = crate(path)
    for count, fault in ((900, ""), (100_000, "its paths have more than 1,000 levels")):
        path.write_bytes(crates.written(chained(made, count)))
        assert crate_check.fault(path) == fault


def test_a_negative_type_of_a_spec(tmp_path):
    path = tmp_path / "x.usdc"
    path.write_bytes(crates.written(typed(crate(path), 3, -1784)))
    assert crate_check.fault(path) == "the types of its specs are damaged"


@pytest.mark.parametrize("name", [b"TOKENS", b"STRINGS", b"FIELDS", b"FIELDSETS", b"PATHS", b"SPECS"])
def test_more_items_than_a_section_can_hold(tmp_path, name):
    path = tmp_path / "x.usdc"
    path.write_bytes(counted(crate(path), name))
    assert crate_check.fault(path) == f"its section {name.decode()} has fewer than the 1,099,511,627,776 items that it declares"


@pytest.mark.parametrize("packed", [False, True])
def test_the_rest_of_a_stage_is_drawn(tmp_path, packed):
    part = tmp_path / "part.usdc"
    part.write_bytes(crates.written(looped(crate(part))))
    if packed:
        with zipfile.ZipFile(tmp_path / "part.usdz", "w") as files:
            files.write(part, "part.usdc")
    name, why = ("part.usdz", "`part.usdc`: its paths are not a tree") if packed else ("part.usdc", "its paths are not a tree")
    (tmp_path / "x.usda").write_text(f'#usda 1.0\ndef "r" (\n    references = @{name}@\n)\n{{\n}}\ndef Cone "c"\n{{\n}}\n')
    scene, messages = load(tmp_path / "x.usda")
    assert kinds(scene) == ["CONE"]
    assert messages[0] == f"{name}: warning: this layer cannot be read: {why}"


@pytest.mark.assets
def test_sound_files_pass(assets):
    """All files of Pixar, Apple, NVIDIA and others, with blocks that other LZ4 encoders wrote."""
    found = [path for path in sorted(assets.rglob("*.usd*")) if path.suffix in (".usd", ".usdc", ".usdz")]
    assert len(found) > 10
    assert {crate_check.fault(path) for path in found} == {""}
