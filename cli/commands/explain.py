"""The `explain` command: the decisions of a render plan, with their reasons."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from .. import common_options as shared
from .. import render_job as jobs
from .. import terminal
from ..job import geometry_costs


@click.command("explain")
@click.argument("scene", type=shared.FILE)
@shared.scene_options
@shared.picture_options
@click.option("--json", "as_json", is_flag=True, help="Print the decisions as JSON.")
@shared.examples("maquette explain room.scene", "maquette explain room.scene --backend raster --plan raster.coverage=areas")
def command(scene: Path, as_json: bool, **options: Any) -> None:
    """Show the render plan of SCENE with reasons.

    Begins with the five decisions that matter most for the scene. Then prints each decision of the plan: its value, its reason, and
    the option that changes it. Then come the compiled kernels that a picture takes, those specialised to the scene, or general ones
    until these are compiled, and the shapes whose geometry takes long to make, with their seconds.
    """
    from ...compiler.mesh import built_geometry
    from ...compiler.plan import importance
    from ...render import picture_notes
    from ...render.backends import kernel_choice

    source, settings, overrides = shared.read_options(scene, options)
    with built_geometry.recorded() as costs:
        compiled = shared.load(source)
    plan = jobs.make_plan(compiled, settings, overrides)
    kind, state = kernel_choice.describe(compiled, plan)
    matters = importance.most_important(plan)
    if as_json:
        rows = [
            {"name": d.name, "value": d.value, "reason": d.reason, "overridden": d.overridden, "matters": d in matters}
            for d in plan.decisions.values()
        ]
        rows.append({"name": "kernels", "value": kind, "reason": state, "overridden": False, "matters": False})
        if cost_rows := geometry_costs.rows(costs):
            rows.append({"name": "geometry", "value": cost_rows, "reason": "seconds to make it", "overridden": False, "matters": False})
        click.echo(json.dumps(jobs.json_value(rows), indent=2))
    else:
        terminal.explain(compiled, plan, matters)
        click.echo(f"kernels  {kind}  {state}")
        for line in geometry_costs.lines(costs):
            click.echo(line)
    terminal.report(picture_notes.plan_warnings(compiled, plan))
