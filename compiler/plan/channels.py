"""Channels that a picture may have beside its colour (AOVs), among them the light groups."""

from __future__ import annotations

from ...lang.schema.picture_channels import CHANNELS, LIGHT
from .decision import Plan

REST = "rest"  # the group of lights without one


def is_channel(name: str) -> bool:
    """Whether a picture of some scene has a channel of this name."""
    return name in CHANNELS or (name.startswith(LIGHT) and len(name) > len(LIGHT))


def light_groups(plan: Plan) -> tuple[str, ...]:
    """The light groups that have a channel."""
    return tuple(name.removeprefix(LIGHT) for name in plan["aov"] if name.startswith(LIGHT))
