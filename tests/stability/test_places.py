"""The table of failure cases: rows to Markdown and back from files."""

from __future__ import annotations

import pytest

from . import places

ROWS = [
    places.Row(5, "a | b", "NaN", "0 of 9", "0", test="t", outcome="passed"),
    places.Row(5, "c", "missed", "off by 1", "0", "fails: because", "t", "xfailed"),
    places.Row(30, "d", "missed", "waits for `implicit`", "0", "said today", "t", "passed"),
    places.Row(31, "e", "missed", "off by 2", "0", "", "t", "failed"),
]


def test_a_table():
    assert places.table(ROWS) == (
        "| | place | the naive method | maquette | bound | |\n|--:|---|---|---|---|---|\n"
        "| 5 | a \\| b | NaN | 0 of 9 | 0 | ✓ |\n"
        "| 5 | c | missed | off by 1 | 0 | ✗ fails: because |\n"
        "| 30 | d | missed | waits for `implicit` | 0 | ○ said today |\n"
        "| 31 | e | missed | off by 2 | 0 | **failed** |\n"
    )


def test_rows_of_all_workers_are_read_in_order(tmp_path):
    places.write(ROWS[2:], tmp_path / "gw0.json")
    places.write(ROWS[:2], tmp_path / "gw1.json")
    assert places.read(tmp_path) == ROWS


def test_a_place_has_a_number_both_measurements_and_a_bound():
    made = places.Places("t")
    made.place(50, "x", naive="y", ours="z", bound="w")
    assert places.ended(made.rows, "passed") == [places.Row(50, "x", "y", "z", "w", "", "t", "passed")]
    for number, naive in ((0, "y"), (51, "y"), (50, "")):
        with pytest.raises(AssertionError):
            made.place(number, "x", naive=naive, ours="z", bound="w")
