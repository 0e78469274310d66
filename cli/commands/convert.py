"""The `convert` command: writes a scene in the format of a file's ending."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ...compiler.exporters import writers
from ...compiler.io.replace_file import check_new_folder
from ...lang.diagnostics import Diagnostic
from .. import common_options as shared
from .. import option_types as options
from .. import render_job as jobs
from .. import terminal
from ..scene_selection import selected

if TYPE_CHECKING:
    from ...compiler import ir
    from ...compiler.exporters.export_job import RendererFunctions


@click.command("convert")
@click.argument("scene", metavar="IN", type=shared.FILE)
@click.argument("output", metavar="OUT", type=shared.OUT)
@shared.scene_options
@shared.picture_options_except(
    "backend", "error", "budget", "aov", "exposure", "view", "display", "look", "working_space", "white", "bloom", "threads"
)
@click.option(
    "--deviation",
    metavar="LENGTH",
    type=options.Value("length", options.length),
    help="Greatest distance of triangles from the true surface (0.05mm). Default: 1/2000 of the scene.",
)
@click.option(
    "--bake",
    metavar="TEXELS",
    type=click.IntRange(0, 16384),
    help="Side of the largest picture that a pattern becomes; 0 leaves patterns out. Default: 1024.",
)
@click.option("--only", metavar="NAME", multiple=True, help="Convert this instance and those below it alone; * and ? match. Repeatable.")
@click.option("--without", metavar="NAME", multiple=True, help="Leave out this instance and those below it. Repeatable.")
@shared.examples(
    "maquette convert part.scene part.stl --deviation 0.05mm",
    "maquette convert scene.scene lid.stl --only lid",
    "maquette convert room.scene room.glb --bake 2048",
    "maquette convert room.scene room.npz",
    "maquette convert hello.scene hello.xml --size 400x300 --plan filter=box",
    "maquette convert hello.scene hello.pov",
)
@shared.listing("OUT ends in:", *writers.help_lines())
def command(
    scene: Path, output: Path, deviation: float | None, bake: int | None, only: tuple[str, ...], without: tuple[str, ...], **values: Any
) -> None:  # fmt: skip
    """Convert IN for other programs.

    Features that a format lacks are reported with their place and left out. Files of meshes and pictures are written beside OUT.
    """
    writer = writers.writer_of(output.suffix.lower())
    if writer is None:
        ending = output.suffix.lower() or "a file without an extension"
        raise click.UsageError(f"writing {ending} is not built yet: OUT ends in {writers.known_endings()}")
    source, settings, overrides = shared.read_options(scene, values)
    source = replace(source, mesh=replace(source.mesh, deviation=deviation))
    if not writer.planned and (overrides or any(value is not None for value in values.values())):
        raise click.UsageError(writer.refusal)
    if deviation is not None and not writer.deviation:
        raise click.UsageError(f"--deviation applies to triangles: OUT ends in {writers.with_deviation()}")
    jobs.check_folder(output)
    if bake is not None and not writer.bakes:
        raise click.UsageError(f"--bake applies to patterns that become pictures: OUT ends in {writers.with_pictures()}")
    compiled = selected(shared.load(source), only, without)
    jobs.check_folder(output, map(Path, compiled.files))
    from ...compiler.exporters.baking.patterns import SIDE
    from ...compiler.exporters.export import ExportError
    from ...compiler.exporters.export_job import ExportJob

    job = ExportJob(
        compiled,
        output,
        deviation,
        lambda: jobs.make_plan(compiled, settings, overrides),
        _renderer,
        settings,
        SIDE if bake is None else bake,
    )
    try:
        exported = writers.export(writer, job)
    except ExportError as failure:
        terminal.report(failure.out.diagnostics)
        raise click.ClickException(str(failure)) from None
    for folder in exported.folders:
        check_new_folder(output.parent / folder)
    for name in exported.files:
        if (output.parent / name).parent.is_dir():
            jobs.check_folder(output.parent / name, map(Path, compiled.files))
    exported.save(output)
    terminal.report(exported.diagnostics)
    for message in exported.messages:
        click.echo(message, err=True)
    if writer.deviation and exported.triangles:
        closed = f"{exported.closed}, " if exported.closed else ""
        click.echo(f"{output}: {exported.triangles} triangles, {closed}{tell_deviation(exported.deviation, deviation, compiled)}", err=True)


def _renderer() -> RendererFunctions:
    from ...compiler.exporters.export_job import RendererFunctions
    from ...render.tessellation import printable_mesh, scene_meshes

    return RendererFunctions(scene_meshes.make_converters, scene_meshes.make_tessellator, printable_mesh.printable_parts)


def tell_deviation(off: float, tolerance: float | None, scene: ir.Scene) -> str:
    """The largest distance of triangles from the true surface, in metres, as text. Warns where it exceeds the deviation of the command."""
    from ...compiler import ir

    if tolerance is not None and off > 1.001 * tolerance:
        message = f"the triangles are up to {_up(off * 1000)} mm from the true surface, more than the {tolerance * 1000:.3g} mm asked for"
        hint = "solids with fillets, formulas or meshes in them have a limit on cells: make them of smaller parts, or of sharp ones"
        terminal.report([Diagnostic("warning", message, None, hint)])
    tables = scene.tables
    kind, bounds = tables.geometries.kind, tables.geometries.bounds
    chords = tables.geometries.parameters[:, 0] > 1e-6 * (bounds[:, 1] - bounds[:, 0]).max(axis=1)
    solid, cut = kind == ir.GeometryKind.FORMULA, (kind == ir.GeometryKind.MESH) & chords
    used = tables.instances.geometry
    how = "where it was measured" if solid[used].any() else "at most"
    edges = "; edges where parts meet may be farther" if (solid | cut)[used].any() else ""
    return f"distance from the true surface {_up(off * 1000)} mm {how}{edges}"


def _up(value: float) -> str:
    """A bound with three digits, rounded up."""
    if value <= 0.0:
        return "0"
    step = 10.0 ** (math.floor(math.log10(value)) - 2)
    return f"{math.ceil(value / step * (1 - 1e-12)) * step:.3g}"
