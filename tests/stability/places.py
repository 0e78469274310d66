"""The table of failure cases, from measurements of the tests: rows gathered in a run, and the table as Markdown.

    MAQUETTE_PLACES=build/places pytest tests/stability      writes a JSON file for each worker
    python tests/stability/places.py build/places            prints the table
"""

from __future__ import annotations

import json
import sys
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import pytest

HEAD = "| | place | the naive method | maquette | bound | |\n|--:|---|---|---|---|---|\n"


def fails(reason: str) -> pytest.MarkDecorator:
    """A test that fails today, for this reason, by one of its assertions and no other way; when it holds, the mark must go."""
    return pytest.mark.xfail(strict=True, raises=AssertionError, reason=reason)


@dataclass(frozen=True, slots=True)
class Row:
    """One place as a test found it. `outcome` is pytest's: passed, xfailed (fails as expected) or failed."""

    number: int
    name: str
    naive: str
    ours: str
    bound: str
    note: str = ""
    test: str = ""
    outcome: str = ""


@dataclass(slots=True)
class Places:
    """What the fixture `measured` gives a test: `place` keeps a row, whatever becomes of the test afterwards."""

    test: str
    rows: list[Row] = field(default_factory=list)

    def place(self, number: int, name: str, *, naive: str, ours: str, bound: str, note: str = "") -> None:
        """Say what the naive method does at a failing place, what ours does, and the bound it is held to; all in words and figures."""
        assert 1 <= number <= 50
        assert all((name, naive, ours, bound)), "every place has a name, both measurements and a bound"
        self.rows.append(Row(number, name, naive, ours, bound, note, self.test))


def ended(rows: list[Row], outcome: str) -> list[Row]:
    """The rows of a test that has ended."""
    return [replace(row, outcome=outcome) for row in rows]


def write(rows: list[Row], path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps([asdict(row) for row in rows], ensure_ascii=False, indent=1) + "\n", encoding="utf-8")


def read(folder: Path) -> list[Row]:
    """All rows of a run, by number; of a test that measured twice under one name, the last."""
    every = [Row(**row) for path in sorted(folder.glob("*.json")) for row in json.loads(path.read_text(encoding="utf-8"))]
    found = {(row.number, row.name): row for row in every}
    return sorted(found.values(), key=lambda row: (row.number, row.outcome == "xfailed", row.name))


def table(rows: list[Row]) -> str:
    """The rows as a table in Markdown. What fails as expected is marked ✗, what waits for a feature ○, what holds ✓."""
    lines = []
    for row in rows:
        cells = (str(row.number), row.name, row.naive, row.ours, row.bound, _state(row))
        lines.append(f"| {' | '.join(map(_cell, cells))} |\n")
    return HEAD + "".join(lines)


def _state(row: Row) -> str:
    mark = {"passed": "✓", "xfailed": "✗"}.get(row.outcome, f"**{row.outcome}**")
    return f"{'○' if row.ours.startswith('waits for ') else mark} {row.note}".strip()


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


if __name__ == "__main__":
    sys.stdout.write(table(read(Path(sys.argv[1]))))
