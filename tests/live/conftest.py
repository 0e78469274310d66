"""Fixtures of the tests of the live window."""

from __future__ import annotations

from pathlib import Path

import pytest
from maquette.live import address


@pytest.fixture(autouse=True)
def own_addresses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep addresses in the folder of the test."""
    monkeypatch.setattr(address, "file_of", lambda scene: tmp_path / "addresses" / f"{scene.name}.json")
