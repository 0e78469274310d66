"""The `watch` command: a window that follows edits, or a picture file that is written again at every save."""

from __future__ import annotations

import sys
import tempfile
import threading
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ... import __version__
from ...compiler.io import child_process
from .. import common_options as shared
from .. import render_job as jobs

if TYPE_CHECKING:
    from ...live.scene_files import Opened
    from ...live.state import State
    from ...live.studio import Current

THUMBNAIL = (320, 240)  # pixels


@click.command("watch")
@click.argument("scene", type=click.Path(exists=True, path_type=Path))
@click.option("-o", "--output", type=shared.OUT, help="Picture file, written again at every save. Without --window, no window is opened.")
@click.option("--window/--no-window", default=None, help="Open the window, also with -o. Default: only without -o.")
@click.option("--browser/--no-browser", default=True, help="Open the window in the browser, or only print its address. Default: --browser.")
@click.option("--port", type=click.IntRange(1, 65535), help="Port of the window on 127.0.0.1. Default: the last one, or a free one.")
@shared.scene_options
@shared.picture_options
@click.option("--stats", type=shared.OUT, help="Write statistics of all redraws, or of edits in the window, to a JSON file after each.")
@shared.examples(
    "maquette watch room.scene",
    "maquette watch .",
    "maquette watch robot.usdz --no-browser --port 8000",
    "maquette watch room.scene -o room.png --size 400x300 --samples 16",
    "maquette watch part.scene -o part.png --stats part.json",
)
@click.pass_context
def command(
    ctx: click.Context, scene: Path, output: Path | None, window: bool | None, browser: bool, port: int | None, stats: Path | None,
    **options: Any
) -> None:  # fmt: skip
    """Show SCENE in a window that follows edits, or write a picture at every save. Of a folder, the window shows all scenes.

    The window is a page of the browser, which this computer alone can open. It follows saves of SCENE and of all files that it uses,
    and edits in the page. Params are sliders; dragging moves the camera. docs/live.md describes it. Ctrl-C ends the command with exit
    code 0.

    With -o the command opens no window and writes the picture at every save. With -o and --window it writes each finished picture of
    the saved scene. After an error the last picture stays.

    The file of --stats is replaced atomically after every redraw without errors. It has the fields of `render --stats`, the cost
    of the last redraw (`redraw`) and of the last 1000 redraws (`redraws`): seconds from the save to the picture (`total`) and
    for each part (wait, read, draw, write), and CPU seconds of all threads. With a window it has what each edit redid (`edits`, the last
    1000): files parsed, meshes read, BVHs built, kernels compiled, pixels drawn, and the seconds until each picture.
    """
    if scene.is_dir() and (output is not None or options["sets"] or stats is not None):
        raise click.UsageError("a folder has a window alone, and no params: leave out -o, --set and --stats")
    source, settings, overrides = shared.read_options(scene, options)
    window = output is None if window is None else window
    if output is not None:
        jobs.check_output(output, settings.aov or (), None, shared.asked_look(settings))
    elif not window:
        raise click.UsageError("--no-window needs a picture file: -o FILE")
    if not window and port is not None:
        raise click.UsageError("--port is for the window: leave it out, or add --window")
    try:
        if window:
            _show(jobs.Job(source, settings, overrides, output or Path()), output, browser, port, stats)
        elif output is not None:
            _follow(jobs.Job(source, settings, overrides, output), stats)
    except KeyboardInterrupt:
        ctx.exit(0)


def _follow(job: jobs.Job, stats: Path | None) -> None:
    """Write the picture at every save."""
    from ...live import watch as live
    from ..watch_stats import Redraws

    jobs.check_stats(stats, job.source.path, job.output)
    live.follow(Redraws(job, stats).build)


def _show(job: jobs.Job, output: Path | None, browser: bool, port: int | None, stats: Path | None) -> None:
    """Serve the window until Ctrl-C."""
    from ...live import window
    from ..watch_stats import Edits

    source = job.source
    finished = None if output is None else partial(_write, output)
    jobs.check_stats(stats, source.path, *([] if output is None else [output]))
    edited = None if stats is None else Edits(stats).note
    with window.Window(source.path, partial(_opened, job), port, finished, partial(_thumbnail, source.allow), edited) as shown:
        click.echo(f"{source.path}: {shown.address.url} (Ctrl-C ends)")
        sys.stdout.flush()
        if browser:
            threading.Thread(target=child_process.browse, args=(shown.address.url,), daemon=True).start()
        shown.serve()


def _opened(job: jobs.Job, path: Path) -> Opened:
    """A scene file of the window, with the options of the command."""
    from ...compiler import load
    from ...live.scene_files import Opened

    source, stage = job.source, job.source.stage
    read = partial(load.load_with_colors, source.ocio, path)
    loaded = partial(read, allow=source.allow, stage=stage, mesh=source.mesh, max_elements=source.max_elements)
    return Opened(path, loaded, job.settings, job.overrides, source.sets, source.time)


def _thumbnail(allow: tuple[Path, ...], path: Path) -> bytes:
    """A PNG of a scene file. Raises ValueError with the errors of the scene."""
    from . import thumbnail

    with tempfile.TemporaryDirectory(prefix="maquette-") as folder:
        drawn = thumbnail.draw(thumbnail.Asset(path, "scene"), Path(folder), thumbnail.Looks(THUMBNAIL, 0, "", allow))
        if drawn.error:
            raise ValueError(drawn.error)
        return (Path(folder) / drawn.picture).read_bytes()


def _write(output: Path, current: Current, state: State) -> None:
    """Write a finished picture of the window."""
    from ...render.image import image_files

    plan, image = current.plan, current.finished
    if image is None:
        return
    exposure = plan["exposure"]
    if exposure == "metered":
        exposure = image_files.auto_exposure(image.channels["rgba"], int(image.metadata.get("threads", 0)))
    look = image_files.Look.of(plan, float(exposure))
    about = {"version": __version__, "backend": plan["backend"], "seed": plan["seed"], "exposure": float(exposure)}
    image_files.write(image, output, look, about)
    click.echo(f"{output}: {image.width}x{image.height}, {plan['backend']}, {image.metadata['samples']:g} samples a pixel")
