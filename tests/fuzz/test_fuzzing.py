"""No damaged file ends the parser, the evaluator or a reader: kept findings, and new inputs."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from . import fuzzing

COUNT = int(os.environ.get("MAQUETTE_FUZZ", "500"))  # inputs of each kind


@pytest.mark.parametrize("path", sorted(fuzzing.CORPUS.iterdir()), ids=lambda path: path.name)
def test_kept_findings_stay_mended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    read = fuzzing.reader(path.suffix.removeprefix("."), tmp_path)
    assert fuzzing.execute(read, path.read_bytes()) == ""


@pytest.mark.long
@pytest.mark.parametrize("kind", fuzzing.KINDS)
def test_damaged_files_are_refused_with_a_message(kind: str) -> None:
    """MAQUETTE_FUZZ inputs of each kind; `python tests/fuzz/fuzzing.py` takes a time instead."""
    number, finding, last = fuzzing.fuzz(kind, 3600.0, COUNT, 1)
    assert (number, finding) == (COUNT, ""), last[:200]


def test_a_fault_of_a_reader_is_found(tmp_path: Path) -> None:
    def read(data: bytes) -> object:
        return {}[data]

    assert fuzzing.execute(read, b"x").strip().endswith("KeyError: b'x'")
