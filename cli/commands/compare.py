"""The `compare` command: two pictures, two scenes, or one scene on two backends."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ...lang import file_types
from ...lang.diagnostics import suggest
from ...lang.schema.picture_settings import PICTURE_SETTINGS
from ...measure.metric_table import compared
from .. import common_options as shared
from .. import compare_report as reports
from .. import option_types as values
from .. import render_job as jobs
from .. import terminal
from ..progress import Display

if TYPE_CHECKING:
    from ...compiler import ir
    from ...compiler.plan.plan import Plan
    from ...measure.comparison.compare import Comparison
    from ...measure.comparison.sides import Side

BACKENDS = PICTURE_SETTINGS["backend"].choices
SIDE_OPTIONS = ("samples", "error", "budget", "bounces", "seed")  # options in --backends; other names are decisions of the plan
FIGURES = {  # in a sentence
    **{name: metric.noun or metric.name for name, metric in compared().items()}, "bias": "the bias",
    "noise": "the difference over what noise alone makes", "significance": "the difference of the means in standard errors",
}  # fmt: skip
OF_SCENES = (  # parameters that need a scene
    "sets", "at", "allow", "variants", "purposes", "mask", "complexity", "no_default_light", "cull_backfaces", "conform",
    "render_settings",
    "session_layer", "max_elements", "ocio", "working_space",
    "backend", "size", "camera", "samples", "error", "budget", "bounces", "seed", "threads", "crop",
    "background", "plan_values",
)  # fmt: skip
SHARES = (*(name for name, metric in compared().items() if metric.share), "flip", "bias")  # shown in per cent


@dataclass(frozen=True, slots=True)
class BackendChoice:
    """One item of --backends: a backend with its options and plan decisions. `words` are both as written."""

    backend: str
    words: tuple[str, ...]
    options: Mapping[str, Any]
    decisions: Mapping[str, str]


def _backends(ctx: click.Context, param: click.Parameter, text: str | None) -> tuple[BackendChoice, ...] | None:
    """Read `raster,ray` or `ray:samples=4,ray:samples=64:seed=2`."""
    if text is None:
        return None
    items = [item.strip() for item in text.split(",")]
    if len(items) != 2 or not all(items):
        raise click.BadParameter(f"{text!r}: give two backends, as in raster,ray; the second is the reference", ctx, param)
    types = {option.name or "": option.type for option in ctx.command.params}
    return _backend_choice(ctx, param, items[0], types), _backend_choice(ctx, param, items[1], types)


def _backend_choice(ctx: click.Context, param: click.Parameter, item: str, types: Mapping[str, click.ParamType]) -> BackendChoice:
    backend, *words = item.split(":")
    if backend not in BACKENDS:
        message = f"no backend is called `{backend}`; there are {', '.join(BACKENDS)}"
        raise click.BadParameter(f"{message}. {suggest(backend, BACKENDS)}".rstrip(" ."), ctx, param)
    options, decisions = {}, {}
    for word in words:
        try:
            name, value = values.assignment(word)
        except ValueError:
            raise click.BadParameter(f"{word!r} in {item!r}: write it as name=value, as in ray:samples=4", ctx, param) from None
        if name in options or name in decisions:
            raise click.BadParameter(f"`{name}` is given twice in {item!r}", ctx, param)
        if name in SIDE_OPTIONS:
            options[name] = _convert(types[name], value, f"{word!r} in {item!r}", param, ctx)
        else:
            decisions[name] = value
    return BackendChoice(backend, tuple(words), options, decisions)


def _convert(kind: click.ParamType, value: str, where: str, param: click.Parameter, ctx: click.Context) -> Any:
    try:
        return kind.convert(value, param, ctx)
    except click.BadParameter as error:
        raise click.BadParameter(f"{where}: {error.message}", ctx, param) from None


@click.command("compare")
@click.argument("first", metavar="A", type=shared.FILE)
@click.argument("second", metavar="[B]", type=shared.FILE, required=False)
@click.option("--backends", metavar="A,B", callback=_backends, help="Render scene A twice: raster,ray or ray:samples=4,ray:samples=64.")
@click.option("-o", "--output", type=shared.OUT, help="Picture of A − B: in false colours, or as signed numbers in an .exr.")
@click.option("--side-by-side", is_flag=True, help="Show A, B and A − B next to each other in the picture, with labels.")
@click.option("--threshold", type=values.LIMIT, help="Exit with 1 if the metric is above this: 1%, or 0 for identical.")
@click.option("--metric", type=click.Choice(tuple(FIGURES)), help="Metric of --threshold. Default: relmse.")
@click.option("--json", "as_json", is_flag=True, help="Print all figures as JSON.")
@click.option("-q", "--quiet", is_flag=True, help="No progress.")
@shared.scene_options
@shared.picture_options_except("aov", "view", "display", "look", "white", "bloom")
@shared.examples(
    "maquette compare out.exr reference.exr --threshold 1% -o difference.png",
    "maquette compare room.scene --backends raster,ray --size 400x300",
    "maquette compare room.scene --backends ray:samples=16,ray:samples=1024:seed=1 --json",
    "maquette compare before.scene after.scene -o both.png --side-by-side",
    "maquette compare room.scene accepted.exr --metric flip --threshold 0.02",
)
@click.pass_context
def command(
    ctx: click.Context, first: Path, second: Path | None, backends: tuple[BackendChoice, ...] | None, output: Path | None,
    side_by_side: bool, as_json: bool, quiet: bool, **options: Any,
) -> None:  # fmt: skip
    """Measure the difference of A from B.

    A and B are pictures or scenes. A scene is rendered, at the size of the picture if the other one is a picture. B is the
    reference. In linear light, √relMSE is √mean((A − B)² / (B² + ε²)) with ε = 1% of the mean luminance of B. Exit
    code: 0; 1 if --threshold is exceeded or the two cannot be compared; 2 for wrong usage.
    """
    from ...measure.comparison import compare as measure
    from ...measure.comparison import difference_image

    threshold, metric = options.pop("threshold"), options.pop("metric")
    _check_usage(ctx, first, second, backends, output, side_by_side, (threshold, metric))
    exposure = options["exposure"]
    a, b = _sides(_Inputs(first, second or first, backends or (), options), quiet)
    if exposure is not None and a.bits and b.bits:
        raise click.UsageError(f"--exposure is for linear light, but both {first} and {second} were exposed when they were written")
    comparison = measure.compare(a, b, exposure)
    if output:
        difference_image.write(comparison, output, side_by_side)
    if as_json:
        click.echo(json.dumps(jobs.json_value(comparison.to_json()), indent=2))
    else:
        reports.show(comparison)
    _judge(ctx, comparison, metric or "relmse", threshold)


def _check_usage(
    ctx: click.Context, first: Path, second: Path | None, backends: object, output: Path | None, side_by_side: bool,
    judged: tuple[float | None, str | None],
) -> None:  # fmt: skip
    """Reject contradictory options before rendering."""
    if backends and second:
        raise click.UsageError("--backends renders one scene in two ways: give one scene, or leave out --backends")
    if backends and not _is_scene(first):
        raise click.UsageError(f"--backends renders a scene, but {first} is a picture")
    if backends and _is_given(ctx, "backend"):
        raise click.UsageError("--backend and --backends exclude each other")
    if not backends and not second:
        what = "--backends raster,ray renders it in two ways" if _is_scene(first) else "a second picture, or a scene"
        raise click.UsageError(f"{first} needs a second input B: {what}")
    if second and not _is_scene(first) and not _is_scene(second):
        options = [option for option in ctx.command.params if option.name in OF_SCENES and _is_given(ctx, option.name)]
        if options:
            raise click.UsageError(f"{options[0].opts[0]} is for scenes, but both {first} and {second} are pictures")
    if judged[1] and judged[0] is None:
        raise click.UsageError("--metric selects the metric of --threshold: give --threshold too")
    if side_by_side and not output:
        raise click.UsageError("--side-by-side writes a picture: give its file with -o")
    if output:
        jobs.check_output(output, inputs=[file for file in (first, second) if file])
        if side_by_side and output.suffix.lower() == ".exr":
            raise click.UsageError(f"--side-by-side writes a picture for viewing: {output.name} cannot be an .exr; write a .png")


def _is_given(ctx: click.Context, name: str | None) -> bool:
    return name is not None and ctx.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE


def _is_scene(path: Path) -> bool:

    return path.suffix.lower() in (*file_types.SCENE, *file_types.USD, *file_types.MESH, *file_types.SAVED)


@dataclass(frozen=True, slots=True)
class _Inputs:
    """The inputs: two files (the same file with `backends`) and the options."""

    first: Path
    second: Path
    backends: tuple[BackendChoice, ...]
    options: dict[str, Any]

    def name(self, k: int) -> str:
        """The name of side k: its file and its words in --backends, apart from samples and seed, which are shown for every render."""
        words = [word for word in self.backends[k].words if not word.startswith(("samples=", "seed="))] if self.backends else []
        return " ".join([str((self.first, self.second)[k]), *words])


def _sides(inputs: _Inputs, quiet: bool) -> tuple[Side, Side]:
    """Both sides, read or rendered. Files and sizes are checked before rendering."""
    from ...measure.comparison import sides
    from ...render import picture_notes
    from ...render.image import image_files as pictures

    paths = (inputs.first, inputs.second)
    try:
        ready = [None if _is_scene(path) else sides.read(path) for path in paths]
    except pictures.FormatError as error:
        raise click.ClickException(str(error)) from None
    terminal.report(warning for side in ready if side is not None for warning in side.warnings)
    scenes: dict[Path, ir.Scene] = {}
    plans: list[tuple[ir.Scene, Plan] | None] = []
    for k, path in enumerate(paths):
        if ready[k] is not None:
            plans.append(None)
            continue
        if path not in scenes:
            scenes[path] = shared.load(shared.source_of(path, dict(inputs.options)))
        plans.append((scenes[path], _plan(inputs, k, scenes[path], ready[1 - k])))
    _check_sizes(paths, ready, plans)
    terminal.report(warning for planned in plans if planned for warning in picture_notes.plan_warnings(*planned))
    for k, planned in enumerate(plans):
        if planned is not None:
            ready[k] = drawn = _draw(inputs.name(k), *planned, "AB"[k], quiet)
            about, plan = drawn.image.metadata, planned[1]
            late = picture_notes.late_drawing_warnings(about, plan, f"picture {'AB'[k]}")
            terminal.report([*picture_notes.budget_warnings(about, plan), *late])
    a, b = ready
    assert a is not None
    assert b is not None
    return a, b


def _plan(inputs: _Inputs, k: int, scene: ir.Scene, other: Side | None) -> Plan:
    """The plan of side k, with the size of the other side if that is a picture."""
    from ...compiler import ir
    from ...compiler.plan import plan as planner
    from ...measure.comparison import sides

    options = {name: value for name, value in inputs.options.items() if name in ir.Settings.__dataclass_fields__}
    settings, decisions = ir.Settings(**options), dict(inputs.options["plan_values"])
    if inputs.backends:
        wanted = inputs.backends[k]
        settings = replace(settings, backend=wanted.backend, **wanted.options)
        decisions |= wanted.decisions
    if other is not None:
        size, crop = other.image.metadata["size"], other.image.metadata["crop"]
        part = None if crop == (0, 0, *size) else crop
        settings = replace(settings, size=settings.size or size, crop=settings.crop or part)
    try:
        return sides.make_plan(scene, settings, decisions)
    except planner.PlanError as error:
        raise click.UsageError(str(error)) from None


def _check_sizes(paths: tuple[Path, Path], ready: list[Side | None], plans: list[tuple[ir.Scene, Plan] | None]) -> None:
    shapes, sentences = [], []
    for path, side, planned in zip(paths, ready, plans, strict=True):
        if side is not None:
            shapes.append((side.image.width, side.image.height))
        elif planned is not None:
            x0, y0, x1, y1 = planned[1]["crop"]
            shapes.append((x1 - x0, y1 - y0))
        sentences.append(f"{path} {'is' if side is not None else 'is rendered at'} {shapes[-1][0]}x{shapes[-1][1]}")
    if shapes[0] == shapes[1]:
        return
    if all(plans):
        least = min(shapes)
        fix = f"--size {least[0]}x{least[1]} makes both equal"
    elif any(plans):
        fix = "leave out --size and --crop, and the scene is rendered at the picture's size"
    else:
        fix = "render both with the same --size"
    raise click.ClickException(f"sizes differ: {sentences[0]} and {sentences[1]} pixels; {fix}")


def _draw(name: str, scene: ir.Scene, plan: Plan, letter: str, quiet: bool) -> Side:
    from ...measure.comparison import sides

    with Display(quiet, f"{letter} ({plan['backend']})") as display, terminal.catch_interrupt() as cancel:
        side = sides.render(scene, plan, name, display, cancel)
    if side.image.metadata["partial"]:
        raise KeyboardInterrupt
    return side


def _judge(ctx: click.Context, comparison: Comparison, metric: str, threshold: float | None) -> None:
    if threshold is None:
        return
    value = comparison.value(metric)
    if value is None:
        raise click.ClickException(f"{_why_unknown(comparison, metric)}; choose another --metric")
    if not value <= threshold:  # also for nan
        shown, limit = (reports.percent(v) if metric in SHARES else f"{v:.6g}" for v in (value, threshold))
        click.echo(f"{FIGURES[metric]} is {shown}, above the threshold of {limit}", err=True)
        ctx.exit(1)


def _why_unknown(comparison: Comparison, metric: str) -> str:
    """Why a figure is unknown for these two, and which input has it."""
    sides = (comparison.a, comparison.b)
    if metric == "silhouette":
        name = next(side.name for side in sides if side.coverage is None)
        return f"{name} has no alpha channel, which the silhouette needs: compare an .exr"
    if metric == "significance":
        name = next(side.name for side in sides if side.variance is None)
        return f"the variance of {name} is unknown: only a render with several samples has it: compare scenes"
    name = next(side.name for side in sides if side.noise is None)
    return f"the noise of {name} is unknown: only a render with several samples has it"
