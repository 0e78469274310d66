"""The plan: what a render needs and no more, each decision with its name, value, reason and switch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from . import ir


@dataclass(frozen=True, slots=True)
class Decision:
    """One decision. `choices` are the values an override may have; empty: any value of the same type."""

    name: str
    value: Any
    reason: str
    choices: tuple[Any, ...] = ()
    overridden: bool = False


@dataclass(frozen=True, slots=True)
class Plan:
    """All decisions by name: `plan["raster.fill"]`."""

    decisions: Mapping[str, Decision]

    def __getitem__(self, name: str) -> Any:
        return self.decisions[name].value


def make(scene: ir.Scene, settings: ir.Settings, overrides: Mapping[str, str] = {}) -> Plan:  # noqa: B006 - never changed
    """Decide what drawing `scene` with `settings` (command line over scene) takes."""
    raise NotImplementedError
