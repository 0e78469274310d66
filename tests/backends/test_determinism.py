"""Pictures are equal bit for bit with any number of threads, in parts or whole, and repeated; another seed differs."""

from __future__ import annotations

import numpy as np
import pytest

from . import scenes

SCENE = scenes.SOFT["area lights"]
GLASS = scenes.RAYS["glass"]


def _same(a, b) -> bool:
    return all(np.array_equal(a.channels[k], b.channels[k]) for k in a.channels) and a.channels.keys() == b.channels.keys()


@pytest.mark.long
@pytest.mark.parametrize("text", [SCENE, GLASS], ids=["area lights", "glass"])
def test_any_number_of_threads_draws_the_same(draw, text):
    pictures = [draw(text, size=(70, 40), samples=2, threads=n, aov=("depth", "id")) for n in (1, 2, 5)]
    assert _same(pictures[0], pictures[1])
    assert _same(pictures[0], pictures[2])


@pytest.mark.long
def test_an_asked_error_draws_the_same_on_any_number_of_threads(draw, backend):
    size = (40, 40) if backend == "reference" else (70, 70)
    pictures = [draw(SCENE, size=size, samples=None, error=0.2, threads=n) for n in (1, 5)]
    assert _same(*pictures)
    assert pictures[0].metadata["samples"] == pictures[1].metadata["samples"]


@pytest.mark.long
def test_a_crop_is_a_part_of_the_whole(draw):
    whole = draw(SCENE, size=(70, 40), samples=2, aov=("depth", "normal"))
    part = draw(SCENE, size=(70, 40), samples=2, aov=("depth", "normal"), crop=(13, 5, 51, 37))
    for name, values in part.channels.items():
        assert np.array_equal(values, whole.channels[name][5:37, 13:51]), name
    assert (part.width, part.height) == (38, 32)


@pytest.mark.long
def test_the_same_seed_gives_the_same_and_another_another(draw):
    a, b, c = (draw(SCENE, samples=2, seed=seed) for seed in (3, 3, 4))
    assert _same(a, b)
    different = np.any(a.channels["rgba"][..., :3] != c.channels["rgba"][..., :3], axis=-1)
    assert different.mean() > 0.3


def test_one_sample_is_the_centre_whatever_the_seed_and_filter(draw):
    text = scenes.DIRECT["every shape"]
    a, b = draw(text, seed=3, filter="box"), draw(text, seed=4, filter="gaussian")
    assert _same(a, b)
