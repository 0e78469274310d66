"""The line that tells a picture: its size, samples, error and time."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any


def summary(path: Path, figures: Mapping[str, Any]) -> str:
    """A one-line summary of a picture."""
    from ...compiler.plan import omitted_light

    width, height = figures["size"]
    total, denoised_noise = figures.get("elapsed") or sum(figures["seconds"].values()), figures["denoised_error"]
    error, noise, bias = "", figures["error"], figures["bias"]
    if noise is not None:
        after = ", unmeasured after" if denoised_noise is None else f", about {omitted_light.with_bias(denoised_noise, bias):.1%} after"
        after = f" before denoising{after}" if figures["denoised"] else ""
        words = omitted_light.phrase(noise, bias, figures["left_out"], figures["plan"]["bounces"])
        error = f", √relMSE {omitted_light.with_bias(noise, bias):.2%}{after}{f' ({words})' if words else ''}"
    elif figures.get("elapsed"):
        error = ", of unknown error"
    most, mean = figures["samples"], figures["samples_mean"]
    samples = f"{most:.3g}" if mean is None or mean >= most else f"{mean:.3g} (at most {most:g})"
    budget = f" of the budget of {figures['plan']['budget']:g} s" if figures.get("elapsed") else ""
    return f"{path}: {width}x{height}, {figures['backend']}, {samples} samples a pixel{error}, {total:.2f} s{budget}"
