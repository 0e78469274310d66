"""The `convert` command: a compiled scene as its tables (.npz), or as another renderer reads it (.xml for Mitsuba 3, .pov for POV-Ray)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from . import cli_job as jobs
from . import cli_shared as shared
from . import cli_terminal as terminal

if TYPE_CHECKING:
    from .compiler import ir
    from .compiler.export import Export
    from .compiler.plan import Plan

ENDINGS = {".npz": "a saved IR", ".xml": "Mitsuba 3", ".pov": "POV-Ray 3.7"}


@click.command()
@click.argument("scene", metavar="IN", type=shared.FILE)
@click.argument("output", metavar="OUT", type=shared.OUT)
@shared.scene_options
@shared.picture_options_but("backend", "error", "budget", "aov", "exposure", "view", "threads")
@shared.examples(
    "maquette convert room.scene room.npz",
    "maquette convert hello.scene hello.xml --size 400x300 --plan filter=box",
    "maquette convert hello.scene hello.pov",
)
def convert(scene: Path, output: Path, **given: Any) -> None:
    """Write IN for other programs.

    OUT.npz is a saved IR, which every command reads as a scene. OUT.xml is Mitsuba 3's, OUT.pov POV-Ray 3.7's, each with its meshes
    and pictures beside it (OUT.0.ply, …): what the format cannot carry is said with its place, and left out.
    """
    ending = output.suffix.lower()
    if ending not in ENDINGS:
        known = ", ".join(f"{e} ({what})" for e, what in ENDINGS.items())
        raise click.UsageError(f"writing {ending or 'a file without an extension'} is not built yet: OUT ends in {known}")
    source, settings, overrides = shared.asked(scene, given)
    if ending == ".npz" and (overrides or any(value is not None for value in given.values())):
        raise click.UsageError("a saved IR is the scene before it is planned: options of the picture belong to `maquette render OUT.npz`")
    jobs.check_folder(output)
    compiled = shared.load(source)
    if ending == ".npz":
        from .compiler import store

        store.save(compiled, output)
        return
    plan = jobs.make_plan(compiled, settings, overrides)
    made = _exported(compiled, plan, ending, output.stem)
    made.save(output)
    terminal.report(made.found)


def _exported(scene: ir.Scene, plan: Plan, ending: str, name: str) -> Export:
    from .compiler import export_mitsuba, export_povray
    from .render import meshed

    write = export_mitsuba.write if ending == ".xml" else export_povray.write
    return write(scene, plan, name, meshed.tessellator(scene, plan))
