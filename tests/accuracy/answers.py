"""The table of known answers, from what the tests themselves measured: rows gathered while they run, and the page as Markdown.

    MAQUETTE_ACCURACY=build/answers MAQUETTE_PLACES=build/places pytest tests/accuracy tests/stability --long    writes JSON files
    python tests/accuracy/answers.py build/answers build/places                                                  prints docs/accuracy.md
"""

from __future__ import annotations

import json
import math
import re
import sys
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

LAST = 40  # oracles there are
PAGE = Path(__file__).resolve().parent.parent.parent / "docs" / "accuracy.md"
INTRO = """# Accuracy

`make accuracy` writes both tables from measurements of the tests. Each row is an assertion with its bound.
The first table compares closed-form answers with pictures and functions, on all backends that support them. It shows the worst of
several settings. The second table shows where common methods fail, with the results of such a method and of maquette.

✓ holds · ✗ fails today, as an expected failure · ○ waits for a feature

## Known answers

Each figure is the measured error, relative to the answer unless a unit is given, with its bound in brackets.

- Where every pixel can be exact the bound is at most 10⁻⁵, as pictures are float32.
- Means over random samples may be off by four standard errors.
- A larger bound has its reason in the last column or in the test, as that rays of a weight below 10⁻⁴ end.
- `ray`, `raster` and `reference` are pictures of these backends. A backend that is not named does not support it: by default `raster`
  traces no reflected, refracted or diffuse rays.
- `functions` are the renderer's own functions, called in double precision. `quadrature` integrates them.
- u is 2⁻⁵³, the rounding of double precision. R is a radius.

"""
PLACES = """
## Failure cases

"""


@dataclass(frozen=True, slots=True)
class Answer:
    """One known answer as a test met it. `backend` may also be "functions" or "quadrature"; `outcome` is pytest's."""

    number: int
    name: str
    backend: str
    error: float
    bound: float
    unit: str = ""
    note: str = ""
    waits: str = ""
    test: str = ""
    outcome: str = ""


@dataclass(slots=True)
class Answers:
    """What the fixture `measured` gives a test."""

    test: str
    rows: list[Answer] = field(default_factory=list)

    def answer(self, number: int, name: str, backend: str, error: float, bound: float, unit: str = "", note: str = "") -> None:
        """Keep what was measured against a known answer, and assert that it is within its bound."""
        assert 1 <= number <= LAST
        self.rows.append(Answer(number, name, backend, float(error), float(bound), unit, note, test=self.test))
        assert error <= bound, f"{number}, {name}, {backend}: {error:.3g} is more than {bound:.3g}"

    def waits(self, number: int, name: str, feature: str) -> None:
        """Give an answer that today's features do not reach its place and name."""
        assert 1 <= number <= LAST
        self.rows.append(Answer(number, name, "", 0.0, 0.0, waits=feature, test=self.test))


def ended(rows: list[Answer], outcome: str) -> list[Answer]:
    """The rows of a test that has ended; one that fails as expected does so at its last."""
    return [replace(row, outcome=outcome if row is rows[-1] else "passed") for row in rows]


def write(rows: list[Answer], path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps([asdict(row) for row in rows], ensure_ascii=False, indent=1) + "\n", encoding="utf-8")


def read(folder: Path) -> list[Answer]:
    """All rows of a run by number and name; for each backend the one nearest to its bound, or beyond it most."""
    found: dict[tuple[int, str, str], Answer] = {}
    for path in sorted(folder.glob("*.json")):
        for row in (Answer(**row) for row in json.loads(path.read_text(encoding="utf-8"))):
            key = (row.number, row.name, row.backend)
            if key not in found or _strain(row) > _strain(found[key]):
                found[key] = row
    return sorted(found.values(), key=lambda row: (row.number, row.name, row.backend))


def _strain(row: Answer) -> float:
    return row.error / row.bound if row.bound > 0.0 else math.inf if row.error > 0.0 else 0.0


def table(rows: list[Answer]) -> str:
    """The rows as a table in Markdown, a line an answer."""
    lines = ["| no. | known answer | backend: measured (bound) | holds |\n|--:|---|---|---|\n"]
    names = dict.fromkeys((row.number, row.name) for row in rows)
    for number, name in names:
        here = [row for row in rows if (row.number, row.name) == (number, name)]
        note = next((row.note for row in here if row.note), "")
        if here[0].waits:
            lines.append(f"| {number} | {_cell(name)} | | ○ waits for {_cell(here[0].waits)} |\n")
            continue
        alike: dict[str, list[str]] = {}
        for row in here:
            alike.setdefault(f"{_figure(row.error)} ({_figure(row.bound)}){row.unit and ' ' + row.unit}", []).append(row.backend)
        cells = "; ".join(f"{', '.join(backends)}: {figures}" for figures, backends in alike.items())
        failed = {row.outcome for row in here} - {"passed"}
        state = "✗" if failed == {"xfailed"} else "**failed**" if failed else "✓"
        lines.append(f"| {number} | {_cell(name)} | {_cell(cells)} | {f'{state} {_cell(note)}'.rstrip()} |\n")
    return "".join(lines)


def listed(page: str) -> set[tuple[int, str, str]]:
    """(number, name, backend) of each answer on a page; the backend is "" where it waits."""
    found: set[tuple[int, str, str]] = set()
    for line in page.partition(PLACES)[0].splitlines():
        cells = [cell.strip().replace("\\|", "|") for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if len(cells) == 4 and cells[0].isdecimal():
            groups = [part.partition(":")[0] for part in cells[2].split("; ")]
            found |= {(int(cells[0]), cells[1], backend) for group in groups for backend in group.split(", ")}
    return found


def _figure(x: float) -> str:
    """Two digits; what is less than double precision holds is 0 to anybody."""
    return "0" if abs(x) < 1e-16 else re.sub(r"e([+-])0", r"e\1", f"{x:.2g}").replace("e-", "e−")


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def page(rows: list[Answer], places: str) -> str:
    """docs/accuracy.md: both tables."""
    return INTRO + table(rows) + PLACES + places


def main(answers: str, folder: str) -> None:
    """Print the page of two folders of rows."""
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
    from stability import places

    sys.stdout.write(page(read(Path(answers)), places.table(places.read(Path(folder)))))


if __name__ == "__main__":
    main(*sys.argv[1:3])
