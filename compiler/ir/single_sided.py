"""The bit of Instances.visible of instances that are drawn from their front alone; plan/single_sided.py draws them so."""

from __future__ import annotations

SINGLE_SIDED = 1 << 30  # the last of light_links.ALL_SETS, which has one set less where it is used
