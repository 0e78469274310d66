"""Notes on options that have no effect on a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ...lang.diagnostics import Diagnostic

if TYPE_CHECKING:
    from ...compiler import ir
    from ...compiler.plan.plan import Plan


def notes(settings: ir.Settings, plan: Plan, path: Path) -> list[Diagnostic]:
    """A note for each option among the settings of a command that does not change the picture at `path`."""
    from ...render.image import image_files

    sentences = []
    if path.suffix.lower() in image_files.LINEAR:
        names = [name for name in ("exposure", "view", "display", "look", "white") if getattr(settings, name) is not None]
        sentences += [f"--{name} has no effect: an EXR file holds the radiance itself" for name in names]
    if settings.tolerance is not None and plan["backend"] != "raster":
        sentences.append(f"--tolerance has no effect: the backend {plan['backend']} draws curved shapes without triangles")
    if settings.bloom is not None and plan["bloom"] == 0.0:
        sentences.append("--bloom has no effect: only a perspective camera has a lens")
    return [Diagnostic("note", message) for message in sentences]
