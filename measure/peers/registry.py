"""The interface of other renderers (peers) and the list of them: Mitsuba 3 and POV-Ray. They are optional.

A peer renders with the same size, camera, crop, filter, path depth (without Russian roulette), number of threads and linear light.
`unsupported` names the features it lacks. It runs in a separate process; loading and compiling are timed separately.
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
        """The command that installs it; "" if it is installed."""
        ...

    @property
    def version(self) -> str:
        """Name, version and variant of an installed peer."""
        ...

    def unsupported(self, scene: ir.Scene, plan: Plan) -> list[str]:
        """The features of a planned scene that it lacks, each with its source position; empty if it renders the same picture."""
        ...

    def sweep(self, scene: ir.Scene, plan: Plan) -> tuple[Setting, ...]:
        """Its settings in order of cost."""
        ...

    def run(self, scene: ir.Scene, plan: Plan, setting: Setting, seed: int) -> Run:
        """Render once. Raises PeerError with the peer's output if it fails."""
        ...


def common_overrides(plan: Plan) -> dict[str, str]:
    """Overrides of all plans in a chart with peers, so that all render the same picture.

    These are the box filter and unfiltered textures: peers do not average textures over the pixel footprint.
    """
    box = {} if plan["filter"] == "box" else {"filter": "box"}
    return box if plan.decisions["texture_filter"].fixed else {**box, "texture_filter": "point"}


def every() -> tuple[Peer, ...]:
    """All peers, installed or not."""
    return Mitsuba(), PovRay()


def find(names: Iterable[str]) -> list[Peer]:
    """Peers by name, installed or not. Raises ValueError for an unknown name."""
    peers = {peer.name: peer for peer in every()}
    for name in (names := list(names)):
        if name not in peers:
            raise ValueError(f"no peer is called `{name}`; there are {', '.join(peers)}. {suggest(name, peers)}".strip())
    return [peers[name] for name in names]
