"""Light groups, variance and numbers of samples, on every backend."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.compiler.plan import plan as planner

from . import scenes
from .views import rgb

KEY = "point([3, 5, 4], intensity: 60KEY)\n"
FILL = "directional(from: [-1, 2, 1], illuminance: 1, color: #80a0ffFILL)\n"
REST = "ambient(#ffffff, luminance: 0.1)\n"
THINGS = scenes.CAMERA + scenes.FLOOR + scenes.SHAPES


def lit(*lights: str) -> str:
    return THINGS + "".join(lights).replace("KEY", ', group: "key"').replace("FILL", ', group: "fill"')


@pytest.mark.long
def test_groups_add_up_to_the_picture_exactly(draw_on, backend):
    image = draw_on(backend, lit(KEY, FILL, REST), samples=4, aov=("lights", "depth"))
    names = sorted(name for name in image.channels if name.startswith("light:"))
    assert names == ["light:fill", "light:key", "light:rest"]
    total = np.zeros_like(image.channels["rgba"][..., :3])
    for name in names:
        assert image.channels[name].max() > 0.0
        total += image.channels[name]
    assert np.array_equal(total, image.channels["rgba"][..., :3])
    whole = draw_on(backend, lit(KEY, FILL, REST), samples=4, aov=("variance",))  # not in bands
    assert rgb(image) == pytest.approx(rgb(whole), abs=1e-5)


@pytest.mark.long
def test_a_group_is_the_picture_of_its_lamps(draw_on, backend):
    """Without random numbers, pictures are equal except for rounding."""
    image = draw_on(backend, lit(KEY, FILL, REST), samples=4, aov=("lights",), plan={"noise": "white"})
    alone = draw_on(backend, lit(FILL), samples=4, aov=("variance",), plan={"noise": "white"})  # not in bands, whose samples lie elsewhere
    assert image.channels["light:fill"] == pytest.approx(alone.channels["rgba"][..., :3], abs=1e-6)


@pytest.mark.long
def test_one_group_alone_and_shapes_that_shine(draw_on, tracer):
    """Emissive objects belong to the rest; an area light's shape belongs to its group."""
    text = scenes.CAMERA + scenes.FLOOR + "sphere(0.4, center: [1, 0.5, 0], material: emissive(#ff8040))\n"
    text += 'area([-1, 1, -1], look_at: [0, 1, 5], size: [0.8, 0.8], luminance: 3, color: #00ff00, group: "panel")\n'
    image = draw_on(tracer, text, samples=4, aov=("light:panel",))
    assert [name for name in image.channels if name.startswith("light:")] == ["light:panel"]
    panel = image.channels["light:panel"]
    assert panel[..., 1].max() == pytest.approx(3.0)
    assert not panel[..., [0, 2]].any()
    rest = image.channels["rgba"][..., :3] - panel
    assert rest[..., 0].max() == pytest.approx(1.0)
    assert rest[..., 1].max() < 1.0


@pytest.mark.long
def test_variance_and_samples(draw_on, backend):
    """With many samples the mean variance equals that across seeds; sample counts are as requested."""
    text = scenes.CAMERA + scenes.FLOOR + "box([0.8, 1.5, 0.8], center: [0, 0.75, 0])\n"
    text += "area([1, 3, 2], look_at: [0, 0, 0], size: [1, 1], luminance: 4)\n"
    asked = {"samples": 16, "size": (24, 24), "aov": ("variance", "samples")}
    seeds = [draw_on(backend, text, {"noise": "white"}, seed=seed, **asked) for seed in range(12)]
    told = np.mean([image.channels["variance"] for image in seeds])
    true = np.mean(np.var([rgb(image) for image in seeds], axis=0, ddof=1))
    assert 0.6 < told / true < 2.0
    assert np.all(seeds[0].channels["samples"] == 16)


def test_groups_that_are_not_there(draw_on):
    with pytest.raises(planner.PlanError, match="no light has the group `kye`; there are fill, key, rest"):
        draw_on("ray", lit(KEY, FILL), aov=("light:kye",))
    with pytest.raises(planner.PlanError, match="one sample has no variance: write --samples 2 or more"):
        draw_on("ray", lit(KEY, FILL), samples=1, aov=("variance",))
