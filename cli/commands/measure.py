"""The `measure` command: size, area, topology, volume, center, mass and inertia of the parts of a scene, and its light, with errors."""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from ...compiler.io.replace_file import replace_file
from ...lang.diagnostics import Diagnostic, suggest
from ...lang.schema import setting_values
from .. import common_options as shared
from .. import option_types as options
from .. import render_job as jobs
from .. import terminal
from ..scene_selection import selected

if TYPE_CHECKING:
    from ...compiler import ir
    from ...measure.light import report
    from ...render.tessellation.mass_properties import Measured, Properties

FILES = (".json", ".csv", ".png")
BUDGET = 60.0  # seconds of measuring light, unless others are asked for
NOT_OF_LIGHT = (
    "backend", "samples", "error", "budget", "bounces", "aov", "denoise", "tolerance", "crop", "background", "exposure", "view",
    "display", "look", "working_space", "white", "bloom", "plan",
)  # fmt: skip
DENSITIES = {"kg/m3": 1.0, "kg/m³": 1.0, "g/cm3": 1000.0, "g/cm³": 1000.0}


def density(text: str) -> float:
    """`1.24g/cm3`, `7850kg/m3`, or a bare number of kilograms a cubic metre; above zero."""
    match_ = re.fullmatch(r"\s*([0-9.]+(?:e[+-]?\d+)?)\s*(\S*)\s*", text, re.IGNORECASE)
    try:
        value = float(match_[1]) * DENSITIES[match_[2] or "kg/m3"] if match_ else 0.0
    except (KeyError, ValueError):
        value = 0.0
    if not 0.0 < value < math.inf:
        raise ValueError("a density is written 1.24g/cm3 or 7850kg/m3, and is more than 0")
    return value


def region(text: str) -> tuple[int, int, int, int]:
    """`X,Y` of a pixel or `x0,y0,x1,y1`, in pixels from the top left; x1 and y1 are exclusive."""
    if text.count(",") == 1:
        match_ = re.fullmatch(r"\s*(\d{1,9})\s*,\s*(\d{1,9})\s*", text)
        if match_ is None:
            raise ValueError("a pixel is written x,y, and a region x0,y0,x1,y1, in pixels from the top left")
        x, y = int(match_[1]), int(match_[2])
        return x, y, x + 1, y + 1
    return setting_values.crop(text)


@click.command("measure")
@click.argument("scene", type=shared.FILE)
@shared.scene_options
@click.option("--only", metavar="NAME", multiple=True, help="Measure this instance and those below it alone; * and ? match. Repeatable.")
@click.option("--without", metavar="NAME", multiple=True, help="Leave out this instance and those below it. Repeatable.")
@click.option("--density", type=options.Value("density", density), help="Density, for masses: 1.24g/cm3 or 7850kg/m3.")
@click.option(
    "--deviation", metavar="LENGTH", type=options.Value("length", options.length),
    help="Greatest distance of triangles from the true surface (0.05mm). Default: 1/2000 of the scene.",
)
@click.option("--meter", "named", metavar="NAME", multiple=True, help="Read this light meter alone; * and ? match. Repeatable.")
@click.option("--daylight-factor", "daylight", is_flag=True, help="Daylight factors of meters, under the CIE overcast sky.")
@click.option(
    "--luminance", "regions", metavar="X,Y", multiple=True, type=options.Value("pixels", region),
    help="Luminance of a pixel of the picture, or of a region x0,y0,x1,y1. Repeatable.",
)
@click.option("--glare", is_flag=True, help="Unified glare rating at the camera.")
@click.option(
    "--error", type=options.Value("share", setting_values.share), default="1%", show_default=True,
    help="Measure light until errors are below this share.",
)
@click.option("--budget", type=options.Value("time", setting_values.duration), help="Most time for measuring light. Default: 1min.")
@shared.picture_options_except(*NOT_OF_LIGHT)
@click.option("--json", "as_json", is_flag=True, help="Print JSON, in metres, kilograms, lux, lumen and cd/m².")
@click.option(
    "-o", "outputs", type=shared.OUT, multiple=True,
    help="Write .json, a .csv of the light, or a .png of luminance in false colours. Repeatable.",
)
@shared.examples(
    "maquette measure part.scene --density 1.24g/cm3",
    "maquette measure part.scene --set width=30 --only lid --json",
    "maquette measure room.scene --meter desk -o lux.csv",
    "maquette measure room.scene --luminance 320,200 --glare -o luminance.png",
)
def command(
    scene: Path, only: tuple[str, ...], without: tuple[str, ...], density: float | None, deviation: float | None, as_json: bool,
    outputs: tuple[Path, ...], **settings: Any,
) -> None:  # fmt: skip
    """Measure the parts of SCENE: size, volume, area, center, mass, inertia; and its light.

    Each value has its error. A mesh that is open, wound both ways or crosses itself has no volume; lights and unbounded shapes are left
    out. The inertia is that about the center of mass, along x, y and z.

    Each meter of the scene tells its illuminance in lux. With an option of light, or for a .csv or .png, the light alone is measured. Its
    errors are those of 95 % confidence.
    """
    from ...measure.light import report

    _check_outputs(outputs)
    about_light = {name: settings.pop(name) for name in ("named", "daylight", "regions", "glare", "error", "budget")}
    source = shared.source_of(scene, settings)
    compiled = selected(shared.load(replace(source, mesh=replace(source.mesh, deviation=deviation))), only, without)
    for path in outputs:
        jobs.check_folder(path, map(Path, compiled.files))
    kinds = [path.suffix.lower() for path in outputs]
    only_light = any(about_light[name] for name in ("named", "daylight", "regions", "glare")) or ".csv" in kinds or ".png" in kinds
    parts = [] if only_light else _parts(compiled, deviation)
    light = _light(compiled, about_light, settings, bool(set(kinds) - {".png"}) or not outputs or bool(about_light["named"]))
    data: Any = [_as_data(part, density) for part in parts]
    if light is None and ".csv" in kinds:
        raise click.ClickException("a .csv holds light, and the scene has no light meter; place meter([0, 75cm, 0], size: [2, 1])")
    if light is not None:
        data = ({} if only_light else {"parts": data}) | report.as_data(light)
    if as_json:
        click.echo(json.dumps(data, indent=2))
    else:
        _print_parts(parts, density)
        for line in () if light is None else report.lines(light):
            click.echo(line)
    for path, kind in zip(outputs, kinds, strict=True):
        if kind == ".json":
            replace_file(path, (json.dumps(data, indent=2) + "\n").encode())
        elif kind == ".csv":
            replace_file(path, report.as_csv(light or report.Light()).encode())
        else:
            _false_colours(compiled, settings, about_light, path)


def _check_outputs(outputs: Sequence[Path]) -> None:
    for path in outputs:
        if path.suffix.lower() not in FILES:
            raise click.UsageError(f"measurements are written as .json, .csv (light) or .png (luminance): {path.name} is none of them")
        jobs.check_folder(path)
    if len({path.resolve() for path in outputs}) < len(outputs):
        raise click.UsageError("two files of -o are the same")


def _parts(compiled: ir.Scene, deviation: float | None) -> list[Properties]:
    """The parts of a scene. Raises ClickException without any, unless there are meters."""
    from ...render.tessellation import mass_properties

    parts, diagnostics = mass_properties.measure(compiled, deviation)
    terminal.report(diagnostics)
    if not parts and not compiled.meters:
        raise click.ClickException("the scene has no bounded surface to measure")
    return parts


def _light(compiled: ir.Scene, about_light: dict[str, Any], settings: dict[str, Any], reads_meters: bool) -> report.Light | None:
    """The light of a scene; None where there is none to measure. Raises ClickException."""
    from ...compiler import ir
    from ...measure.light import report, sensors

    meters = _chosen(compiled, about_light["named"])
    if about_light["daylight"] and not meters:
        raise click.ClickException("the scene has no light meter, of which daylight factors are; place meter([0, 75cm, 0], size: [2, 1])")
    reads_meters &= bool(about_light["named"]) or not (about_light["daylight"] or about_light["regions"] or about_light["glare"])
    if not (about_light["daylight"] or about_light["regions"] or about_light["glare"] or (meters and reads_meters)):
        return None
    daylight, regions, glare = (about_light[name] for name in ("daylight", "regions", "glare"))
    request = report.Request(meters, ir.Settings(**settings), reads_meters, daylight, regions, glare)
    try:
        light = report.measure(compiled, request, _effort(about_light, settings))
    except sensors.MeterError as fault:
        terminal.report([Diagnostic("error", str(fault), fault.meter.place, fault.hint)])
        raise click.exceptions.Exit(1) from None
    except ValueError as fault:
        raise click.ClickException(str(fault)) from None
    terminal.report(light.diagnostics)
    return light


def _effort(about_light: dict[str, Any], settings: dict[str, Any]) -> Any:
    from ...measure.light.replicates import Effort

    return Effort(about_light["error"], time.monotonic() + (about_light["budget"] or BUDGET), settings["threads"], settings["seed"] or 0)


def _chosen(compiled: ir.Scene, patterns: Sequence[str]) -> list[ir.Meter]:
    """The meters that a pattern matches, all without patterns. Raises UsageError for one that matches none."""
    from ...compiler.scene import selection

    if not patterns:
        return list(compiled.meters)
    names = [meter.name for meter in compiled.meters]
    try:
        matched = selection.named(names, patterns)
    except selection.SelectionError:
        wrong = next(p for p in patterns if p not in names)
        hint = suggest(wrong, names) or (f"there are: {', '.join(names)}" if names else "the scene has none")
        raise click.UsageError(f"no meter is called `{wrong}`; {hint}") from None
    return [meter for meter, keep in zip(compiled.meters, matched, strict=True) if keep]


def _false_colours(compiled: ir.Scene, settings: dict[str, Any], about_light: dict[str, Any], path: Path) -> None:
    """Draw the picture, and write its luminance in false colours."""
    from ...compiler import ir
    from ...measure.light import false_colour
    from ...render import picture_notes, render_scene
    from ...render.image import metrics

    picture_settings = ir.Settings(**settings, budget=about_light["budget"])
    plan = jobs.make_plan(compiled, picture_settings, {})
    terminal.report(picture_notes.plan_warnings(compiled, plan))
    image = render_scene.draw(compiled, plan)
    terminal.report(picture_notes.of_render(image.metadata, compiled, plan, picture_settings))
    replace_file(path, false_colour.picture(metrics.luminance(image.channels["rgba"][..., :3])))


def _print_parts(parts: Sequence[Properties], density: float | None) -> None:
    if not parts:
        return
    from ...render.tessellation import mass_properties

    largest = max(float((part.high - part.low).max()) for part in parts)
    unit, factor = ("mm", 1000.0) if largest < 1.0 else ("m", 1.0)
    for part in parts:
        click.echo("\n".join(_lines(part, unit, factor, density)))
    total = mass_properties.total(parts)
    if len(parts) > 1 and total is not None:
        click.echo(f"total volume  {_number(total, factor**3)} {unit}³" + (f", mass {_mass(total, density)}" if density else ""))


def _lines(part: Properties, unit: str, factor: float, density: float | None) -> list[str]:
    size = " × ".join(f"{side:.7g}" for side in (part.high - part.low) * factor)
    within = f" ± {2.0 * part.deviation * factor:.2g}" if part.deviation else ""
    area = f"none: {part.unbounded}" if part.area is None else f"{_number(part.area, factor**2)} {unit}²"
    lines = [part.name, f"  size     {size} {unit}{within}", f"  area     {area}", f"  mesh     {_topology(part)}"]
    if part.volume is None or part.center is None or part.inertia is None:
        return [*lines, f"  volume   none: {part.unbounded}"]
    lines.append(f"  volume   {_number(part.volume, factor**3)} {unit}³")
    center = ", ".join(f"{x:.6g}" for x in np.round(part.center.value * factor, 9) + 0.0)
    off = float(part.center.error.max())
    exact = off <= 1e-9 * float((part.high - part.low).max())
    lines.append(f"  center   [{center}] {unit}" + ("" if exact else f" ± {off * factor:.2g}"))
    if density:
        scale, name = (1e9, "g mm²") if unit == "mm" else (1.0, "kg m²")
        along = ", ".join(f"{x:.6g}" for x in np.diag(part.inertia.value) * density * scale)
        lines += [f"  mass     {_mass(part.volume, density)}", f"  inertia  [{along}] {name}"]
    return lines


def _topology(part: Properties) -> str:
    edges = part.topology
    bodies = f"{edges.bodies} bod{'y' if edges.bodies == 1 else 'ies'}, Euler number {edges.euler_number}"
    if edges.closed:
        return f"closed, {bodies}" + ("" if part.searched else "; too large to be searched for places where it crosses itself")
    if edges.watertight:
        return f"closed, not wound one way, {bodies}"
    return f"open at {edges.open_edges} edge{'s' * (edges.open_edges != 1)}, {bodies}"


def _mass(volume: Measured, density: float) -> str:
    unit, factor = ("g", 1000.0) if float(volume.value) * density < 1.0 else ("kg", 1.0)
    return f"{_number(volume, density * factor)} {unit}"


def _number(measured: Measured, factor: float) -> str:
    """A value rounded to two digits of its error, which follows."""
    value, error = float(measured.value) * factor, float(measured.error) * factor
    if error <= 1e-9 * abs(value):
        return f"{value:.10g}"
    digits = 1 - math.floor(math.log10(error))
    return f"{round(value, digits):,.{max(digits, 0)}f} ± {error:.2g}"


def _as_data(part: Properties, density: float | None) -> dict[str, Any]:
    data: dict[str, Any] = {"name": part.name, "low": part.low.tolist(), "high": part.high.tolist(), "deviation": part.deviation}
    edges = part.topology
    data["mesh"] = {
        "watertight": edges.watertight, "wound_one_way": edges.wound, "open_edges": edges.open_edges, "bodies": edges.bodies,
        "euler_number": edges.euler_number, "searched_for_crossings": part.searched,
    }  # fmt: skip
    data["no_volume"] = part.unbounded
    for name in ("area", "volume", "center", "inertia"):
        measured = getattr(part, name)
        scale = density or 1.0 if name == "inertia" else 1.0
        data[name] = None if measured is None else {key: (getattr(measured, key) * scale).tolist() for key in ("value", "error")}
    if density and part.volume is not None:
        data["mass"] = {key: (getattr(part.volume, key) * density).tolist() for key in ("value", "error")}
    return data
