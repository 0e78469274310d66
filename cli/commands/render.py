"""The `render` command: a picture or an animation of a scene."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from ...lang import file_types
from .. import common_options as shared
from .. import option_types as values
from .. import render_job as jobs


@click.command("render")
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
def command(
    scene: Path, output: Path | None, frames: tuple[float, ...] | None, fps: float | None, bits: str | None,
    stats: Path | None, quiet: bool, **options: Any,
) -> None:  # fmt: skip
    """Render SCENE to a picture or an animation."""
    from .. import animation

    output = output or Path(f"{scene.stem}.png")
    address = options.pop("cluster")
    if address is not None and options["sandbox"]:
        raise click.UsageError("--cluster and --sandbox exclude each other: a confined process opens no connections")
    shared.check_cluster(address, options)
    if options.pop("sandbox"):
        jobs.confine(scene, output, stats, options)
    animated = animation.is_animation(output)
    job_options = {name: options.pop(name) for name in ("checkpoint", "memory", "resume")}
    sampled = frames is not None and scene.suffix.lower() in file_types.ANIMATED
    _check_frames(frames, options["at"], animated or sampled, fps)
    source, settings, overrides = shared.read_options(scene, options)
    source = replace(source, fps=fps if sampled else None)
    depth = int(bits) if bits else None
    if animated:
        animation.check(output, frames)
    else:
        jobs.check_output(output, settings.aov or (), depth, shared.asked_look(settings))
    jobs.check_stats(stats, scene, output)
    job = jobs.Job(source, settings, overrides, output, depth, quiet, **job_options)
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
