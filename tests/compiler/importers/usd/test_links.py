"""Light links of USD: the collections of a light become sets of the instances that it lights and that cast its shadows."""

import numpy as np
import pytest
from maquette.compiler.ir import light_links

from .stages import SQUARE, read

STAGE = """
def Xform "w" { def Cube "a" {}
  def Sphere "b" {}
  def Cone "c" {} }
def SphereLight "l" { LINKS }
"""
INCLUDE = "uniform bool collection:{0}:includeRoot = 0\nrel collection:{0}:includes = {1}"
EXCLUDE = "rel collection:{0}:excludes = {1}"


def sets(scene, light=0) -> tuple[set[str], set[str]]:
    """The names of the instances that a light lights, and of those that cast its shadows."""
    t = scene.tables
    names = np.array(scene.names.instances)
    lit, casting = (set(names[t.instances.visible & getattr(t.lights, of)[light] != 0].tolist()) for of in ("receivers", "blockers"))
    return lit, casting


ALL = {"/w/a", "/w/b", "/w/c"}


@pytest.mark.parametrize(
    ("links", "receivers", "blockers"),
    [
        ("", ALL, ALL),
        (EXCLUDE.format("lightLink", "</w/b>"), ALL - {"/w/b"}, ALL),
        (EXCLUDE.format("shadowLink", "[</w/b>, </w/c>]"), ALL, {"/w/a"}),
        (INCLUDE.format("lightLink", "</w/b>"), {"/w/b"}, ALL),
        (INCLUDE.format("lightLink", "</w>") + "\n" + EXCLUDE.format("lightLink", "</w/a>"), {"/w/b", "/w/c"}, ALL),
        (INCLUDE.format("lightLink", "[]"), set(), ALL),
        (INCLUDE.format("lightLink", "</w/a>") + "\n" + INCLUDE.format("shadowLink", "</w/a>"), {"/w/a"}, {"/w/a"}),
        (INCLUDE.format("lightLink", "</w>"), ALL, ALL),
        ('uniform bool collection:lightLink:includeRoot = 0\npathExpression collection:lightLink:membershipExpression = "/w/[bc]"',
            {"/w/b", "/w/c"}, ALL),
    ],
)  # fmt: skip
def test_the_members_of_a_light_s_collections(tmp_path, links, receivers, blockers):
    scene, messages = read(tmp_path, STAGE.replace("LINKS", links))
    assert (messages, *sets(scene)) == ([], receivers, blockers)
    assert light_links.are_there(scene.tables) == ((receivers, blockers) != (ALL, ALL))


def test_equal_sets_share_a_bit(tmp_path):
    more = 'def RectLight "r" { LINKS }'.replace("LINKS", EXCLUDE.format("lightLink", "</w/b>"))
    scene, _ = read(tmp_path, STAGE.replace("LINKS", EXCLUDE.format("lightLink", "</w/b>")) + more)
    assert np.unique(scene.tables.lights.receivers).tolist() == [light_links.FIRST_SET]


def test_an_instancer_is_linked_as_a_whole(tmp_path):
    text = """def PointInstancer "pi" {
        int[] protoIndices = [0, 0]
        point3f[] positions = [(4, 0, 0), (8, 0, 0)]
        rel prototypes = </pi/p>
        def Cube "p" {} }"""
    scene, messages = read(tmp_path, STAGE.replace("LINKS", INCLUDE.format("lightLink", "</pi>")) + text)
    assert (messages, sets(scene)[0]) == ([], {"/pi[0]", "/pi[1]"})


def test_many_sets(tmp_path):
    """Sets beyond the last bit count as all, with a warning."""
    cubes = "\n".join(f'def Cube "c{k}" {{}}' for k in range(30))
    lights = "\n".join(f'def SphereLight "l{k}" {{ {EXCLUDE.format("lightLink", f"</c{k}>")} }}' for k in range(30))
    scene, messages = read(tmp_path, f"{cubes}\n{lights}")
    assert messages == ["warning: the lights have more than 26 different sets of light links: the rest is left out"] * 4
    assert (scene.tables.lights.receivers == light_links.EVERYTHING).sum() == 4


def test_a_mesh_light_has_no_links(tmp_path):
    text = f'def Mesh "m" (prepend apiSchemas=["MeshLightAPI"]) {{ {SQUARE}\n{EXCLUDE.format("lightLink", "</w/b>")} }}'
    expected = "mesh lights light every prim, and every prim casts their shadows: their links are not drawn"
    assert f"x.usda</m>: warning: {expected}" in read(tmp_path, STAGE.replace("LINKS", "") + text)[1]


def collections(prim: str, count: int, cyclic: bool) -> str:
    """Collections a0, a1, … of a prim, each of which includes the next two; the last ones include </w/a>."""
    lines = []
    for k in range(count):
        steps = [k + 1, k + 2]
        others = [f"<{prim}.collection:a{j % count}>" for j in steps if cyclic or j < count] or ["</w/a>"]
        lines.append(f"rel collection:a{k}:includes = [{', '.join(others)}]")
    return "\n".join(lines)


def applied(count: int, *more: str) -> str:
    names = [*more, *(f"CollectionAPI:a{k}" for k in range(count))]
    return "(prepend apiSchemas = [" + ", ".join(f'"{name}"' for name in names) + "])"


@pytest.mark.parametrize(("cyclic", "others"), [(True, "itself by way of others"), (False, "others more than 10,000 times")])
def test_collections_that_multiply_are_left_out(tmp_path, cyclic, others):
    links = collections("/l", 40, cyclic) + "\n" + INCLUDE.format("lightLink", "</l.collection:a0>")
    stage = STAGE.replace('"l"', f'"l" {applied(40)}').replace("LINKS", links)
    scene, messages = read(tmp_path, stage)
    assert sets(scene) == (ALL, ALL)
    assert messages == [f"x.usda</l>: warning: the collection `/l.collection:lightLink` includes {others}: it is left out"]
    bound = "rel material:binding = </red>\nrel material:binding:collection:x = [</g.collection:a0>, </blue>]\n"
    bound += collections("/g", 40, cyclic)
    text = f"""def Xform "g" {applied(40, "MaterialBindingAPI")} {{ {bound}
def Sphere "s" {{}}
}}
def Xform "w" {{ def Cube "a" {{}} }}
def Material "red" {{}}
def Material "blue" {{}}
"""
    scene, messages = read(tmp_path, text)
    assert messages[0] == f"x.usda</g>: warning: the collection `/g.collection:a0` includes {others}: it is left out"
    assert messages[1:] == ["x.usda</red>: warning: the material has no surface: its prims show their displayColor"]


def test_collections_of_collections_are_expanded(tmp_path):
    links = collections("/l", 5, False) + "\n" + INCLUDE.format("lightLink", "</l.collection:a0>")
    scene, messages = read(tmp_path, STAGE.replace('"l"', f'"l" {applied(5)}').replace("LINKS", links))
    assert messages == []
    assert sets(scene) == ({"/w/a"}, ALL)
