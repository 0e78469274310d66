"""The `test` command: loads scenes, which runs their asserts, and compares their pictures with kept ones."""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ...compiler.io.replace_file import make_folder, replace_file
from ...lang import file_types
from ...lang.diagnostics import SceneError
from .. import common_options as shared
from .. import render_job as jobs
from .. import terminal
from ..progress import Display
from ..scene_tests import report as reports
from ..scene_tests.report import Result

if TYPE_CHECKING:
    from ...compiler import ir
    from ...measure.comparison.sides import Side

KEPT = "kept"  # folder beside a scene
LONGER_SIDE = 320  # pixels of pictures without --size
SAMPLES = 32  # without --samples and --error


@click.command("test")
@click.argument("paths", type=click.Path(exists=True, path_type=Path), nargs=-1, required=True)
@click.option("--update", is_flag=True, help="Keep the pictures of scenes that are new or differ.")
@click.option("-o", "--output", type=click.Path(path_type=Path, file_okay=False), help="Folder of a report: index.html with pictures.")
@click.option("--json", "as_json", is_flag=True, help="Print a record of each scene as JSON.")
@shared.scene_options
@shared.picture_options_except("aov", "crop", "exposure", "view", "display", "look", "white", "bloom", "denoise", "budget", "background")
@click.option("-q", "--quiet", is_flag=True, help="Print only failures.")
@shared.examples(
    "maquette test scenes --update", "maquette test scenes", "maquette test scenes -o report", "maquette test gear.scene"
)
@click.pass_context
def command(
    ctx: click.Context, paths: tuple[Path, ...], update: bool, output: Path | None, as_json: bool, quiet: bool, **options: Any
) -> None:  # fmt: skip
    """Test scenes: their asserts, and their pictures against kept ones.

    PATHS are scenes, or folders of .scene files. A picture is compared with kept/NAME.exr beside its scene, which --update writes. The
    tolerance is the noise of both pictures, for the whole picture and for blocks of 16 × 16 pixels. Pictures are 320 pixels wide
    and have 32 samples without --size and --samples; the kept ones decide their size. The exit code is 1 if a scene fails or is new.
    """
    if output is not None:
        output.mkdir(parents=True, exist_ok=True)
    results = []
    for name, path in _scenes(paths):
        began = time.perf_counter()
        result = _tested(name, path, update, output, quiet, dict(options))._replace(seconds=round(time.perf_counter() - began, 3))
        results.append(result)
        if not as_json and not (quiet and result.status == "passed"):
            click.echo(f"{result.status:8}{name}" + (f": {result.text}" if result.text else ""))
    counts = Counter(result.status for result in results)
    summary = ", ".join(f"{counts[status]} {status}" for status in ("passed", "updated", "failed", "new", "error") if counts[status])
    if output is not None:
        replace_file(output / "index.html", reports.page(results, f"{len(results)} scenes: {summary}").encode())
    if as_json:
        click.echo(json.dumps([result._asdict() for result in results], indent=2))
    else:
        click.echo(f"{len(results)} scenes: {summary}")
        if counts["new"]:
            click.echo("--update keeps the pictures of new scenes", err=True)
        if counts["failed"]:
            click.echo("-o FOLDER shows the differences; --update keeps the new pictures", err=True)
    ctx.exit(1 if counts["failed"] or counts["new"] or counts["error"] else 0)


def _scenes(paths: Sequence[Path]) -> Iterator[tuple[str, Path]]:
    """(name, file) of each scene once."""
    seen: set[Path] = set()
    for path in paths:
        files = sorted(p for p in path.rglob("*.scene") if not any(part.startswith(".") for part in p.relative_to(path).parts))
        for file in files if path.is_dir() else [path]:
            if not path.is_dir() and file.suffix.lower() not in file_types.OPENED:
                raise click.UsageError(f"{file} is not a scene: it ends in {', '.join(file_types.OPENED)}")
            if file.resolve() not in seen:
                seen.add(file.resolve())
                yield (file.relative_to(path).as_posix() if path.is_dir() else file.name), file
    if not seen:
        raise click.UsageError(f"there is no .scene file in {', '.join(map(str, paths))}")


def _tested(name: str, path: Path, update: bool, output: Path | None, quiet: bool, options: dict[str, Any]) -> Result:
    from ...measure.comparison import compare, difference_image, sides
    from ...render.image import image_files
    from ..scene_tests import verdict

    reference = path.parent / KEPT / f"{path.stem}.exr"
    try:
        before = _with_variance(sides.read(reference)) if reference.is_file() else None
    except image_files.FormatError as error:
        return Result(name, "error", str(error))
    terminal.report([] if before is None else before.warnings)
    try:
        rendered = _render(name, path, before, quiet, options)
    except SceneError as error:
        terminal.report(error.diagnostics)
        return Result(name, "error", "; ".join(d.message for d in error.diagnostics if d.severity == "error"))
    if before is None:
        if update:
            _keep(rendered, reference)
        return Result(name, "updated" if update else "new", f"kept {reference}" if update else f"there is no {reference}")
    if rendered.rgb.shape != before.rgb.shape:
        comparison = None
        judged = verdict.Verdict(f"it has {rendered.image.width}x{rendered.image.height} pixels, and {reference.name} has others", 1.0)
    else:
        comparison = compare.compare(rendered, before, None)
        judged = verdict.judge(comparison)
    picture = ""
    if output is not None and judged.why and comparison is not None:
        picture = reports.picture_name(name)
        difference_image.write(comparison, output / picture, True)
    if judged.why and update:
        _keep(rendered, reference)
        return Result(name, "updated", judged.why, picture)
    return Result(name, "failed" if judged.why else "passed", judged.why, picture)


def _render(name: str, path: Path, before: Side | None, quiet: bool, options: dict[str, Any]) -> Side:
    """The picture of a scene, with the size and the samples of the kept one unless others are asked for. Raises SceneError."""
    from ...compiler.plan import plan as planner
    from ...measure.comparison import sides

    source, settings, overrides = shared.read_options(path, options)
    scene, diagnostics = source.load({})
    terminal.report([d for d in diagnostics.items if d.severity == "error" or not quiet])
    size = settings.size or (before.image.metadata["size"] if before is not None else _size(scene, settings, overrides))
    about = before.image.metadata.get("about", {}) if before is not None else {}
    work = settings.samples or (None if settings.error else int(float(about.get("samples", SAMPLES))))
    try:
        plan = sides.make_plan(scene, replace(settings, size=size, samples=work), overrides)
    except planner.PlanError as error:
        raise click.UsageError(str(error)) from None
    with Display(quiet, name) as display, terminal.catch_interrupt() as cancel:
        side = sides.render(scene, plan, name, display, cancel)
    if side.image.metadata["partial"]:
        raise KeyboardInterrupt
    return side


def _with_variance(side: Side) -> Side:
    """The kept picture with its variance."""
    channels = dict(side.image.channels)
    variance = channels.pop("variance", None)
    metadata = {**side.image.metadata, "variance": variance}
    return replace(side, image=replace(side.image, channels=channels, metadata=metadata))


def _size(scene: ir.Scene, settings: ir.Settings, overrides: dict[str, str]) -> tuple[int, int]:
    """The size of the scene's picture, reduced to LONGER_SIDE pixels."""
    width, height = jobs.make_plan(scene, settings, overrides)["size"]
    scale = min(LONGER_SIDE / max(width, height), 1.0)
    return max(round(width * scale), 1), max(round(height * scale), 1)


def _keep(picture: Side, reference: Path) -> None:
    """Write the kept picture, with the figures that a comparison needs."""
    from ... import __version__
    from ...render.image import image_files

    assert picture.plan is not None
    make_folder(reference.parent)
    about: dict[str, str | int | float] = {
        "version": __version__, "backend": picture.plan["backend"], "seed": picture.plan["seed"],
        "samples": picture.image.metadata["samples"],
    }  # fmt: skip
    if picture.noise is not None:
        about["error"] = float(picture.noise)
    channels = {"rgba": picture.image.channels["rgba"]}
    if picture.variance is not None:
        channels["variance"] = picture.variance.astype("float32")
    image_files.write(replace(picture.image, channels=channels), reference, image_files.Look(), about)
