"""Other renderers on the same chart, where they are installed: Mitsuba 3 and POV-Ray. Nothing needs them.

A peer is given the same size, camera, crop, filter, depth of paths (without roulette), number of threads and linear light; what it
cannot be given is said by `express`. Its render runs in a process of its own, timed apart from loading and compiling.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from ...compiler import ir
from ...compiler.plan.plan import Plan
from ...lang.diagnostics import suggest
from ..records import Run, Setting
from .mitsuba import Mitsuba
from .povray import PovRay


class Peer(Protocol):
    """Another renderer."""

    name: str

    @property
    def missing(self) -> str:
        """What to install; empty when it is there."""
        ...

    @property
    def version(self) -> str:
        """Its name, version and variant. Only where it is installed."""
        ...

    def express(self, scene: ir.Scene, plan: Plan) -> list[str]:
        """What it cannot carry of a scene drawn as planned, each with its place; empty where it draws the same."""
        ...

    def ladder(self, scene: ir.Scene, plan: Plan) -> tuple[Setting, ...]:
        """Its settings from cheap to dear."""
        ...

    def run(self, scene: ir.Scene, plan: Plan, setting: Setting, seed: int) -> Run:
        """One render. Raises PeerError with the peer's own words if it fails."""
        ...


def common(plan: Plan) -> dict[str, str]:
    """What has to be overridden in everybody's plan beside peers, so that all draw the same: what all renderers have.

    That is the box filter, and textures that are looked at in points: peers have no means of them over what a pixel sees.
    """
    box = {} if plan["filter"] == "box" else {"filter": "box"}
    return box if plan.decisions["textures"].fixed else {**box, "textures": "sharp"}


def find(names: Iterable[str]) -> list[Peer]:
    """Peers by name, installed or not. Raises ValueError for a name that is none."""
    known: dict[str, Peer] = {peer.name: peer for peer in (Mitsuba(), PovRay())}
    for name in (names := list(names)):
        if name not in known:
            raise ValueError(f"no peer is called `{name}`; there are {', '.join(known)}. {suggest(name, known)}".strip())
    return [known[name] for name in names]
