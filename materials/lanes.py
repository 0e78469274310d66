"""What the lane helpers of materials share. They are plain functions, of which render/material makes helpers of kernels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ..shapes.lanes import ops
from .contract import Lane, Vec

HELPERS: list[Callable[..., Any]] = []
"""All lane helpers of materials."""
__all__ = ["HELPERS", "black", "clipped", "helper", "ops"]


def helper(function: Callable[..., Any]) -> Any:
    """Mark a function that runs in kernels, in lanes; outside of them it runs as Python on numpy arrays. See jit.kernel.helper."""
    HELPERS.append(function)
    return function


@helper
def black(like: Lane) -> Vec:
    """Zero for each lane."""
    zero = 0.0 * like
    return zero, zero, zero


@helper
def clipped(color: Vec) -> Vec:
    """A colour between 0 and 1."""
    return ops.clip(color[0], 0.0, 1.0), ops.clip(color[1], 0.0, 1.0), ops.clip(color[2], 0.0, 1.0)
