"""Binary layers that list prims and variants which they do not hold: these are named and left out, and the rest is drawn."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

from dataclasses import replace

import pytest
from pxr import Sdf

from .....fuzz import crates
from ..stages import kinds, load

STAGE = """#usda 1.0
(
    defaultPrim = "g"
    endTimeCode = 48
    startTimeCode = 0
)
def Xform "g"
{
    def Sphere "a"
    {
    }
    def Cube "b" (
        variants = { string v = "big" }
        prepend variantSets = "v"
    )
    {
        variantSet "v" = {
            "big" {
                double size = 5
            }
            "small" {
                double size = 1
            }
        }
    }
}
"""
LOST = "is listed in this layer and missing: it is left out"


def crate(path) -> crates.Crate:
    """The contents of a binary file of STAGE, which is left at the path."""
    layer = Sdf.Layer.CreateAnonymous(".usdc")
    layer.ImportFromString(STAGE)
    layer.Export(str(path))
    return crates.read(path.read_bytes())


def typed(made: crates.Crate, number: int, kind: int) -> crates.Crate:
    """The contents with another type of one spec: /, /g, /g/a, /g/b, /g/b{v=}, /g/b{v=big}, /g/b{v=small}."""
    return replace(made, spec_types=[*made.spec_types[:number], kind, *made.spec_types[number + 1 :]])


@pytest.mark.parametrize("kind", [1, 8, 10, 11])
@pytest.mark.parametrize(
    ("number", "drawn", "lost"),
    [
        (2, ["BOX"], "/g/a"), (3, ["SPHERE"], "/g/b"), (4, ["SPHERE", "BOX"], "/g/b{v=}"), (5, ["SPHERE", "BOX"], "/g/b{v=big}"),
        (6, ["SPHERE", "BOX"], "/g/b{v=small}"),
    ],
)  # fmt: skip
def test_a_spec_that_is_listed_and_missing_is_left_out(tmp_path, number, kind, drawn, lost):
    path = tmp_path / "x.usdc"
    made = crate(path)
    path.write_bytes(crates.written(typed(made, number, kind)))
    scene, messages = load(path)
    right = made.spec_types[number] == kind
    assert kinds(scene) == drawn
    selected = "x.usdc</g/b>: warning: the variant set `v` has no variant `big`, which is selected: none is drawn (it has small)"
    assert messages == ([] if right else [f"x.usdc: warning: `{lost}` {LOST}", *([selected] if lost.endswith("big}") else [])])


def test_the_layers_that_are_referred_to(tmp_path):
    path = tmp_path / "part.usdc"
    path.write_bytes(crates.written(typed(crate(path), 2, 1)))
    (tmp_path / "x.usda").write_text('#usda 1.0\ndef "r" (\n    references = @part.usdc@\n)\n{\n}\ndef Cone "c"\n{\n}\n')
    scene, messages = load(tmp_path / "x.usda")
    assert kinds(scene) == ["BOX", "CONE"]
    assert messages == [f"part.usdc: warning: `/g/a` {LOST}"]


def test_a_variant_without_a_name_ends(tmp_path):
    """It has the path of its variant set, which then lists itself."""
    path = tmp_path / "x.usdc"
    made = crate(path)
    path.write_bytes(crates.written(replace(made, tokens=[b"" if token == b"small" else token for token in made.tokens])))
    scene, messages = load(path)
    assert kinds(scene) == ["SPHERE", "BOX"]
    assert messages == [f"x.usdc: warning: `/g/b{{v=}}` {LOST}"]


def test_metadata_of_another_type_take_their_default(tmp_path):
    path = tmp_path / "x.usdc"
    made = crate(path)
    reps = [made.reps[0] if made.tokens[name] == b"endTimeCode" else rep for name, rep in zip(made.fields, made.reps, strict=True)]
    path.write_bytes(crates.written(replace(made, reps=reps)))  # the name of defaultPrim
    scene, messages = load(path)
    assert kinds(scene) == ["SPHERE", "BOX"]
    assert messages == ["x.usdc: warning: the value of `endTimeCode` has another type: its default is used"]


def test_a_layer_without_a_root_is_refused(tmp_path):
    path = tmp_path / "x.usdc"
    made = crate(path)
    specs = {name: getattr(made, name)[1:] for name in ("spec_paths", "spec_fields", "spec_types")}
    path.write_bytes(crates.written(replace(made, **specs)))
    reason = "usd-core does not say why\n  copy or export it again"
    assert load(path)[1] == [f"x.usdc: error: cannot read the stage `x.usdc`: {reason}"]
