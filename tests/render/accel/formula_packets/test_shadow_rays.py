"""Shadow packets against formula surfaces: same shadows as single rays."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler import ir, load
from maquette.compiler.plan import plan as planner
from maquette.render import render_scene, types
from maquette.render.accel.formula_packets import camera_rays, shadow_rays
from maquette.render.backends import prepare, ray_packets
from maquette.render.image import image
from maquette.render.jit.packed_struct import Handle

VIEW = "camera(position: [0.3, 1.4, 3], look_at: [0, -0.1, 0], fov: 42deg)\nplane(y: -0.9)\n"
LAMPS = {
    "sun": "directional(from: [-2, 1, 0.5])",
    "bulb": "point([0.2, 0.1, 0.9], intensity: 3)",
    "both, and a soft one": (
        "directional(from: [1, 2, -1])\nsun(from: [2, 1, 2], illuminance: 2, angle: 3deg)\npoint([-1, 1.2, 0.4], intensity: 3)"
    ),
}
OBJECTS = {
    "heart": "implicit(|x, y, z| (x^2 + 2.25 * z^2 + y^2 - 1)^3 <= x^2 * y^3 + 0.1125 * z^2 * y^3, within: 1.5)",
    "torus": "implicit(|x, y, z| (hypot(x, z) - 0.7)^2 + y^2 + 0 * x^4 <= 0.09, within: 1.5)",
    "sheet": "implicit(|x, y, z| y == 0.3 * sin(6 * x) * cos(5 * z), within: 0.8)",
    "steps": "implicit(|x, y, z| y <= 0.2 * floor(4 * x) - 0.1, within: 0.8)",
    "two": (
        "implicit(|x, y, z| x^4 + y^4 + z^4 <= 0.2, within: 1, translate: [-0.7, 0, 0], rotate: [0, 30deg, 20deg])\n"
        "implicit(|x, y, z| x^4 + y^4 + z^4 <= 0.1, within: 1, scale: [1, 2, 1], translate: [0.6, 0.1, 0.3])\n"
        "sphere(0.3, center: [0, 0.9, 0])"
    ),
}


def drawn(tmp_path, text: str, samples: int = 1) -> image.Image:
    path = tmp_path / "hidden.scene"
    path.write_text(text, encoding="utf-8")
    scene = load.load(path)
    return render_scene.draw(scene, planner.make_plan(scene, ir.Settings(size=(72, 64), samples=samples, threads=1, backend="ray")))


@pytest.mark.parametrize("lamps", LAMPS)
@pytest.mark.parametrize("objects", OBJECTS)
def test_packets_give_the_shadows_of_single_rays(tmp_path, monkeypatch, objects, lamps):
    text = VIEW + LAMPS[lamps] + "\n" + OBJECTS[objects]
    by_bundles = drawn(tmp_path, text, 2).channels["rgba"]
    monkeypatch.setattr(prepare.shadow_rays, "select_lights", lambda *arguments: [])
    one_by_one = drawn(tmp_path, text, 2).channels["rgba"]
    assert int((np.abs(by_bundles - one_by_one).max(axis=2) > 1e-6).sum()) <= 2  # where rays graze what they leave


def test_selected_lights(tmp_path):
    """Point lights with shadows; none where no surface is in packets or casts shadows."""
    soft = "ambient(#222222)\nsun(from: [2, 1, 2], illuminance: 2, angle: 3deg)\nsky(luminance: 1)\n"
    sharp = "point([1, 2, 0], intensity: 1, shadows: false)\npoint([1, 2, 0], intensity: 1)\ndirectional(from: [1, 2, -1])\n"
    for text, shadows, expected in (
        (soft + sharp + OBJECTS["heart"], True, [4, 5]),
        (soft + sharp + OBJECTS["heart"], False, []),
        (soft + sharp + "sphere(1)", True, []),
        (soft + OBJECTS["heart"], True, []),
    ):
        path = tmp_path / "lamps.scene"
        path.write_text(VIEW + text, encoding="utf-8")
        scene = load.load(path)
        plan = planner.make_plan(scene, ir.Settings(size=(8, 8), samples=1, backend="ray"))
        options = prepare.options_of(plan, scene.tables)._replace(shadows=shadows)
        assert shadow_rays.select_lights(prepare.build_bvh(scene.tables, plan).tables, scene.tables, options) == expected


def test_hidden_bits_of_a_light(tmp_path):
    """Some points are hidden, some lit, and points that face away have no result."""
    path = tmp_path / "bits.scene"
    path.write_text(VIEW + LAMPS["sun"] + "\n" + OBJECTS["sheet"], encoding="utf-8")
    scene = load.load(path)
    plan = planner.make_plan(scene, ir.Settings(size=(64, 64), samples=1, threads=1, backend="ray"))
    renderer = render_scene.choose_renderer(scene, plan, types.View(0, 64, 64))
    memory, pixels = renderer.packets.memory(), np.ones((64, 64), np.int64)
    film = types.Film(np.zeros((64, 64, 3)), np.zeros((64, 64)), np.zeros((64, 64), np.int64))
    ray_packets.draw_tile(renderer.packets.scene, types.Tile(0, 0, 64, 64), 0 * pixels, pixels, 1, film, memory)
    hits = memory.tables.hits
    is_hit, (light,) = hits.instance >= 0, renderer.prepared.packet_lights
    tested, hidden = (hits.hidden >> 2 * light) & 1 != 0, (hits.hidden >> 2 * light) & 2 != 0
    assert 100 < hidden.sum() < tested.sum() < is_hit.sum()
    assert not (hidden & ~tested).any()
    assert not (tested & ~is_hit).any()


@pytest.mark.parametrize("lamps", [False, True])
def test_tile_hits_have_one_type_for_any_number_of_samples(lamps: bool) -> None:
    """Otherwise each number of samples would compile the tile kernel again."""
    kinds = {Handle(camera_rays.allocate_hits(side, n, lamps, False)).type for side, n in ((64, 0), (64, 7), (128, 70000))}
    assert len(kinds) == 1
