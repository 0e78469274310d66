"""The `check` command: errors and warnings of scenes, without pictures."""

from __future__ import annotations

import contextlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from ...lang.diagnostics import SceneError, sort_diagnostics
from .. import common_options as shared
from .. import terminal


@click.command("check")
@click.argument("scenes", type=shared.FILE, nargs=-1, required=True)
@shared.scene_options
@shared.ocio
@click.option("--strict", is_flag=True, help="Count warnings as errors: among them everything that a file has and is not drawn.")
@click.option("--build", is_flag=True, help="Make the geometry, too: solids, text and heightfields, whose last errors show then.")
@click.option("--json", "as_json", is_flag=True, help="Print all diagnostics as a JSON list.")
@shared.examples(
    "maquette check room.scene", "maquette check bracket.scene --build", "maquette check examples/*.scene --json",
    "maquette check robot.usdz --strict",
)  # fmt: skip
@click.pass_context
def command(ctx: click.Context, scenes: tuple[Path, ...], strict: bool, build: bool, as_json: bool, **options: Any) -> None:
    """Report errors and warnings in SCENES without rendering.

    Of mesh files it tells whether they are closed, their bodies and Euler number.
    Text, heightfields and solids are not made: boxes stand for them. Errors that show only when they are made are found with --build,
    and by all commands that draw: nothing is left of a solid, its parts are not closed, heights between the places that were tried.
    """
    from ...compiler.mesh import built_geometry, mesh_notes
    from ...compiler.plan import plan as planner

    failed, data = False, []
    for path in scenes:
        try:
            with contextlib.nullcontext() if build else built_geometry.left_out():
                scene, messages = shared.source_of(path, dict(options)).load({})
            diagnostics = (*messages.items, *planner.default_notes(scene), *mesh_notes.notes(scene))
        except SceneError as error:
            diagnostics = error.diagnostics
        if strict:
            diagnostics = tuple(replace(d, severity="error") if d.severity == "warning" else d for d in diagnostics)
        errors = sum(d.severity == "error" for d in diagnostics)
        failed = failed or errors > 0
        if as_json:
            data += [d.to_json() for d in sort_diagnostics(diagnostics)]
        else:
            terminal.report(diagnostics)
            click.echo(f"{path}: {errors or 'no'} error{'' if errors == 1 else 's'}")
    if as_json:
        click.echo(json.dumps(data, indent=2))
    ctx.exit(1 if failed else 0)
