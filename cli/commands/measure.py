"""The `measure` command: size, area, topology, volume, center, mass and inertia of the parts of a scene, each with its error."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from .. import common_options as shared
from .. import option_types as options
from .. import terminal
from ..scene_selection import selected

if TYPE_CHECKING:
    from ...render.tessellation.mass_properties import Measured, Properties

DENSITIES = {"kg/m3": 1.0, "kg/m³": 1.0, "g/cm3": 1000.0, "g/cm³": 1000.0}


def density(text: str) -> float:
    """`1.24g/cm3`, `7850kg/m3`, or a bare number of kilograms a cubic metre; above zero."""
    found = re.fullmatch(r"\s*([0-9.]+(?:e[+-]?\d+)?)\s*(\S*)\s*", text, re.IGNORECASE)
    try:
        value = float(found[1]) * DENSITIES[found[2] or "kg/m3"] if found else 0.0
    except (KeyError, ValueError):
        value = 0.0
    if not 0.0 < value < math.inf:
        raise ValueError("a density is written 1.24g/cm3 or 7850kg/m3, and is more than 0")
    return value


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
@click.option("--json", "as_json", is_flag=True, help="Print JSON, in metres and kilograms.")
@shared.examples(
    "maquette measure part.scene --density 1.24g/cm3",
    "maquette measure part.scene --set width=30 --only lid --json",
)
def command(
    scene: Path, only: tuple[str, ...], without: tuple[str, ...], density: float | None, deviation: float | None, as_json: bool,
    **given: Any,
) -> None:  # fmt: skip
    """Measure the parts of SCENE: size, volume, area, center, mass, inertia.

    Each value has its error. A mesh that is open, wound both ways or crosses itself has no volume; lights and unbounded shapes are left
    out. The inertia is that about the center of mass, along x, y and z.
    """
    from ...render.tessellation import mass_properties

    source = shared.source_of(scene, given)
    compiled = selected(shared.load(replace(source, mesh=replace(source.mesh, deviation=deviation))), only, without)
    parts, found = mass_properties.measure(compiled, deviation)
    terminal.report(found)
    if not parts:
        raise click.ClickException("the scene has no bounded surface to measure")
    if as_json:
        click.echo(json.dumps([_as_data(part, density) for part in parts], indent=2))
        return
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
    lines = [part.name, f"  size     {size} {unit}{within}", f"  area     {_number(part.area, factor**2)} {unit}²"]
    lines.append(f"  mesh     {_topology(part)}")
    if part.volume is None or part.center is None or part.inertia is None:
        return [*lines, f"  volume   none: {part.unbounded}"]
    lines.append(f"  volume   {_number(part.volume, factor**3)} {unit}³")
    center = ", ".join(f"{x:.6g}" for x in np.round(part.center.value * factor, 9) + 0.0)
    off = float(part.center.error.max())
    known = off <= 1e-9 * float((part.high - part.low).max())
    lines.append(f"  center   [{center}] {unit}" + ("" if known else f" ± {off * factor:.2g}"))
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
