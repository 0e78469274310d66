"""Arguments that several elements of lights have."""

from __future__ import annotations

import math
from typing import Any

from ..lang.schema.argument_types import Arg, Entry

LIGHT = (
    Arg("color", "color", (1.0, 1.0, 1.0), "multiplies its light", keyword=True),
    Arg(
        "receivers",
        "strings",
        None,
        "names of the objects that it lights, with `*` and `?`; `!name` leaves one out; default all",
        keyword=True,
    ),
    Arg("group", "string", None, "its light group; --aov light:NAME renders the light of one group", keyword=True),
    Arg("name", "string", None, "its name in messages", keyword=True),
)
SHADOWS = (
    Arg("shadows", "bool", True, "whether objects cast shadows in its light", keyword=True),
    Arg("blockers", "strings", None, "names of the objects that cast shadows in its light, as `receivers`; default all", keyword=True),
)
FALLOFF = Arg("falloff", "falloff", None, "attenuation with distance; default 1/d²", keyword=True)

PROFILE = Arg(
    "profile", "string", None,
    "picture, latitude by longitude, of a factor of its light by direction in its frame, as of an IES file", keyword=True,
)  # fmt: skip
INTENSITY = Arg(
    "intensity", "intensity", 9 * math.pi, "candela; by default white at a distance of 3 m renders as 1", minimum=0.0, keyword=True
)
ILLUMINANCE = Arg(
    "illuminance", "illuminance", math.pi, "lux on a surface that faces it", aliases=("irradiance",), minimum=0.0, keyword=True
)


def light_entry(name: str, doc: str, *args: Arg, **more: Any) -> Entry:
    """The entry of a light with shadows, after its own arguments."""
    return Entry(name, "light", doc, (*args, *SHADOWS, *LIGHT), **more)
