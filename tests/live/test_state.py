"""State that pages set: fields are checked, texts are kept by file."""

from __future__ import annotations

import pytest
from maquette.live.state import Pose, State, StateError

POSE = {"position": [0, 1, 2], "look_at": [0, 0, 0], "up": [0, 1, 0]}


def test_a_change_keeps_the_rest() -> None:
    state = State().changed({"sets": {"a": "1", "b": "2"}, "exposure": -2})
    state = state.changed({"sets": {"a": None, "c": "3"}, "pose": POSE})
    assert state == State(sets={"b": "2", "c": "3"}, exposure=-2.0, pose=Pose((0.0, 1.0, 2.0), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0)))


def test_plain_data_changes_to_the_same_state() -> None:
    state = State(sets={"a": "1"}, camera="left", backend="ray", exposure=1.5, channel="depth", moment=3.0).changed({"pose": POSE})
    given = state.to_json()
    given["pose"] = {name: list(value) if isinstance(value, tuple) else value for name, value in given["pose"].items()}
    assert State().changed(given) == state


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"color": 1}, "a state has no `color`"),
        ({"sets": []}, "`sets` are values by name"),
        ({"sets": {"a": 1}}, "a value of a param is a text"),
        ({"exposure": "1"}, "expected a number, got '1'"),
        ({"exposure": float("nan")}, "expected a number, got nan"),
        ({"exposure": 65}, "an exposure is at most 64 stops"),
        ({"backend": "gpu"}, "there is no backend 'gpu'"),
        ({"channel": "alpha"}, "there is no channel 'alpha'"),
        ({"pose": {"position": [0, 0, 0]}}, "a pose has position, look_at and up"),
        ({"pose": {**POSE, "up": [0, 1]}}, "expected three numbers, got [0, 1]"),
        ({"pose": {**POSE, "extent": 0}}, "an extent is more than 0"),
        ({"moment": True}, "expected a number, got True"),
    ],
)
def test_a_wrong_field_is_refused(given: dict[str, object], message: str) -> None:
    with pytest.raises(StateError) as caught:
        State().changed(given)
    assert str(caught.value) == message


def test_unsaved_texts() -> None:
    state = State().with_text("/a", "1").with_text("/b", "2").with_text("/a", None)
    assert state.texts == {"/b": "2"}
    with pytest.raises(StateError) as caught:
        state.with_text("/b", "x" * (4 << 20) + "x")
    assert str(caught.value) == "the text has 4,194,305 characters, more than 4,194,304"
