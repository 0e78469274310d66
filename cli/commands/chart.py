"""The `chart` command: measures error against time, or redraws a chart from its .json file."""

from __future__ import annotations

import importlib
import shlex
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ...compiler.io.regular_files import MAX_DATA, read_text
from ...compiler.io.replace_file import replace_file
from ...lang.diagnostics import Diagnostic, suggest
from ...lang.schema.picture_settings import BACKENDS
from ...measure.metric_table import option_names
from ...render.film.progress import Progress
from .. import common_options as shared
from .. import option_types as values
from .. import render_job as jobs
from .. import terminal
from ..job import start_time
from ..process import supervisor
from ..progress import Display

if TYPE_CHECKING:
    from ...measure.records import Answer, Chart

KINDS = (".svg", ".png", ".html")
PEERS = ("mitsuba", "povray")
BUDGET = 60.0  # seconds
TARGET = 0.02  # √relMSE


def _names_of(allowed: Sequence[str], what: str) -> Any:
    """A click callback for a comma-separated list of distinct known names."""

    def read(ctx: click.Context, param: click.Parameter, text: str | None) -> tuple[str, ...]:
        names = tuple(name.strip() for name in (text or "").split(",") if name.strip())
        if text is not None and not names:
            raise click.BadParameter(f"separate names by commas, as in {','.join(allowed[:2])}", ctx, param)
        for i, name in enumerate(names):
            if name not in allowed:
                hint = suggest(name, allowed)
                message = f"no {what} is called `{name}`; there are {', '.join(allowed)}"
                raise click.BadParameter(f"{message}; {hint}" if hint else message, ctx, param)
            if name in names[:i]:
                raise click.BadParameter(f"`{name}` is given twice", ctx, param)
        return names

    return read


@click.command("chart")
@click.argument("scene", type=shared.FILE)
@click.option(
    "-o", "--output", "outputs", type=shared.OUT, multiple=True,
    help="Chart file: .svg, .png or .html; repeat the option for several. Default: SCENE.chart.svg in this folder.",
)  # fmt: skip
@shared.scene_options
@shared.ocio
@click.option("--size", type=values.SIZE, help="Pixels: 320x240, or 256 for a square. Default: the scene's, at most 160 wide or high.")
@click.option("--camera", metavar="NAME", help="Name of the camera.")
@click.option(
    "--backends", metavar="NAMES", callback=_names_of(BACKENDS, "backend"),
    help="Default: ray,raster,reference, without those that are known to lack light.",
)
@click.option("--peers", metavar="NAMES", callback=_names_of(PEERS, "peer"), help="Installed renderers to measure too: mitsuba,povray.")
@click.option("--metric", type=click.Choice(option_names()), help="Error metric of the chart. Default: relmse. The .json file has all.")
@click.option("--budget", type=values.DURATION, help=f"Time limit, including the reference. Default: {BUDGET:g}s.")
@click.option("--error", type=values.SHARE, help=f"√relMSE of the question that the first line answers. Default: {TARGET:.0%}.")
@click.option("--seeds", type=click.IntRange(2, 1024), help="Renders per setting with different random numbers.")
@click.option("--repeats", type=click.IntRange(1, 1024), help="Least number of timed renders per setting.")
@click.option("--threads", type=click.IntRange(1, 1024), help="Number of threads of every renderer. Default: one a core.")
@click.option("--bounces", type=click.IntRange(0, 64), help="Surface interactions after the first hit, also of the reference.")
@click.option("--vary", type=click.Choice(("bounces",)), multiple=True, help="Vary a setting that the scene fixes by render(…).")
@click.option("--keep", type=shared.OUT, help="Save the raw images (.exr) and the reference to this folder.")
@click.option("--json", "numbers", type=shared.OUT, help="File of all numbers. Default: the name of the first chart, as .json.")
@click.option("-q", "--quiet", is_flag=True, help="No progress, no notes.")
@shared.examples(
    "maquette chart room.scene -o room.svg",
    "maquette chart room.scene -o room.html -o room.png --size 200x150 --backends ray,raster --budget 5min",
    "maquette chart hello.scene -o hello.svg --peers mitsuba,povray --metric flip --keep raw",
    "maquette chart room.json -o room.html",
)
@click.pass_context
def command(
    ctx: click.Context, scene: Path, outputs: tuple[Path, ...], metric: str | None, numbers: Path | None, quiet: bool, **options: Any
) -> None:  # fmt: skip
    """Measure error against time over backends and settings.

    Each backend renders a sequence of settings of rising quality, each with several seeds. The chart shows a line for each
    sequence, all points, bars for quartiles, the Pareto front, the knee, and the uncertainty of the reference. The first line
    answers which command has the error of --error, and 1, 2, 5 and 10 %, in the least time, by a model of the runs. The tables list
    these commands, and the fastest measured setting for each error. Where the budget has no time for a reference, short runs tell
    their own errors. With the .json file of an earlier chart as SCENE, the chart is redrawn without measuring.

    Exit code: 0; 1 if nothing could be measured; 2 for wrong usage; 130 after Ctrl-C, with a chart of the measurements so far.
    """
    start = start_time.take()
    outputs = outputs or (Path(f"{scene.stem.removesuffix('.chart')}.chart.svg"),)
    _check_outputs(outputs)
    if scene.suffix.lower() == ".json":
        _check_redraw(ctx)
        measured, partial = _read(scene), False
    else:
        numbers = numbers or outputs[0].with_suffix(".json")
        _check_numbers(numbers, ctx)
        measured, partial = _measure(scene, metric or "relmse", quiet, options, start)
    for path in outputs:
        _draw(measured, path)
    if numbers:
        from ...measure.report import json_format

        replace_file(numbers, json_format.dump(measured).encode())
    _print(measured, (*outputs, *((numbers,) if numbers else ())), quiet)
    if scene.suffix.lower() != ".json" and not partial:
        terminal.report(_late_warnings(options["budget"] or BUDGET, start))
    if partial:
        click.echo("interrupted: the chart has the measurements so far", err=True)
        ctx.exit(130)


def _late_warnings(budget: float, start: start_time.StartTime) -> list[Diagnostic]:
    """The warning about a chart that took longer than its budget."""
    from ...render import picture_notes
    from ...render.film.deadline import Deadline
    from ...render.jit import compile_events

    warnings = picture_notes.late_warnings({}, Deadline(budget, start.began, processed=start.processed), "the chart")
    if compile_events.compiled():
        return [replace(late, message=f"{late.message}: it compiled kernels, once", hint="measure again") for late in warnings]
    return warnings


def _check_outputs(outputs: Sequence[Path]) -> None:
    for i, path in enumerate(outputs):
        if path.suffix.lower() not in KINDS:
            raise click.UsageError(f"a chart is written as {', '.join(KINDS[:-1])} or {KINDS[-1]}: {path} is none of them")
        if path in outputs[:i]:
            raise click.UsageError(f"{path} is given twice")
        jobs.check_folder(path)


def _check_redraw(ctx: click.Context) -> None:
    """Reject options of measuring for a chart that is only redrawn."""
    drawing = ("scene", "outputs", "numbers", "quiet")
    for option in ctx.command.params:
        if option.name and option.name not in drawing and ctx.get_parameter_source(option.name) is click.core.ParameterSource.COMMANDLINE:
            file = ctx.params["scene"]
            raise click.UsageError(f"{option.opts[0]} is for measuring, but {file} is a finished chart, which is only redrawn")


def _check_numbers(path: Path, ctx: click.Context) -> None:
    """Check the file of numbers. A file of the default name is replaced only if it is a chart."""
    from ...measure.report import json_format

    jobs.check_folder(path)
    if ctx.params["numbers"] is None and path.exists():
        try:
            json_format.read(read_text(path, MAX_DATA))
        except (json_format.FormatError, UnicodeDecodeError):
            raise click.UsageError(f"{path} exists and is not a chart: choose a file for the numbers with --json FILE") from None


def _read(path: Path) -> Chart:
    from ...measure.report import json_format

    try:
        return json_format.read(read_text(path, MAX_DATA))
    except (json_format.FormatError, UnicodeDecodeError) as error:
        raise click.ClickException(f"{path}: {error}") from None


def _measure(path: Path, metric: str, quiet: bool, options: dict[str, Any], start: start_time.StartTime) -> tuple[Chart, bool]:
    """The chart, and whether Ctrl-C ended the measurement. Raises ClickException without measurements."""
    from ...compiler import ir
    from ...compiler.plan import plan as planner

    source = shared.source_of(path, options)
    named = _command_line(source)
    scene, diagnostics = source.load({})
    importlib.import_module("...render.render_scene", __package__)  # as a picture does
    loading = time.perf_counter() - start.began, time.process_time() - start.processed
    from ...measure import records
    from ...measure.chart import engine

    terminal.report(d for d in diagnostics.items if not (quiet and d.severity == "note"))
    bounces = options["bounces"]
    if bounces is not None and options["vary"]:
        raise click.UsageError("--bounces fixes the number of bounces and --vary bounces varies it: give one of them")
    if not options["vary"] and bounces is None:
        bounces = scene.settings.bounces
    settings = ir.Settings(size=options["size"], camera=options["camera"], threads=options["threads"], bounces=bounces)
    wanted = records.Wanted(
        name=named, settings=settings, backends=options["backends"] or BACKENDS, peers=options["peers"], metric=metric,
        budget=options["budget"] or BUDGET, began=start.began, loading=loading, seeds=options["seeds"], repeats=options["repeats"],
        keep=options["keep"], target=options["error"] or TARGET, backends_named=bool(options["backends"]),
    )  # fmt: skip
    with Display(quiet) as display, terminal.catch_interrupt() as cancel:
        try:
            measured = engine.measure(scene, wanted, lambda done, total: display(Progress("measuring", done / total)), cancel)
        except planner.PlanError as error:
            raise click.UsageError(str(error)) from None
        except records.NothingMeasured as error:
            if cancel.is_set():
                raise KeyboardInterrupt from None
            if error.answers:
                display.hide()
                _print_answers(error.answers, named, error.size)
            raise click.ClickException(str(error)) from None
    if cancel.is_set():
        supervisor.finishing()
    return measured, cancel.is_set()


def _command_line(source: jobs.Source) -> str:
    """The scene and its options in the syntax of the command line."""
    words = [str(source.path)]
    for name, value in source.sets.items():
        words += ["--set", f"{name}={value}"]
    if source.time is not None:
        words += ["--time", f"{source.time:g}s"]
    for folder in source.allow:
        words += ["--allow", str(folder)]
    return shlex.join([*words, *source.stage.words(), *source.mesh.words()])


def _draw(measured: Chart, path: Path) -> None:
    """Write the chart in the format of the file's extension."""
    from ...measure.report import html_page, plot

    kind = path.suffix.lower()
    if kind == ".png":
        data = plot.png(measured)
    else:
        drawing = plot.svg(measured)
        data = (drawing if kind == ".svg" else html_page.html(measured, drawing)).encode()
    replace_file(path, data)


def _print_answers(answers: Sequence[Answer], scene: str, size: tuple[int, int]) -> None:
    """Print the line of answers and the table of their commands."""
    from ...measure.report import text_report

    click.echo(text_report.first_line(answers))
    rows = text_report.commands(answers, scene, size)
    if rows:
        terminal.table(text_report.COMMANDS, rows)


def _print(measured: Chart, files: Sequence[Path], quiet: bool) -> None:
    """Print the table of advice to stdout and the file names to stderr."""
    from ...measure.report import text_report

    _print_answers(text_report.answers_of(measured), measured.scene, measured.size)
    terminal.table(text_report.HEADINGS, text_report.advice(measured))
    for line in text_report.remarks(measured):
        click.echo(line)
    if not quiet:
        click.echo(f"in {', '.join(map(str, files))}", err=True)
