"""What all tests share: the sample files, and the options and marks that choose which tests run."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import uharfbuzz  # noqa: F401  (before all else: loaded after some other libraries of the tests, it crashes when it draws a glyph)
from maquette.render.simd import target

os.environ["MAQUETTE_PROGRESS"] = "off"  # stderr does not depend on how long kernels compile
# Tests run the kernels that users run, which `make kernels` compiles. No test starts a process that compiles kernels for later.
os.environ["MAQUETTE_KERNELS"] = os.environ.get("MAQUETTE_TEST_KERNELS", "general")
if "MAQUETTE_TEST_THREADS" in os.environ:  # of tools/matrix.py: renders in this process take so many, whatever the machine has
    target.cores = lambda: int(os.environ["MAQUETTE_TEST_THREADS"])
ROOT = Path(__file__).resolve().parent.parent
ASSETS = Path(os.environ.get("MAQUETTE_ASSETS") or ROOT.parent / "shared" / "assets")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--long", action="store_true", help="also run the tests marked long")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    missing = pytest.mark.skip(reason=f"no sample files in {ASSETS}: set MAQUETTE_ASSETS to their folder")
    for item in items:
        if item.get_closest_marker("assets") and not ASSETS.is_dir():
            item.add_marker(missing)
    if not config.getoption("--long"):
        long = [item for item in items if item.get_closest_marker("long")]
        config.hook.pytest_deselected(items=long)
        items[:] = [item for item in items if item not in long]


@pytest.fixture(scope="session")
def assets() -> Path:
    """The folder of the shared sample files. Tests that use it are marked `assets`."""
    return ASSETS
