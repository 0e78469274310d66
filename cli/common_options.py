"""Option decorators shared by commands, and the conversion of options to source, settings and scene."""

from __future__ import annotations

import contextlib
import gc
import inspect
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..compiler.io.regular_files import is_regular
from ..lang import file_types
from ..lang.limits import MAX_ELEMENTS
from ..lang.schema.picture_settings import PICTURE_SETTINGS, PictureSetting
from . import option_types as values
from . import render_job as jobs
from . import terminal

if TYPE_CHECKING:
    from ..compiler import ir

Command = Callable[..., Any]
GC_THRESHOLD = 20_000  # new objects between garbage collections; Python's default of 700 takes 3 % of a redraw


def raise_gc_threshold() -> None:
    """Run Python's garbage collector less often. Reference counting frees images and tables."""
    gc.set_threshold(GC_THRESHOLD)


def examples(*lines: str) -> Callable[[Command], Command]:
    """A decorator that appends examples to the --help of a command."""

    def add(command: Command) -> Command:
        command.__doc__ = f"{inspect.cleandoc(command.__doc__ or '')}\n\n\b\nExamples:\n" + "\n".join(f"  {line}" for line in lines)
        return command

    return add


def listing(title: str, *lines: str) -> Callable[[Command], Command]:
    """A decorator that appends a list to the --help of a command, before its examples."""

    def add(command: Command) -> Command:
        command.__doc__ = f"{inspect.cleandoc(command.__doc__ or '')}\n\n\b\n{title}\n" + "\n".join(f"  {line}" for line in lines)
        return command

    return add


def options(*decorators: Callable[[Command], Command]) -> Callable[[Command], Command]:
    """Several click options as one decorator, in order."""

    def add(command: Command) -> Command:
        for decorator in reversed(decorators):
            command = decorator(command)
        return command

    return add


def _pairs(ctx: click.Context, param: click.Parameter, values: Sequence[tuple[str, str]]) -> dict[str, str]:
    pairs = dict(values)
    if len(pairs) < len(values):
        twice = next(name for name, _ in values if [n for n, _ in values].count(name) > 1)
        raise click.BadParameter(f"`{twice}` is given twice", ctx, param)
    return pairs


class _OrdinaryFile(click.Path):
    """A file that a library opens by its name: it would wait for the writer of a pipe."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        path = super().convert(value, param, ctx)
        if not is_regular(Path(value)):
            self.fail(f"{value} is a device, a pipe or a socket: give the name of a file", param, ctx)
        return path


FILE = click.Path(exists=True, dir_okay=False, path_type=Path)
LAYER = _OrdinaryFile(exists=True, dir_okay=False, path_type=Path)
OUT = click.Path(path_type=Path)
CLUSTER = click.option(
    "--cluster", metavar="ADDRESS",
    help="Render on the workers of a Dask scheduler, tcp://host:8786, or in local:N, N processes of this machine.",
)  # fmt: skip

allow = click.option("--allow", type=click.Path(exists=True, path_type=Path), multiple=True, help="Allow reading files below this folder.")

scene_options = options(
    click.option("--set", "sets", type=values.ASSIGNMENT, multiple=True, callback=_pairs, help="Set a param of the scene."),
    click.option("--time", "at", type=values.SECONDS, help="Time in an animation: 2s."),
    allow,
    click.option("--variant", "variants", type=values.VARIANT, multiple=True, callback=_pairs, help="Select a USD variant."),
    click.option("--purposes", type=values.PURPOSES, help="USD purposes drawn beside default: render,proxy,guide. Default: render."),
    click.option("--mask", type=values.CHANNELS, help="Read only these prims of a USD stage and those they use: /World/Chair,/World/Lamp."),
    click.option("--complexity", type=values.COMPLEXITY, help="Refinement of USD subdivision surfaces: low, medium, high or veryhigh."),
    click.option("--no-default-light", is_flag=True, help="Add no light to a USD stage without lights."),
    click.option("--cull-backfaces", is_flag=True, help="Draw USD meshes that are not doubleSided from their front alone."),
    click.option(
        "--conform", type=click.Choice(["vertical", "horizontal", "expand", "crop", "pixels"]),
        help="The part of its film that a USD camera keeps in a picture of another aspect; `pixels` stretches it. Default: vertical.",
    ),
    click.option("--render-settings", metavar="PRIM", help="RenderSettings or RenderProduct prim. Default: the one that the stage names."),
    click.option(
        "--unit", type=click.Choice(list(file_types.UNITS)),
        help=f"What 1 is in a mesh file. Default: as the file says; {file_types.assumed('unit')}.",
    ),
    click.option(
        "--up", type=click.Choice(file_types.AXES),
        help=f"Axis of a mesh file that points up. Default: as the file says; {file_types.assumed('up')}.",
    ),
    click.option("--animation", metavar="NAME", help="Animation of a glTF file: its name or number. Default: the first."),
    click.option("--repair", is_flag=True, default=None, help="Repair mesh files: merge vertices, wind faces one way, fill holes."),
    click.option("--session-layer", type=LAYER, help="USD layer whose values go over those of the stage."),
    click.option(
        "--max-elements", type=click.IntRange(1), help=f"Limit of the elements that a scene makes and places. Default: {MAX_ELEMENTS:,}."
    ),
)


def _picture_option(setting: PictureSetting) -> Callable[[Command], Command]:
    """The option of a setting."""
    if setting.kind == "flag":
        return click.option(f"--{setting.name}/--no-{setting.name}", default=None, help=setting.help)
    if setting.limits:
        kind: click.ParamType = click.IntRange(*setting.limits)
    else:
        kind = click.Choice(setting.choices) if setting.choices else values.Value(setting.kind, setting.read)
    return click.option(f"--{setting.name.replace('_', '-')}", type=kind, help=setting.help)


_PICTURE = {
    **{name: _picture_option(setting) for name, setting in PICTURE_SETTINGS.items() if setting.help},
    "plan": click.option(
        "--plan", "plan_values", type=values.ASSIGNMENT, multiple=True, callback=_pairs, help="Override a decision of explain."
    ),
}


ocio = _PICTURE["ocio"]


def picture_options_except(*names: str) -> Callable[[Command], Command]:
    """`picture_options` without these."""
    assert set(names) <= set(_PICTURE), names
    return options(*(option for name, option in _PICTURE.items() if name not in names))


picture_options = picture_options_except()


def source_of(scene: Path, options: dict[str, Any]) -> jobs.Source:
    """The source of the options of `scene_options`, which are removed from `options`."""
    from ..compiler.importers.common.mesh_options import MeshOptions
    from ..compiler.importers.stage_options import StageOptions

    names = ("variants", "purposes", "cull_backfaces", "conform", "render_settings", "session_layer")
    of_stage = {name: options.pop(name) for name in names}
    stage = StageOptions(
        **of_stage, mask=options.pop("mask") or (), complexity=options.pop("complexity") or 0,
        default_light=not options.pop("no_default_light"), size=options.get("size"),
    )  # fmt: skip
    mesh = MeshOptions(*(options.pop(name) for name in ("unit", "up", "animation", "repair")))
    first = (options.pop("sets"), options.pop("at"), options.pop("allow"))
    return jobs.Source(scene, *first, stage, mesh, options.pop("max_elements"), options.get("ocio"))


def read_options(scene: Path, options: dict[str, Any]) -> tuple[jobs.Source, ir.Settings, dict[str, str]]:
    """The source, settings and plan overrides of a command with `scene_options` and `picture_options`."""
    from ..compiler import ir

    if options.get("samples") is not None and options.get("error") is not None:
        raise click.UsageError("--samples and --error exclude each other: --samples sets the work, --error the quality")
    source, overrides = source_of(scene, options), options.pop("plan_values")
    return source, ir.Settings(**options), overrides


def asked_look(settings: ir.Settings) -> Any:
    """The image_files.Look that settings ask for."""
    from ..render.image import image_files

    return image_files.Look.asked(settings)


def load(source: jobs.Source) -> ir.Scene:
    """The compiled scene. Prints diagnostics. Raises SceneError."""
    scene, diagnostics = source.load({})
    terminal.report(diagnostics.items)
    return scene


def check_cluster(address: str | None, options: dict[str, Any]) -> None:
    """Raise UsageError for picture options that exclude a cluster."""
    if address is not None and options["threads"] is not None:
        raise click.UsageError("--cluster and --threads exclude each other: give each worker its threads, as in `dask worker --nthreads 8`")


def connect(address: str | None) -> contextlib.AbstractContextManager[Any]:
    """The session on a cluster; None without one."""
    if address is None:
        return contextlib.nullcontext()
    from .cluster import session

    return session.connect(address)
