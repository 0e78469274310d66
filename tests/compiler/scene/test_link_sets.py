"""Light links by names in a scene: patterns, sets that share a bit, names that are not there."""

import numpy as np
import pytest
from maquette.compiler.ir import light_links

TEXT = """
sphere(1, name: "ball")
group(name: "cart") { box(1, name: "body")
  sphere(0.2, name: "wheel") }
plane(y: -1, name: "floor")
camera([0, 1, 5])
"""
EVERY = ["ball", "cart/body", "cart/wheel", "floor"]


def members(scene, of: str, light: int = 0) -> list[str]:
    t = scene.tables
    return np.array(scene.names.instances)[t.instances.visible & getattr(t.lights, of)[light] != 0].tolist()


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ('["ball"]', ["ball"]),
        ('["cart"]', ["cart/body", "cart/wheel"]),
        ('["*l*"]', ["ball", "cart/wheel", "floor"]),
        ('["cart", "!cart/wheel"]', ["cart/body"]),
        ('["!floor"]', ["ball", "cart/body", "cart/wheel"]),
        ("[]", []),
        ('["*"]', EVERY),
    ],
)
@pytest.mark.parametrize("of", ["receivers", "blockers"])
def test_names(compiled, names, expected, of):
    scene = compiled(f"point([0, 5, 0], {of}: {names})" + TEXT)
    assert members(scene, of) == expected
    assert members(scene, "blockers" if of == "receivers" else "receivers") == EVERY
    assert light_links.are_there(scene.tables) == (expected != EVERY)


def test_equal_sets_share_a_bit(compiled):
    lights = 'point([0, 5, 0], receivers: ["cart"])\nsky(receivers: ["cart/*"], blockers: ["!ball", "!floor"])\n'
    scene = compiled(lights + TEXT)
    assert scene.tables.lights.receivers.tolist() == [light_links.FIRST_SET] * 2
    assert scene.tables.lights.blockers.tolist() == [light_links.CASTERS, light_links.FIRST_SET]


def test_a_name_that_is_not_there(said):
    text = 'point([0, 5, 0], receivers: ["bal"])' + TEXT
    assert said(text).splitlines()[0] == "a.scene:1:1: error: no instance is called `bal`; did you mean `ball`?"


def test_skies_share_their_blockers(said):
    text = 'sky(blockers: ["ball"])\ndome(pattern: |x, y, z| y, blockers: ["floor"])' + TEXT
    assert "warning: all skies of a scene have the same blockers: those of the first count" in said(text)


def test_shapes_cast_evenly_without_links(compiled):
    scene = compiled("point([0, 5, 0])" + TEXT)
    assert not light_links.casts_unevenly(scene.tables).any()
    linked = compiled('point([0, 5, 0], blockers: ["cart"])' + TEXT)
    assert np.array(linked.names.instances)[light_links.casts_unevenly(linked.tables)].tolist() == ["ball", "floor"]
