"""Members of enumerations of the IR count from 0 without a gap: tables by kind have a row for each."""

from __future__ import annotations

from enum import IntEnum

import pytest
from maquette.compiler import ir

KINDS = ir.GeometryKind, ir.MaterialModel, ir.LightKind, ir.TextureKind, ir.Slot


@pytest.mark.parametrize("kinds", KINDS, ids=lambda kinds: kinds.__name__)
def test_numbers_have_no_gap(kinds: type[IntEnum]) -> None:
    assert [int(kind) for kind in kinds] == list(range(len(kinds))), f"a new member of {kinds.__name__} has the number {len(kinds)}"
