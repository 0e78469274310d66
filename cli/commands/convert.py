"""The `convert` command: writes .npz tables, Mitsuba 3 (.xml), POV-Ray (.pov), glTF, USD and triangle meshes."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ...compiler.io.replace_file import replace_file
from ...lang.diagnostics import Diagnostic
from .. import common_options as shared
from .. import option_types as options
from .. import render_job as jobs
from .. import terminal
from ..scene_selection import selected

if TYPE_CHECKING:
    from ...compiler import ir
    from ...compiler.exporters.export import Export
    from ...compiler.plan.plan import Plan

MESHES = {".stl": "triangles for printing", ".3mf": "the same", ".obj": "triangles", ".ply": "triangles"}
ASSETS = {".glb": "glTF 2.0", ".usda": "USD, as text", ".usdc": "USD", ".usdz": "USD with its pictures"}
ENDINGS = {".npz": "a saved IR", ".xml": "Mitsuba 3", ".pov": "POV-Ray 3.7", **ASSETS, **MESHES}


@click.command("convert")
@click.argument("scene", metavar="IN", type=shared.FILE)
@click.argument("output", metavar="OUT", type=shared.OUT)
@shared.scene_options
@shared.picture_options_except("backend", "error", "budget", "aov", "exposure", "view", "threads")
@click.option(
    "--deviation", metavar="LENGTH", type=options.Value("length", options.length),
    help="Greatest distance of triangles from the true surface (0.05mm). Default: 1/2000 of the scene.",
)
@click.option("--only", metavar="NAME", multiple=True, help="Convert this instance and those below it alone; * and ? match. Repeatable.")
@click.option("--without", metavar="NAME", multiple=True, help="Leave out this instance and those below it. Repeatable.")
@shared.examples(
    "maquette convert part.scene part.stl --deviation 0.05mm",
    "maquette convert scene.scene lid.stl --only lid",
    "maquette convert room.scene room.glb",
    "maquette convert room.scene room.npz",
    "maquette convert hello.scene hello.xml --size 400x300 --plan filter=box",
    "maquette convert hello.scene hello.pov",
)
def command(
    scene: Path, output: Path, deviation: float | None, only: tuple[str, ...], without: tuple[str, ...], **given: Any
) -> None:  # fmt: skip
    """Convert IN for other programs.

    OUT.npz is a saved IR, which every command reads as a scene. OUT.glb is glTF 2.0; OUT.usda, OUT.usdc and OUT.usdz are USD: meshes,
    materials, cameras and lights for Blender, three.js, usdview and others. OUT.xml is for Mitsuba 3, OUT.pov for POV-Ray 3.7, each
    with files of its meshes and images (OUT.0.ply, …). Features that a format lacks are reported with their place and left out.
    OUT.stl and OUT.3mf hold all solids as triangles in millimetres, z up, for 3D printing; OUT.obj and OUT.ply in metres, y up.
    """
    ending = output.suffix.lower()
    if ending not in ENDINGS:
        known = ", ".join(f"{e} ({what})" for e, what in ENDINGS.items())
        raise click.UsageError(f"writing {ending or 'a file without an extension'} is not built yet: OUT ends in {known}")
    source, settings, overrides = shared.read_options(scene, given)
    source = replace(source, mesh=replace(source.mesh, deviation=deviation))
    if ending == ".npz" and (overrides or any(value is not None for value in given.values())):
        raise click.UsageError("a saved IR has no render plan: give options of the picture to `maquette render OUT.npz`")
    if deviation is not None and ending not in MESHES | ASSETS:
        raise click.UsageError(f"--deviation applies to triangles: OUT ends in {', '.join(MESHES | ASSETS)}")
    jobs.check_folder(output)
    compiled = selected(shared.load(source), only, without)
    jobs.check_folder(output, map(Path, compiled.files))
    if ending in MESHES:
        _write_triangles(compiled, output, ending, deviation)
        return
    if ending == ".npz":
        from ...compiler.scene import serialize

        serialize.save(compiled, output)
        return
    plan = jobs.make_plan(compiled, settings, overrides)
    made = _export(compiled, plan, output, deviation)
    made.save(output)
    terminal.report(made.found)
    if ending in ASSETS and made.triangles:
        told = tell_deviation(made.deviation, deviation, compiled)
        click.echo(f"{output}: {made.triangles} triangles, {told}", err=True)


def _write_triangles(scene: ir.Scene, output: Path, ending: str, tolerance: float | None) -> None:
    from ...compiler.exporters import mesh_files, mesh_losses
    from ...render.tessellation import printable_mesh

    parts, found = printable_mesh.printable_parts(scene, tolerance)
    terminal.report(found)
    if not parts:
        raise click.ClickException("the scene has no bounded surface to write")
    terminal.report(mesh_losses.losses(scene, parts, ending))
    moved = None
    if ending in mesh_files.SINGLE:
        parts, moved = mesh_files.center(parts)
    parts, crowded = mesh_files.separate(parts, ending)
    library = output.with_suffix(".mtl")
    if ending == ".obj":
        jobs.check_folder(library, map(Path, scene.files))
        replace_file(library, mesh_files.mtl(parts))
    replace_file(output, mesh_files.encode(parts, ending, library.name))
    count = sum(len(part.triangles) for part in parts)
    rounded = mesh_files.rounding(parts, ending)
    off = max(part.deviation for part in parts) + rounded
    leaks = sum(part.open_edges for part in parts)
    closed = f"{leaks} open edges" if leaks else f"{crowded} edges of more than two triangles" if crowded else "closed"
    if moved is not None:
        way = ", ".join(f"{x + 0.0:.9g}" for x in moved.tolist())
        click.echo(f"moved by [{way}] metres: {ending} has too few digits for positions so far from the origin", err=True)
    told = tell_deviation(off, tolerance, scene)
    click.echo(f"{output}: {count} triangles, {closed}, {told}", err=True)


def tell_deviation(off: float, tolerance: float | None, scene: ir.Scene) -> str:
    """What is told of the largest distance of triangles from the true surface, in metres; warns where it is more than was asked for."""
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


def _export(scene: ir.Scene, plan: Plan, output: Path, deviation: float | None) -> Export:
    from ...compiler.exporters.gltf import scene as gltf_scene
    from ...compiler.exporters.mitsuba import scene as mitsuba_scene
    from ...compiler.exporters.povray import scene as povray_scene
    from ...render.tessellation import scene_meshes

    ending = output.suffix.lower()
    if ending in ASSETS:
        converters = scene_meshes.make_converters(scene, deviation)
        if ending == ".glb":
            return gltf_scene.write(scene, plan, converters)
        from ...compiler.exporters.usd import scene as usd_scene

        return usd_scene.write(scene, plan, output.stem, ending, converters)
    write = mitsuba_scene.write if ending == ".xml" else povray_scene.write
    return write(scene, plan, output.stem, scene_meshes.make_tessellator(scene, plan))
