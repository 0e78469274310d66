"""RESULTS.md: the table of a section, which order sections stand in, and that a run replaces its own section alone."""

from __future__ import annotations

from pathlib import Path

import pytest
from maquette.bench import __main__ as command
from maquette.bench import formulas, live, paths, report, start
from maquette.bench.harness import Case, Contender, Result, Seconds, Times

CASES = Case("primary", [], lambda answers: "")
OURS = Times(Contender("maquette", lambda: 0, build=Seconds(0.5, 0.6)), Seconds(1.25, 1.3), (Seconds(0.25, 0.3),) * 3)
PEER = Times(Contender("peer", lambda: 0, note="its mode"), Seconds(0.125, 0.2), (Seconds(0.125, 0.4),) * 3)
RESULT = Result(Case("primary", [], CASES.agree, amount=1e6), (OURS, PEER), "0 of 9 differ")
REFUSED = Result(CASES, refused="7 of 9 differ")


def section(key: str, *results: Result) -> report.Section:
    made = report.Section(key, key.capitalize(), "What is timed.", versions={"peer": "4.2"}, missing=["x is not installed (pip install x)"])
    made.add("One mesh", results, "Mrays/s")
    return made


def test_a_table() -> None:
    (title, table, answers) = section("rays", RESULT).blocks
    assert title == "**One mesh**"
    assert table == (
        "|  |  | CPU, ms | quartiles | wall, ms | Mrays/s | × ours | build, ms | compile, ms | note |\n"
        "| :-- | :-- | --: | --: | --: | --: | --: | --: | --: | :-- |\n"
        "| primary | maquette | 250 | 250 – 250 | 300 | 4 |  | 500 | 1000 |  |\n"
        "|  | peer | 125 | 125 – 125 | 400 | 8 | 0.50 |  | 0 | its mode |"
    )
    assert answers == "Answers. primary: 0 of 9 differ (3 rounds)."


def test_rates_and_ratios_by_the_wall() -> None:
    made = report.Section("start", "Start", "")
    made.add("One picture", [RESULT], "Mrays/s", by="wall")
    assert "| peer | 125 | 125 – 125 | 400 | 2.5 | 1.33 |" in made.blocks[1]


def test_a_peer_alone_has_no_ratio() -> None:
    made = report.Section("start", "Start", "")
    made.add("One picture", [Result(CASES, (PEER,), "nothing to compare")], "")
    assert "× ours" not in made.blocks[1]


def test_answers_that_differ_show_no_numbers() -> None:
    made = section("rays", REFUSED)
    assert made.blocks == ["**One mesh**", "No times for primary: answers differ: 7 of 9 differ."]
    assert made.refused == ["One mesh, primary: 7 of 9 differ"]


def test_a_section_says_where_and_with_what_it_was_measured() -> None:
    text = report.render(section("rays", RESULT), "2026-01-01, a machine").splitlines()
    assert text[:4] == ["<!-- section rays -->", "## Rays", "", "What is timed."]
    assert text[5].startswith("2026-01-01, a machine. maquette ")
    assert text[5].endswith(", peer 4.2.")
    assert text[7] == "Not measured: x is not installed (pip install x)."


@pytest.mark.long
def test_sections_are_replaced_and_keep_their_order(tmp_path: Path) -> None:
    path = tmp_path / "RESULTS.md"
    for key in ("start", "zebra", "rays", "raster"):
        report.write(section(key, RESULT), path, machine="old machine")
    before = path.read_text(encoding="utf-8")
    assert [line for line in before.splitlines() if line.startswith("## ")] == ["## Rays", "## Raster", "## Start", "## Zebra"]
    report.write(section("raster", RESULT), path, machine="new machine")
    after = path.read_text(encoding="utf-8")
    assert after.count("new machine") == 1
    parts = report.read(path)
    assert "new machine" in parts["raster"]
    assert after.replace("new machine", "old machine") == before
    report.write(section("raster", RESULT), path, machine="old machine")
    assert path.read_text(encoding="utf-8") == before
    assert before.startswith(report.HEAD)


def test_the_machine_is_named() -> None:
    line = report.machine_line()
    assert " of " in line
    assert " cores, load " in line
    assert ", Python 3." in line


def test_a_part_measured_anew_leaves_the_others(tmp_path: Path) -> None:
    path = tmp_path / "RESULTS.md"
    for machine, names in (("old machine", ("1 box", "2 knot")), ("new machine", ("2 knot",))):
        whole = report.Section("paths", "Paths", "What is timed.")
        whole.parts = [report.Section(f"paths {name}", name, "", blocks=["**Rate**"], level=3) for name in names]
        report.write(whole, path, machine=machine)
    parts = report.read(path)
    assert list(parts) == ["paths", "paths 1 box", "paths 2 knot"]
    assert "### 1 box\n\nold machine" in parts["paths 1 box"]
    assert "### 2 knot\n\nnew machine" in parts["paths 2 knot"]


def test_parts_are_those_that_the_command_names() -> None:
    assert command.SECTION_PARTS == {"paths": paths.NAMES, "formulas": formulas.NAMES, "start": start.NAMES, "live": live.NAMES}
