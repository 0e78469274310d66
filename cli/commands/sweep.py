"""The `sweep` command: pictures of a scene over values of its params, on one labelled sheet."""

from __future__ import annotations

import itertools
import math
import re
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from ...compiler.io.replace_file import replacing
from ...lang.diagnostics import SceneError
from .. import common_options as shared
from .. import render_job as jobs
from .. import terminal

if TYPE_CHECKING:
    from ...compiler import ir

FONT = Path(__file__).resolve().parents[2] / "stdlib" / "fonts" / "DejaVuSans.ttf"
CELL = 240  # pixels, the longer side of a picture without --size
GAP = 8  # pixels between pictures
LABEL = 13  # pixels, size of the labels
MOST = 400  # pictures
SUFFIXES = (".png", ".jpg", ".jpeg", ".webp")
_RANGE = re.compile(r"(-?[\d.]+(?:e[+-]?\d+)?)([^\d.,\[\]]*)\.\.(-?[\d.]+(?:e[+-]?\d+)?)([^\d.,\[\]/]*)/(\d+)", re.IGNORECASE)


class Axis(NamedTuple):
    """A param with several values."""

    name: str
    values: tuple[str, ...]


def values_of(text: str) -> tuple[str, ...]:
    """The values of `1..5/3` (three from 1 to 5), or of `2,3,5`; of any other text itself. Raises ValueError."""
    match = _RANGE.fullmatch(text.replace(" ", ""))
    if not match:
        return tuple(part.strip() for part in _split(text))
    low, high, count = float(match[1]), float(match[3]), int(match[5])
    unit = match[4] or match[2]
    if match[2] and match[2] != unit:
        raise ValueError(f"{text} has two units: write 1cm..5cm/5")
    if not 2 <= count <= MOST:
        raise ValueError(f"{text} has {count} values: a range has 2 to {MOST}")
    return tuple(f"{low + (high - low) * k / (count - 1):.6g}{unit}" for k in range(count))


def _split(text: str) -> list[str]:
    """The parts of a text between commas that no bracket or quote encloses."""
    parts, depth, quoted = [""], 0, False
    for c in text:
        quoted ^= c == '"'
        depth += 0 if quoted else (c in "[(") - (c in "])")
        if c == "," and depth == 0 and not quoted:
            parts.append("")
        else:
            parts[-1] += c
    return parts


@click.command("sweep")
@click.argument("scene", type=shared.FILE)
@click.option("-o", "--output", type=shared.OUT, help="Picture file of the sheet: .png, .jpg or .webp. Default: SCENE.sweep.png.")
@shared.scene_options
@shared.picture_options_except("aov", "crop")
@shared.CLUSTER
@click.option("-q", "--quiet", is_flag=True, help="Print only errors and warnings.")
@shared.examples(
    "maquette sweep hello.scene --set radius=0.4..1.6/4",
    "maquette sweep gear.scene --set teeth=8,12,16 --set width=1cm..3cm/3 --size 320x240 -o gears.png",
    "maquette sweep room.scene --set sun=0deg..80deg/9 --cluster tcp://host:8786",
)
def command(scene: Path, output: Path | None, cluster: str | None, quiet: bool, **options: Any) -> None:
    """Render SCENE over values of its params, on one labelled sheet.

    --set name=A..B/N takes N values from A to B, --set name=A,B,C takes these. The first such param goes along the rows, the others
    go down. A --set with one value holds for all pictures. A picture with an error is left blank, and the exit code is 1.
    """
    output = output or Path(f"{scene.stem}.sweep.png")
    if output.suffix.lower() not in SUFFIXES:
        raise click.UsageError(f"cannot tell the picture format of {output}: its name must end in one of {', '.join(SUFFIXES)}")
    jobs.check_folder(output, [scene])
    axes = _axes(options)
    shared.check_cluster(cluster, options)
    source, settings, overrides = shared.read_options(scene, options)
    settings = settings if settings.size else replace(settings, size=_cell_size(source, axes, settings, overrides))
    along, down = axes[0], axes[1:]
    rows = list(itertools.product(*(axis.values for axis in down)))
    job, failed = jobs.Job(source, settings, overrides, output, None, quiet), 0
    with shared.connect(cluster) as job.cluster, tempfile.TemporaryDirectory() as folder:
        files: list[Path | None] = []
        for row in rows:
            for value in along.values:
                file = Path(folder) / f"{len(files)}.png"
                sets = {**source.sets, along.name: value, **{axis.name: entry for axis, entry in zip(down, row, strict=True)}}
                drawn = _draw(job, replace(source, sets=sets), file, f"picture {len(files) + 1} of {len(rows) * len(along.values)}")
                files.append(file if drawn else None)
                failed += not drawn
        labels = [", ".join(f"{axis.name} {entry}" for axis, entry in zip(down, row, strict=True)) for row in rows]
        sheet = _sheet(files, [f"{along.name} {value}" for value in along.values], labels, settings.size or (CELL, CELL))
        jobs.check_folder(output, job.files)
        with replacing(output) as partial:
            sheet.save(partial)
    if not quiet:
        click.echo(f"{output}: {len(files)} pictures" + (f", {failed} of them with errors" if failed else ""))
    if failed:
        raise click.exceptions.Exit(1)


def _axes(options: dict[str, Any]) -> list[Axis]:
    """The params with several values, which are removed from `options`. Raises UsageError."""
    axes = []
    for name, text in list(options["sets"].items()):
        try:
            values = values_of(text)
        except ValueError as error:
            raise click.UsageError(str(error)) from None
        if len(values) > 1:
            axes.append(Axis(name, values))
            del options["sets"][name]
    if not axes:
        raise click.UsageError("no param has several values: write --set radius=0.4..1.6/4 or --set teeth=8,12,16")
    count = math.prod(len(axis.values) for axis in axes)
    if count > MOST:
        raise click.UsageError(f"that would be {count:,} pictures: a sheet has at most {MOST}")
    return axes


def _cell_size(source: jobs.Source, axes: Sequence[Axis], settings: ir.Settings, overrides: dict[str, str]) -> tuple[int, int]:
    """The size of the scene's picture, reduced to CELL pixels."""
    first, _ = replace(source, sets={**source.sets, **{axis.name: axis.values[0] for axis in axes}}).load({})
    width, height = jobs.make_plan(first, settings, overrides)["size"]
    scale = min(CELL / max(width, height), 1.0)
    return max(round(width * scale), 1), max(round(height * scale), 1)


def _draw(job: jobs.Job, source: jobs.Source, file: Path, what: str) -> bool:
    """Render one picture of the sheet; False after printing its errors."""
    job.source = source
    try:
        job.draw(file, what)
    except SceneError as error:
        job.display.hide()
        terminal.report(error.diagnostics)
        return False
    return True


def _sheet(files: Sequence[Path | None], across: Sequence[str], down: Sequence[str], size: tuple[int, int]) -> Any:
    """The sheet: pictures in rows, a label above each column and beside each row."""
    from PIL import Image, ImageDraw, ImageFont

    # Without Raqm, because Pillow's HarfBuzz gives wrong widths in a process that has loaded another HarfBuzz.
    font = ImageFont.truetype(str(FONT), LABEL, layout_engine=ImageFont.Layout.BASIC)
    margin = GAP + math.ceil(max(font.getlength(text) for text in down)) if any(down) else 0
    top = LABEL + 2 * GAP
    step = max(size[0], math.ceil(max(font.getlength(text) for text in across))) + GAP
    sheet = Image.new("RGB", (margin + GAP + step * len(across), top + (size[1] + GAP) * len(down)), "white")
    draw = ImageDraw.Draw(sheet)
    for k, text in enumerate(across):
        draw.text((margin + GAP + k * step, GAP), text, "black", font)
    for k, text in enumerate(down):
        draw.text((GAP, top + k * (size[1] + GAP)), text, "black", font)
    for k, file in enumerate(files):
        corner = margin + GAP + k % len(across) * step, top + k // len(across) * (size[1] + GAP)
        if file is None:
            draw.rectangle((*corner, corner[0] + size[0] - 1, corner[1] + size[1] - 1), outline="red")
            draw.text((corner[0] + GAP, corner[1] + GAP), "error", "red", font)
            continue
        with Image.open(file) as picture:
            sheet.paste(picture.convert("RGB"), corner, picture if picture.mode == "RGBA" else None)
    return sheet
