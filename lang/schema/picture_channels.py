"""The channels that a picture may have beside its colour (AOVs), a row each. Options, files, backends and the live window read them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

CRYPTOMATTES = ("crypto_object", "crypto_material")
LIGHT = "light:"  # prefix of the channel of a light group


@dataclass(frozen=True, slots=True)
class Channel:
    """One channel: what it holds, and the names of its components in an .exr, as in `depth.Z`.

    `value` computes the components of first hits, at pixel centres, from a render.film.aov.VisiblePoints; without one, the film makes the
    channel. Pixels without a hit have the value `empty`. `shown` is the conversion of live/channels.py by which the live window shows it
    ("": it does not); `label` is its name there. A name that stands for several channels has no components.
    """

    doc: str
    components: str = ""
    value: Callable[[Any], Sequence[Any]] | None = None
    empty: float = 0.0
    shown: str = ""
    label: str = ""


CHANNELS = {
    "depth": Channel("metres along the camera's axis", "Z", lambda points: (points.depth,), math.inf, "distance"),
    "normal": Channel("shading normal in world space", "XYZ", lambda points: points.normal, shown="direction"),
    "position": Channel("metres in world space", "XYZ", lambda points: points.position),
    "albedo": Channel("k_d; of metals, mirrors and glass the specular colour", "RGB", lambda points: points.albedo, shown="color"),
    "uv": Channel("texture coordinates", "UV", lambda points: points.uv, shown="fraction"),
    "id": Channel(
        "rows of instance and material; -1 for misses", "instance material", lambda points: (points.instance, points.material), -1.0, "row",
        "instances",
    ),
    "transmittance": Channel(
        "share of the light of what is seen that passes media straight; 1 without media", "RGB", lambda points: points.transmittance, 1.0,
        "color",
    ),
    "scatter_depth": Channel(
        "mean depth of the first scattering in media, or of the surface; inf where there is neither", "Z", lambda points: (points.depth,),
        math.inf, "distance", "first scattering",
    ),
    "variance": Channel("variance of the pixel's mean, from halves of its samples", "RGB"),
    "samples": Channel("samples of the pixel", "N", shown="count"),
    "cryptomatte": Channel("crypto_object and crypto_material: coverage by instance and by material"),
    "lights": Channel("the light of each light group"),
    "issues": Channel("1 where the first root of a formula is unproven", "N", lambda points: (points.unproven,)),
}  # fmt: skip
SEEN = tuple(name for name, channel in CHANNELS.items() if channel.value)  # channels of first hits


def component_names(name: str) -> tuple[str, ...]:
    """The components of a row of CHANNELS in a file: depth.Z, id.instance."""
    parts = CHANNELS[name].components
    return tuple(f"{name}.{part}" for part in (parts.split() if " " in parts else parts))


def help_names() -> str:
    """The names for the option --aov."""
    return ",".join(f"lights,{LIGHT}NAME" if name == "lights" else name for name in CHANNELS)
