"""The tables of USD against usd-core's schema registry, and the reports of what is not drawn."""

# pyright: reportAttributeAccessIssue=false
# (usd-core creates its modules' names at run time)

import pytest
from maquette.compiler.importers.understood import State, Table
from maquette.compiler.importers.usd import tables
from pxr import Plug, Sdr, Tf, Usd

from .stages import read


def schemas() -> list[tuple[str, bool, list[str]]]:
    """(name, whether a prim type, names of properties) of every concrete and every applied schema."""
    registry, plugins = Usd.SchemaRegistry(), Plug.Registry()
    found = []
    for kind in plugins.GetAllDerivedTypes(Tf.Type.FindByName("UsdSchemaBase")):
        name, concrete = registry.GetSchemaTypeName(kind), registry.IsConcrete(kind)
        if concrete or registry.IsAppliedAPISchema(kind):
            plugins.GetPluginForType(kind).Load()
            made = registry.FindConcretePrimDefinition(name) if concrete else registry.FindAppliedAPIPrimDefinition(name)
            found.append((name, concrete, list(made.GetPropertyNames())))
    return found


def test_the_registry_has_the_schemas_of_usd_core():
    names = {name for name, _, _ in schemas()}
    assert {"Mesh", "RectLight", "MaterialBindingAPI", "ParticleField3DGaussianSplat", "PhysicsScene"} <= names
    assert len(names) > 100


def test_every_schema_has_a_row():
    missing = [
        name for name, concrete, _ in schemas() if (tables.PRIM_TYPES if concrete else tables.API_SCHEMAS).find(name) is None
    ]
    assert missing == []


def test_every_property_has_a_row():
    """Those of prim types that are not drawn at all are reported by the type."""
    missing = set()
    for name, concrete, properties in schemas():
        found = (tables.PRIM_TYPES if concrete else tables.API_SCHEMAS).find(name)
        if found is not None and found[0] != State.DRAWN:
            continue
        missing |= {f"{name}.{of}" for of in properties if tables.PROPERTIES.find(f"{name}.{of}", of) is None}
    assert missing == set()


def test_every_shader_of_usd_core_has_a_row():
    lights = {"Light", "DomeLight_1"}
    names = [n for n in Sdr.Registry().GetShaderNodeIdentifiers() if not n.endswith("Light") and n not in lights]
    assert [name for name in names if tables.SHADERS.find(name) is None] == []
    for name in ("UsdPreviewSurface", "UsdUVTexture", "UsdTransform2d", "UsdPrimvarReader_float"):
        inputs = Sdr.Registry().GetShaderNodeByIdentifier(name).GetShaderInputNames()
        assert [of for of in inputs if tables.INPUTS.find(f"{name}.{of}", of) is None] == []


def test_no_row_is_stale():
    """A name without `*` is a schema of usd-core, or one of its properties."""
    known = schemas()
    types = {name for name, _, _ in known}
    properties = {of for _, _, names in known for of in names} | {"extentsHint"}
    assert (tables.PRIM_TYPES.names() | tables.API_SCHEMAS.names()) - types <= {"SemanticsAPI"}
    assert {name.rpartition(".")[2] for name in tables.PROPERTIES.names()} - properties == set()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('def Mesh "m" (prepend apiSchemas = ["OddAPI"]) {}',
            "x.usda</m>: warning: the applied schema `OddAPI` is not known: it is not drawn"),
        ('def SphereLight "l" { float inputs:shadow:distance = 3 }', "x.usda</l>: warning: `shadow:distance` of SphereLight is not drawn"),
        ('def SphereLight "l" { float inputs:specular = 1 }', None),  # the schema's fallback
        ('def SphereLight "l" { float inputs:specular = 0.5 }', "x.usda</l>: warning: `specular` of SphereLight is not drawn"),
        ('def SphereLight "l" { float inputs:glow = 0.5 }', "x.usda</l>: warning: `glow` of SphereLight is not known: it is not drawn"),
        ('def SphereLight "l" { rel light:filters = </f> }', "x.usda</l>: warning: `light:filters` of SphereLight is not drawn"),
        ('def SphereLight "l" { float3 xformOp:scale = (2, 1, 1)\nuniform token[] xformOpOrder = ["xformOp:scale"] }',
            "x.usda</l>: warning: an uneven scale of a ball light is drawn as an even one"),
        ('def Sphere "s" { color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0)] (interpolation = "vertex") }',
            "x.usda</s>: warning: the displayColor varies over this shape: its mean is drawn"),
        ('def Sphere "s" { float[] primvars:displayOpacity = [1, 0] (interpolation = "vertex") }',
            "x.usda</s>: warning: the displayOpacity varies over this prim: its mean is drawn"),
        ('def Xform "m" (prepend apiSchemas = ["PhysicsRigidBodyAPI"]) { custom float userProperties:a = 1 }', None),
    ],
)  # fmt: skip
def test_what_is_not_drawn_is_said_by_name(tmp_path, text, expected):
    messages = read(tmp_path, text + '\ndef Cube "shown" {}')[1]
    assert messages == ([] if expected is None else [expected])


def test_a_name_has_one_row():
    with pytest.raises(ValueError, match="t: b has two rows"):
        Table("t", {"a b": ""}, {"b": ""})
    table = Table("t", {"a*": "", "c": ""}, {"ab": ""}, {"d": "why"})
    states = [found and found[0].value for found in map(table.find, ("ab", "axe", "c", "e"))]
    assert states == ["no effect", "drawn", "drawn", None]
    assert [table.report(f"`{name}`", name) for name in "cde"] == ["", "`d` is not drawn: why", "`e` is not known: it is not drawn"]
    assert table.names() == {"ab", "c", "d"}
