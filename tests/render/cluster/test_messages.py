"""Messages keep numbers of samples, scenes and pictures."""

from __future__ import annotations

from dataclasses import replace

import maquette
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from maquette.compiler.scene import serialize
from maquette.render import packing
from maquette.render.cluster import messages
from maquette.render.film.bounce_error import Cut
from maquette.render.image.image import Image

SCENE = """param height = 1
sphere(center: [0, height, 0], material: lambert(checker(#d0402a, #ffffff, size: 0.1)))
plane(material: lambert(#e8e8e8))
point([2, 4, 3], intensity: 20, group: "key")
camera(position: [0, 1.6, 5], look_at: [0, 1, 0], fov: 35deg)
"""


@pytest.mark.long
@given(arrays.arrays(np.int64, (3, 4), elements=st.integers(0, 3)))
def test_numbers_of_samples_are_one_number_if_they_are_equal(counts: np.ndarray) -> None:
    about, sent = messages.counts_to("n", counts)
    assert bool(sent) == (len(np.unique(counts)) > 1)
    np.testing.assert_array_equal(messages.counts_from("n", (3, 4), about, sent), counts)


def test_a_parcel_keeps_the_scene_without_source_positions() -> None:
    scene = maquette.load_text(SCENE)
    parcel = messages.parcel(scene)
    again = messages.scene_from(parcel.rows, parcel.arrays)
    assert serialize.content_hash(again) == serialize.content_hash(scene)
    assert again.spans.rows == {}


def test_parcels_share_what_is_equal() -> None:
    scene = maquette.load_text(SCENE)
    first, again = messages.parcel(scene), messages.parcel(replace(scene, files=("elsewhere.scene",)))
    assert first.key == again.key
    moved = messages.parcel(maquette.load_text(SCENE.replace("height = 1", "height = 2")))
    assert moved.key != first.key
    changed = set(moved.arrays) - set(first.arrays)
    names = {name for name, digest, _, _ in moved.rows if digest in changed}
    assert "transforms.matrix" in names
    assert not names & {"materials.values", "lights.position", "cameras.transform"}


def test_a_picture_keeps_channels_and_metadata() -> None:
    channels = {"rgba": np.random.default_rng(1).random((3, 4, 4), np.float32), "depth": np.full((3, 4, 1), np.inf, np.float32)}
    metadata = {
        "size": (4, 3), "crop": (0, 0, 4, 3), "samples": 4, "error": 0.25, "partial": False, "notes": [("text", "lights", 1)],
        "cut": Cut(0.5, 0.25, 0.02, 8), "seconds": {"build": 1.5}, "variance": np.zeros((3, 4, 3)), "unproved": 0,
    }  # fmt: skip
    again = messages.image_from(*packing.unpack(packing.pack(*messages.image_to(Image(4, 3, channels, metadata)))))
    assert (again.width, again.height) == (4, 3)
    assert again.metadata == {**metadata, "variance": None, "half_difference": None}
    for name, array in channels.items():
        np.testing.assert_array_equal(again.channels[name], array)
        assert again.channels[name].flags.writeable
