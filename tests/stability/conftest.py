"""Shared by the failure cases: load a text, draw it on a backend, and record measurements."""

from __future__ import annotations

import os
from collections.abc import Callable, Generator, Mapping
from pathlib import Path
from typing import Any

import maquette
import numpy as np
import pytest
from maquette.compiler import ir
from maquette.lang.diagnostics import Diagnostics
from maquette.render.image.image import Image

from . import places

EXPECTED = ("there is nothing to draw: ", "the camera ", "two shapes ")  # begin messages of scenes that are meant so


@pytest.fixture
def load(tmp_path: Path) -> Callable[[str], tuple[ir.Scene, list[str]]]:
    """A scene of a text, files beside it, and what was said about it."""

    def run(text: str) -> tuple[ir.Scene, list[str]]:
        path = tmp_path / "a.scene"
        path.write_text(text, encoding="utf-8")
        found = Diagnostics()
        scene = maquette.load(path, diagnostics=found)
        return scene, [d.message for d in found.items if not d.message.startswith(EXPECTED)]

    return run


@pytest.fixture
def draw(load: Callable[[str], tuple[ir.Scene, list[str]]]) -> Callable[..., Image]:
    """A picture of a text on a backend; 48 by 48 pixels and one sample at each pixel's centre if not said. All of it is finite."""

    def run(text: str, backend: str, plan: Mapping[str, str] | None = None, **settings: Any) -> Image:
        image = maquette.render(load(text)[0], plan=plan, **{"size": (48, 48), "samples": 1, "threads": 1, **settings, "backend": backend})
        assert image.metadata["issues"] == 0
        assert np.isfinite(image.channels["rgba"]).all()
        return image

    return run


_ROWS = pytest.StashKey[list[places.Row]]()
_FOLDER = "MAQUETTE_PLACES"


@pytest.fixture
def measured(request: pytest.FixtureRequest) -> places.Places:
    """Keeps what a test measured at its failing place, for the table."""
    made = places.Places(request.node.nodeid)
    request.node.stash[_ROWS] = made.rows
    return made


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> Generator[None, Any, None]:
    """A test's rows, with how it ended, go to the session's."""
    report = (yield).get_result()
    if report.when == "call" and item.stash.get(_ROWS, None):
        outcome = "xfailed" if hasattr(report, "wasxfail") and report.skipped else report.outcome
        item.session.stash.setdefault(_ROWS, []).extend(places.ended(item.stash[_ROWS], outcome))


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Write the rows where MAQUETTE_PLACES says, a file for each worker."""
    folder = os.environ.get(_FOLDER)
    if folder and session.stash.get(_ROWS, None):
        places.write(session.stash[_ROWS], Path(folder) / f"{os.environ.get('PYTEST_XDIST_WORKER', 'main')}.json")
