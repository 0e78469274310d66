"""The schema's light meters, which `maquette measure` reads."""

from __future__ import annotations

from .argument_types import Arg, Entry

METER = Entry(
    "meter",
    "meter",
    "a light meter, which no picture shows: `maquette measure` tells the illuminance that it receives, in lux",
    (
        Arg("center", "point", (0.0, 0.0, 0.0), "its center"),
        Arg("size", "size2", None, "edge lengths of the rectangle that it measures; default: a point", above=0.0, keyword=True),
        Arg("facing", "direction", (0.0, 1.0, 0.0), "the direction that it faces: light from behind does not count", keyword=True),
        Arg("up", "direction", None, "direction of its second edge", keyword=True),
        Arg(
            "grid", "pixels", None, "its cells along the first and the second edge, a value each; default: by EN 12464-1 from its size",
            keyword=True,
        ),
        Arg("on", "strings", None, "names of the objects whose whole surface it measures, with `*` and `?`", keyword=True),
        Arg("side", "choice", "front", "the side of the surface, with `on`: outside or inside", choices=("front", "back"), keyword=True),
        Arg("name", "string", None, "its name in results", keyword=True),
    ),
    exclusive=(("on", "center"), ("on", "size"), ("on", "facing"), ("on", "grid")),
    example='meter([0, 75cm, 0], size: [2, 1], name: "desk")',
)
ENTRIES = (METER,)
"""The elements that are light meters."""
