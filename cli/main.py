"""Entry point of the `maquette` command. Exit codes: 0 done, 1 errors, 2 wrong usage, 130 interrupted."""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from .. import __version__
from ..compiler.io.environment import SettingError
from ..lang import file_types
from ..lang.diagnostics import SceneError, sort_diagnostics
from . import common_options as shared
from . import memory, terminal
from . import option_types as values
from . import render_job as jobs
from .job import geometry_costs, start_time

COMMANDS = {  # in the order of --help, which imports none of them
    "new": "Write the starter scene NAME.scene.",
    "render": "Render SCENE to a picture or an animation.",
    "check": "Report errors and warnings in SCENES without rendering.",
    "inspect": "Show the compiled SCENE.",
    "explain": "Show the render plan of SCENE with reasons.",
    "chart": "Measure error against time over backends and settings.",
    "compare": "Measure the difference of A from B.",
    "watch": "Show SCENE in a window that follows edits, or write a picture at every save.",
    "test": "Test scenes: their asserts, and their pictures against kept ones.",
    "sweep": "Render SCENE over values of its params, on one labelled sheet.",
    "thumbnail": "Draw a picture of each of ASSETS, which are files or folders of them.",
    "convert": "Convert IN for other programs.",
    "measure": "Measure the parts of SCENE: size, volume, area, center, mass, inertia.",
    "format": "Format SCENEs in place; - reads a scene from stdin and writes it to stdout.",
    "lsp": "Serve an editor: errors while typing, completion, docs, renames.",
    "doctor": "Show what this installation renders with.",
}


class Commands(click.Group):
    """The command group. Converts every exception to a message on stderr and an exit code."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.exceptions.Exit):
            raise
        except SceneError as error:
            terminal.report(error.diagnostics)
            ctx.exit(1)
        except (KeyboardInterrupt, click.Abort):
            ctx.exit(130)
        except BrokenPipeError:  # the reader of stdout has ended, as in `maquette inspect a.scene | head -1`
            ctx.exit(1)
        except OSError as error:
            click.echo(f"error: {memory.refused_library(error) or _os_message(error)}", err=True)
            ctx.exit(1)
        except UnicodeEncodeError as error:
            name = error.object[error.start : error.end]
            click.echo(f"error: no file name has `{ascii(name)[1:-1]}` here, where names are {error.encoding}: set PYTHONUTF8=1", err=True)
            ctx.exit(1)
        except SettingError as error:
            click.echo(f"error: {error}", err=True)
            ctx.exit(1)
        except MemoryError:
            click.echo("error: not enough memory for this picture: give a smaller --size, or fewer channels by --aov", err=True)
            ctx.exit(1)
        except Exception as error:
            if why := memory.refused_library(error):
                click.echo(f"error: {why}", err=True)
                ctx.exit(1)
            if os.environ.get("MAQUETTE_TRACEBACK"):
                raise
            click.echo(f"internal error: {type(error).__name__}: {error}", err=True)
            click.echo("This is a bug in maquette, not an error in the scene. MAQUETTE_TRACEBACK=1 shows the traceback.", err=True)
            ctx.exit(1)

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name == "chart":
            from .chart import chart as command
        elif cmd_name == "compare":
            from .compare import compare as command
        elif cmd_name == "thumbnail":
            from .thumbnail import thumbnail as command
        elif cmd_name == "convert":
            from .convert import convert as command
        elif cmd_name == "watch":
            from .watch import watch as command
        elif cmd_name == "sweep":
            from .sweep import sweep as command
        elif cmd_name == "test":
            from .scene_tests.command import test as command
        elif cmd_name == "measure":
            from .measure import measure as command
        elif cmd_name == "new":
            from .new import new_command as command
        elif cmd_name == "doctor":
            from .doctor import doctor as command
        elif cmd_name == "format":
            from .format import format_command as command
        else:
            return super().get_command(ctx, cmd_name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="maquette")
@shared.examples("maquette render examples/hello.scene -o hello.png", "maquette watch room.scene")
def cli() -> None:
    """Compile scenes (.scene, USD, OBJ, PLY, STL, 3MF, GLB) and render them.

    Exit codes: 0 done, warnings or not; 1 errors; 2 wrong usage; 130 interrupted.
    """


@cli.command()
@click.argument("scene", type=shared.FILE)
@click.option(
    "-o", "--output", type=shared.OUT,
    help="Picture file: .exr, .png, .tif or .jpg; animation of --frames: .mp4, .gif, .webp or .apng. Default: SCENE.png in this folder.",
)
@shared.scene_options
@click.option("--frames", type=values.FRAMES, help="Frames: 1..24, 1..240x10, 1,5,10 or all, written to out.####.png or an animation.")
@click.option("--fps", type=click.FloatRange(0.01, 1000), help="Frames a second of an animation. Default: the scene's; 24 of a glTF file.")
@click.option("--resume", is_flag=True, help="Go on from the checkpoint of the picture; keep the frames that are whole.")
@click.option(
    "--checkpoint", type=values.CHECKPOINT, metavar="TIME",
    help="Seconds between checkpoints in OUT.checkpoint, or off. Default: 30s, after the first minute.",
)
@click.option("--memory", type=values.MEMORY, metavar="SIZE", help="Memory to take at most: 8GB. Larger pictures are drawn in strips.")
@shared.CLUSTER
@click.option("--sandbox", is_flag=True, help="Open no files but those that the scene may read and the folder of OUT (Linux).")
@shared.picture_options
@click.option("--bits", type=click.Choice(["8", "16"]), help="Bits per channel of .png and .tif. Default: 8.")
@click.option("--stats", type=shared.OUT, help="Write times, rays, error, plan and warnings to this JSON file.")
@click.option("-q", "--quiet", is_flag=True, help="Print only errors and warnings.")
@shared.examples(
    "maquette render hello.scene -o hello.png",
    "maquette render room.scene -o room.exr --error 0.5% --aov depth,normal --stats room.json",
    "maquette render gear.scene -o gear.####.png --frames 1..48 --set teeth=24",
    "maquette render motion.scene -o motion.mp4 --frames 0..47",
    "maquette render robot.usdz -o robot.png --size 960x540 --backend raster",
    "maquette render motion.scene -o motion.mp4 --frames 0..47 --cluster tcp://host:8786",
)
def render(
    scene: Path, output: Path | None, frames: tuple[float, ...] | None, fps: float | None, bits: str | None,
    stats: Path | None, quiet: bool, **given: Any,
) -> None:  # fmt: skip
    """Render SCENE to a picture or an animation."""
    from . import animation

    output = output or Path(f"{scene.stem}.png")
    address = given.pop("cluster")
    if address is not None and given["sandbox"]:
        raise click.UsageError("--cluster and --sandbox exclude each other: a confined process opens no connections")
    shared.check_cluster(address, given)
    if given.pop("sandbox"):
        jobs.confine(scene, output, stats, given)
    animated = animation.is_animation(output)
    kept = {name: given.pop(name) for name in ("checkpoint", "memory", "resume")}
    sampled = frames is not None and scene.suffix.lower() in file_types.GLTF
    _check_frames(frames, given["at"], animated or sampled, fps)
    source, settings, overrides = shared.read_options(scene, given)
    source = replace(source, fps=fps if sampled else None)
    depth = int(bits) if bits else None
    if animated:
        animation.check(output, frames)
    else:
        jobs.check_output(output, settings.aov or (), depth, settings.view or "sRGB")
    jobs.check_stats(stats, scene, output)
    job = jobs.Job(source, settings, overrides, output, depth, quiet, **kept)
    with shared.connect(address) as job.cluster:
        pictures = animation.render(job, output, frames, fps) if animated and frames is not None else job.run(frames)
    if stats:
        jobs.write_json(stats, pictures[0] if frames is None else {"frames": pictures})


def _check_frames(frames: tuple[float, ...] | None, time: float | None, animated: bool, fps: float | None) -> None:
    """Raise UsageError for options that exclude each other."""
    if frames is not None and time is not None:
        raise click.UsageError("--time and --frames exclude each other")
    if fps is not None and not animated:
        raise click.UsageError("--fps is for animations: .mp4, .gif, .webp or .apng")


@cli.command()
@click.argument("scenes", type=shared.FILE, nargs=-1, required=True)
@shared.scene_options
@click.option("--strict", is_flag=True, help="Count warnings as errors: among them everything that a file has and is not drawn.")
@click.option("--build", is_flag=True, help="Make the geometry, too: solids, text and heightfields, whose last errors show then.")
@click.option("--json", "as_json", is_flag=True, help="Print all diagnostics as a JSON list.")
@shared.examples(
    "maquette check room.scene", "maquette check bracket.scene --build", "maquette check examples/*.scene --json",
    "maquette check robot.usdz --strict",
)  # fmt: skip
@click.pass_context
def check(ctx: click.Context, scenes: tuple[Path, ...], strict: bool, build: bool, as_json: bool, **given: Any) -> None:
    """Report errors and warnings in SCENES without rendering.

    Text, heightfields and solids are not made: boxes stand for them. Errors that show only when they are made are found with --build,
    and by all commands that draw: nothing is left of a solid, its parts are not closed, heights between the places that were tried.
    """
    from ..compiler.mesh import built_geometry
    from ..compiler.plan import plan as planner

    failed, data = False, []
    for path in scenes:
        try:
            with contextlib.nullcontext() if build else built_geometry.left_out():
                scene, messages = shared.source_of(path, dict(given)).load({})
            diagnostics = (*messages.items, *planner.default_notes(scene))
        except SceneError as error:
            diagnostics = error.diagnostics
        if strict:
            diagnostics = tuple(replace(d, severity="error") if d.severity == "warning" else d for d in diagnostics)
        errors = sum(d.severity == "error" for d in diagnostics)
        failed = failed or errors > 0
        if as_json:
            data += [d.to_json() for d in sort_diagnostics(diagnostics)]
        else:
            terminal.report(diagnostics)
            click.echo(f"{path}: {errors or 'no'} error{'' if errors == 1 else 's'}")
    if as_json:
        click.echo(json.dumps(data, indent=2))
    ctx.exit(1 if failed else 0)


@cli.command()
@click.argument("scene", type=shared.FILE)
@shared.scene_options
@click.option("--ir", "as_ir", is_flag=True, help="Print every row of every table.")
@click.option("--json", "as_json", is_flag=True, help="Print the tables as JSON.")
@shared.examples("maquette inspect room.scene", "maquette inspect gear.scene --ir --set teeth=6", "maquette inspect robot.usdz")
def inspect(scene: Path, as_ir: bool, as_json: bool, **given: Any) -> None:
    """Show the compiled SCENE.

    Prints the number of rows of each table, names of cameras and lights, params, added defaults, and the files read. Of a USD stage
    also its prims by type, axes, time codes and variants. What is not drawn stands in the warnings.
    """
    from ..compiler.scene import dump

    if as_ir and as_json:
        raise click.UsageError("--ir and --json exclude each other")
    source = shared.source_of(scene, given)
    compiled = shared.load(source)
    if as_ir:
        click.echo(dump.text(compiled))
    elif as_json:
        click.echo(json.dumps(dump.data(compiled), indent=1))
    else:
        terminal.inspect(compiled, source.summary())


@cli.command()
@click.argument("scene", type=shared.FILE)
@shared.scene_options
@shared.picture_options
@click.option("--json", "as_json", is_flag=True, help="Print the decisions as JSON.")
@shared.examples("maquette explain room.scene", "maquette explain room.scene --backend raster --plan raster.coverage=areas")
def explain(scene: Path, as_json: bool, **given: Any) -> None:
    """Show the render plan of SCENE with reasons.

    Begins with the five decisions that matter most for the scene. Then prints each decision of the plan: its value, its reason, and
    the option that changes it. Then come the compiled kernels that a picture takes, those specialised to the scene, or general ones
    until these are compiled, and the shapes whose geometry takes long to make, with their seconds.
    """
    from ..compiler.mesh import built_geometry
    from ..compiler.plan import importance
    from ..render import picture_notes
    from ..render.backends import kernel_choice

    source, settings, overrides = shared.read_options(scene, given)
    with built_geometry.recorded() as costs:
        compiled = shared.load(source)
    plan = jobs.make_plan(compiled, settings, overrides)
    kind, state = kernel_choice.describe(compiled, plan)
    matters = importance.most_important(plan)
    if as_json:
        rows = [
            {"name": d.name, "value": d.value, "reason": d.reason, "overridden": d.overridden, "matters": d in matters}
            for d in plan.decisions.values()
        ]
        rows.append({"name": "kernels", "value": kind, "reason": state, "overridden": False, "matters": False})
        if made := geometry_costs.rows(costs):
            rows.append({"name": "geometry", "value": made, "reason": "seconds to make it", "overridden": False, "matters": False})
        click.echo(json.dumps(jobs.json_value(rows), indent=2))
    else:
        terminal.explain(compiled, plan, matters)
        click.echo(f"kernels  {kind}  {state}")
        for line in geometry_costs.lines(costs):
            click.echo(line)
    terminal.report(picture_notes.plan_warnings(compiled, plan))


@cli.command()
@click.option("--stdio", is_flag=True, expose_value=False, help="Speak over stdin and stdout: the default. Some editors pass it.")
@shared.allow
@shared.examples("maquette lsp --stdio", "maquette lsp --allow ~/textures")
def lsp(allow: tuple[Path, ...]) -> None:
    """Serve an editor: errors while typing, completion, docs, renames.

    Speaks the Language Server Protocol over stdin and stdout. Editors start it: docs/editors.md has the settings of VS Code, Neovim,
    Emacs and Helix.
    """
    from ..live.lsp import server

    server.serve(allow)


def _os_message(error: OSError) -> str:
    if error.errno == errno.EMFILE:
        return f"{error.strerror}: raise the limit of this shell, such as by ulimit -n 1024"
    if error.filename:
        return f"{error.filename}: {error.strerror}"
    return f"cannot print: {error.strerror}" if error.errno == errno.ENOSPC else str(error)


def _open_streams() -> None:
    """Open stdin, stdout and stderr that are closed, as by `maquette … >&-`: otherwise a file takes their number."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w" if number else "r", encoding="utf-8"))  # noqa: SIM115 (for as long as the process)


def main() -> None:
    """The `maquette` command. Exits by os._exit, because a regular exit of the interpreter takes 1/6 s."""
    start_time.begin()
    _open_streams()
    if why := memory.refused_limits():
        sys.exit(f"error: {why}")
    shared.raise_gc_threshold()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="surrogateescape")  # file names are bytes, and not always UTF-8
    try:
        cli(prog_name="maquette")
    except SystemExit as stop:
        if stop.code is not None and not isinstance(stop.code, int):
            raise
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
        os._exit(stop.code or 0)
