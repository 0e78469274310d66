"""Evaluation errors as printed: each source with its whole messages, in meaning_errors/*.txt.

A case is a source, a line `-----` and what is printed; a line `=====` stands between cases.
"""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from .evaluating import run, unhurried

FILES = sorted((Path(__file__).parent / "meaning_errors").glob("*.txt"))
CASES = [case for file in FILES for case in file.read_text(encoding="utf-8").rstrip("\n").split("\n=====\n")]
SOURCES = [case.partition("\n-----\n")[0] for case in CASES]
WORDS = re.compile(r"\w+|[^\w\s]")


@pytest.mark.parametrize("case", CASES, ids=[case.partition("\n")[0][:40] for case in CASES])
def test_message(case: str) -> None:
    source, _, expected = case.partition("\n-----\n")
    _, messages = run(source)
    assert "\n".join(line.rstrip() for line in "\n".join(messages).split("\n")) == expected


@pytest.mark.long
@unhurried
@given(st.data())
def test_any_word_in_place_of_any_other_gives_a_document_and_messages(data: st.DataObject) -> None:
    source = data.draw(st.sampled_from(SOURCES))
    other = data.draw(st.sampled_from(SOURCES))
    for _ in range(data.draw(st.integers(1, 3))):
        word = data.draw(st.sampled_from(list(WORDS.finditer(source))))
        source = source[: word.start()] + data.draw(st.sampled_from(WORDS.findall(other))) + source[word.end() :]
    document, messages = run(source)
    assert document.name == "a.scene"
    assert all(re.match(r"a\.scene(:\d+:\d+)?: (error|warning): .", m) for m in messages)
