"""Light links of a scene that is built: each set of instances that some light names becomes a bit of Instances.visible."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...lang.diagnostics import Diagnostics, Span
from ...lights import SKIES
from .. import ir
from ..ir.light_links import CASTERS, EVERYTHING, FIRST_SET, MOST_SETS
from ..ir.single_sided import SINGLE_SIDED
from . import selection

Members = Callable[[Sequence[str]], np.ndarray]  # names of the instances → (instances,) bool: which are in the set


class Links(NamedTuple):
    """The instances that a light lights, and those that cast its shadows; None: all."""

    receivers: Members | None = None
    blockers: Members | None = None


def by_names(patterns: Sequence[str], diagnostics: Diagnostics, span: Span) -> Members:
    """The instances that some pattern matches (see selection.select) and none with `!` before it; without others than these all do.

    A pattern that matches nothing is an error at `span`.
    """
    without = [pattern[1:] for pattern in patterns if pattern.startswith("!")]
    only = [pattern for pattern in patterns if not pattern.startswith("!")]

    def members(names: Sequence[str]) -> np.ndarray:
        try:
            chosen = selection.named(names, only) if only or not without else np.ones(len(names), bool)
            return chosen & ~selection.named(names, without)
        except selection.SelectionError as failure:
            diagnostics.error(str(failure), span)
            return np.ones(len(names), bool)

    return members


def linked(
    instances: ir.Instances, lights: ir.Lights, links: Mapping[int, Links], names: Sequence[str], diagnostics: Diagnostics
) -> tuple[ir.Instances, ir.Lights]:
    """The tables with `links`, by rows of lights. Equal sets share a bit.

    Sets beyond MOST_SETS, or one less where some instance is single-sided, count as all, with a warning.
    """
    most = MOST_SETS - bool((instances.visible & SINGLE_SIDED).any())
    visible, receivers, blockers = instances.visible.copy(), lights.receivers.copy(), lights.blockers.copy()
    bits: dict[bytes, int] = {}
    casters = visible & CASTERS != 0
    names = [*names, *[""] * (len(visible) - len(names))]

    def bit(members: np.ndarray, every: int) -> int:
        key = members.tobytes()
        if key not in bits:
            if len(bits) == most:
                diagnostics.warning(f"the lights have more than {most} different sets of light links: the rest is left out")
                return every
            bits[key] = FIRST_SET << len(bits)
            visible[members] |= bits[key]
        return bits[key]

    for row, link in links.items():
        if link.receivers is not None and not (members := link.receivers(names)).all():
            receivers[row] = bit(members, EVERYTHING)
        if link.blockers is not None and not ((members := link.blockers(names)) | ~casters).all():
            blockers[row] = bit(members & casters, CASTERS)
    skies = np.flatnonzero(ir.is_in(lights.kind, SKIES) & lights.shadows)
    if len(set(blockers[skies].tolist())) > 1:
        diagnostics.warning("all skies of a scene have the same blockers: those of the first count")
        blockers[skies] = blockers[skies[0]]
    return instances._replace(visible=visible), lights._replace(receivers=receivers, blockers=blockers)
