"""The `inspect` command: the tables of a compiled scene."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from .. import common_options as shared
from .. import terminal


@click.command("inspect")
@click.argument("scene", type=shared.FILE)
@shared.scene_options
@shared.ocio
@click.option("--ir", "as_ir", is_flag=True, help="Print every row of every table.")
@click.option("--json", "as_json", is_flag=True, help="Print the tables as JSON.")
@shared.examples("maquette inspect room.scene", "maquette inspect gear.scene --ir --set teeth=6", "maquette inspect robot.usdz")
def command(scene: Path, as_ir: bool, as_json: bool, **options: Any) -> None:
    """Show the compiled SCENE.

    Prints the number of rows of each table, names of cameras and lights, params, added defaults, and the files read. Of a USD stage
    also its prims by type, axes, time codes and variants. What is not drawn stands in the warnings.
    """
    from ...compiler.scene import dump

    if as_ir and as_json:
        raise click.UsageError("--ir and --json exclude each other")
    source = shared.source_of(scene, options)
    compiled = shared.load(source)
    if as_ir:
        click.echo(dump.text(compiled))
    elif as_json:
        click.echo(json.dumps(dump.data(compiled), indent=1))
    else:
        terminal.inspect(compiled, source.summary())
