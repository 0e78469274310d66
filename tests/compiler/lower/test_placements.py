"""Frames of placed elements: sums of translations have the bits of products of matrices."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.compiler.lower import placements
from maquette.compiler.scene import transforms
from maquette.lang.elements import AxisAngle

lengths = st.one_of(st.sampled_from([0.0, -0.0, 1e-300, 1e18]), st.floats(-100, 100))
moves = st.tuples(lengths, lengths, lengths)
turns = st.builds(
    lambda move, axis, angle, scale: transforms.place(move, AxisAngle(axis, angle), scale),
    moves, st.sampled_from([(0.0, 1.0, 0.0), (1.0, 2.0, 3.0)]), st.floats(-3, 3), st.sampled_from([None, (1.0, 2.0, -0.5)]),
)  # fmt: skip
frames = st.one_of(moves, turns)


@settings(deadline=None)
@given(st.lists(frames, min_size=1, max_size=5), st.lists(frames, min_size=1, max_size=4))
def test_frames_compose_as_their_matrices(outer: list[placements.Frame], inner: list[placements.Frame]) -> None:
    expected, frame = np.eye(4), placements.ORIGIN
    for each in outer:
        expected, frame = expected @ placements.matrix(each), placements.compose(frame, each)
    assert (placements.matrix(frame) + 0.0).tobytes() == (expected + 0.0).tobytes()
    placed = placements.products([frame] * len(inner), inner)
    for each, matrix in zip(inner, placed, strict=True):
        assert (matrix + 0.0).tobytes() == ((expected @ placements.matrix(each))[:3] + 0.0).tobytes()
