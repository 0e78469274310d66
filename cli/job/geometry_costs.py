"""What `explain` says of the geometry of a scene that takes long to make."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ...compiler.mesh.built_geometry import Cost

LEAST = 0.2  # seconds of a shape that is reported
MOST = 5  # shapes


def lines(costs: Sequence[Cost]) -> list[str]:
    """A line for each shape that takes long, the longest first, and one that says where to read on."""
    longest = _longest(costs)
    texts = []
    for cost in longest:
        parts = ", ".join(f"{what} {f'{count} times, ' if count > 1 else ''}{seconds:.1f} s" for what, count, seconds in cost.parts[:3])
        texts.append(f"geometry  {cost.seconds:.1f} s  {cost.kind} at {cost.span}{f': {parts}' if parts else ''}")
    return [*texts, "geometry is made again by each command; docs/costs.md says what makes it quicker"] if texts else []


def rows(costs: Sequence[Cost]) -> list[dict[str, Any]]:
    """The same for JSON."""
    return [
        {
            "kind": cost.kind, "place": str(cost.span), "seconds": cost.seconds,
            "parts": [{"what": what, "count": count, "seconds": seconds} for what, count, seconds in cost.parts],
        }
        for cost in _longest(costs)
    ]  # fmt: skip


def _longest(costs: Sequence[Cost]) -> list[Cost]:
    return sorted((cost for cost in costs if cost.seconds >= LEAST), key=lambda cost: -cost.seconds)[:MOST]
