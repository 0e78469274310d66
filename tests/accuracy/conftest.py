"""The fixture by which tests of known answers keep what they measured; MAQUETTE_ACCURACY says where it is written."""

from __future__ import annotations

import os
from collections.abc import Generator, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from . import answers

_ROWS = pytest.StashKey[list[answers.Answer]]()
_FOLDER = "MAQUETTE_ACCURACY"


@cache
def _page() -> set[tuple[int, str, str]]:
    return answers.listed(answers.PAGE.read_text(encoding="utf-8"))


@pytest.fixture
def measured(request: pytest.FixtureRequest) -> Iterator[answers.Answers]:
    """Keeps what a test measured against its known answer, and holds it to its bound; what the page does not list is an error."""
    made = answers.Answers(request.node.nodeid)
    request.node.stash[_ROWS] = made.rows
    yield made
    if not os.environ.get(_FOLDER):
        missing = {(row.number, row.name, row.backend) for row in made.rows} - _page()
        assert not missing, f"`make accuracy` writes these to docs/{answers.PAGE.name}: {sorted(missing)}"


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Generator[None, Any, None]:
    """A test's rows, with how it ended, go to the session's."""
    report = (yield).get_result()
    if report.when == "call" and item.stash.get(_ROWS, None):
        outcome = "xfailed" if hasattr(report, "wasxfail") and report.skipped else report.outcome
        item.session.stash.setdefault(_ROWS, []).extend(answers.ended(item.stash[_ROWS], outcome))


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write the rows where MAQUETTE_ACCURACY says, a file for each worker."""
    folder = os.environ.get(_FOLDER)
    if folder and session.stash.get(_ROWS, None):
        answers.write(session.stash[_ROWS], Path(folder) / f"{os.environ.get('PYTEST_XDIST_WORKER', 'main')}.json")
