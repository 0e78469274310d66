"""The instances that `--only` and `--without` select."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from ..compiler import ir


def selected(scene: ir.Scene, only: tuple[str, ...], without: tuple[str, ...]) -> ir.Scene:
    """The scene with the selected instances. Raises UsageError for names that match none."""
    if not only and not without:
        return scene
    from ..compiler.scene import selection

    try:
        return selection.select(scene, only, without)
    except selection.SelectionError as error:
        raise click.UsageError(str(error)) from None
