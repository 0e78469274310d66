"""What `explain` says of geometry that takes long."""

from __future__ import annotations

from maquette.cli.job import geometry_costs
from maquette.compiler.mesh.built_geometry import Cost
from maquette.lang.diagnostics import Span

SLOW = Cost("difference", Span("a.scene", 6, 1), 17.94, (("made into triangles", 7, 15.1), ("rounded", 1, 1.2)))
QUICK = Cost("text", Span("a.scene", 9, 1), 0.1, ())


def test_the_longest_are_told_with_their_parts() -> None:
    assert geometry_costs.lines([QUICK, SLOW]) == [
        "geometry  17.9 s  difference at a.scene:6:1: made into triangles 7 times, 15.1 s, rounded 1.2 s",
        "geometry is made again by each command; docs/costs.md says what makes it quicker",
    ]
    assert geometry_costs.lines([QUICK]) == []
    assert geometry_costs.rows([SLOW])[0]["parts"][0] == {"what": "made into triangles", "count": 7, "seconds": 15.1}
