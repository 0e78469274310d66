"""The check of pages' messages: whatever comes is either sound or refused with a text."""

from __future__ import annotations

import contextlib
import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.live import page_messages
from maquette.live.state import State, StateError

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**320), 10**320) | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3), max_leaves=8,
)  # fmt: skip
NAMES = ("path", "text", "state", "saved", "force", "names", "x", "y", "line", "boot", "texts")
MESSAGES = st.builds(
    lambda kind, fields: {"type": kind, **fields}, st.sampled_from([*page_messages.KINDS, "none"]) | VALUES,
    st.dictionaries(st.sampled_from(NAMES), VALUES, max_size=4),
)  # fmt: skip


@pytest.mark.long
@settings(max_examples=300, deadline=None)
@given(MESSAGES | VALUES)
def test_messages_are_sound_or_refused(message: Any) -> None:
    with contextlib.suppress(StateError):
        if page_messages.check(page_messages.parsed(json.dumps(message))) == "change":
            State().changed(message["state"])


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=40) | st.binary(max_size=40))
def test_any_text_is_read_or_refused(data: str | bytes) -> None:
    with contextlib.suppress(StateError):
        page_messages.parsed(data)


@pytest.mark.parametrize("kind", page_messages.KINDS)
def test_sound_messages(kind: str) -> None:
    fields = {"path": "a", "text": "b", "state": {}, "x": 0, "y": 0.5, "line": 3, "names": None, "saved": None, "force": True}
    wanted = page_messages.KINDS[kind][0].__annotations__
    assert page_messages.check({"type": kind, **{name: fields[name] for name in wanted if name in fields}}) == kind
