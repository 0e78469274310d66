"""Render jobs: load, plan, render, expose and write pictures; frames, interruption, statistics."""

from __future__ import annotations

import errno
import json
import math
import os
import re
import shlex
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import click

from .. import __version__
from ..compiler.io.replace_file import check_replaceable, replace_file
from ..lang.diagnostics import Diagnostic, SceneError, Span
from ..lang.plain_values import time_range
from . import option_types as values
from . import terminal
from .job import checkpoints, ignored_options, kept_frames, rescue, start_time
from .job.picture_summary import summary
from .memory import peak_memory, strip_plans
from .process import supervisor
from .progress import Display
from .scene_source import Laps, Source, measure_time

if TYPE_CHECKING:
    from ..compiler import ir
    from ..compiler.plan.plan import Plan
    from ..render.film.checkpoint import Keeper
    from ..render.film.deadline import Deadline
    from ..render.film.progress import Report
    from ..render.image.image import Image
    from ..render.large_images import Draw

Frame = tuple[Path, float, dict[str, float]]  # file, number, moment as for Source.load
STAGES = ("import", "parse", "evaluate", "lower", "validate", "compile_kernels", "build", "render", "write")


def make_plan(scene: ir.Scene, settings: ir.Settings, overrides: Mapping[str, str]) -> Plan:
    """The plan of a render. Raises UsageError for settings that cannot be planned."""
    from ..compiler.plan import plan

    try:
        return plan.make_plan(scene, settings, overrides)
    except plan.PlanError as error:
        raise click.UsageError(str(error)) from None


def check_folder(path: Path, inputs: Iterable[Path] = ()) -> None:
    """Raise OSError with a full sentence if no file can be written at `path`, or if it would replace one of `inputs`."""
    folder = path.parent
    if not folder.is_dir():
        raise FileNotFoundError(f"there is no folder {folder} to write {path.name} into")
    check_replaceable(path, inputs)
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(f"the folder {folder} is not writable")
    try:  # the rights may say otherwise, as those of root in /proc
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as fault:
        if fault.errno not in (errno.ENOSPC, errno.EDQUOT, errno.EMFILE, errno.ENFILE):  # the pixels are rescued, or it says what to do
            raise OSError(f"no file can be made in the folder {folder}: choose another one for {path.name}") from None


def check_stats(stats: Path | None, *others: Path) -> None:
    """Check that statistics can be written. Raises UsageError if they would replace the scene or its picture."""
    if stats is None:
        return
    check_folder(stats)
    if taken := next((other for other in others if other.resolve() == stats.resolve()), None):
        raise click.UsageError(f"--stats {stats} would replace {taken}: choose another file, such as {stats.stem}.json")


def check_output(path: Path, aov: tuple[str, ...] = (), bits: int | None = None, look: Any = None, inputs: Iterable[Path] = ()) -> None:
    """Check that a picture of an image_files.Look can be written. Raises UsageError, and OSError for a folder or one of `inputs`."""
    from ..render.image import image_files

    try:
        image_files.check(path, aov, bits, look)
    except image_files.FormatError as error:
        raise click.UsageError(str(error)) from None
    check_folder(path, inputs)


def confine(scene: Path, output: Path, stats: Path | None, options: Mapping[str, Any]) -> None:
    """Confine the process to the files and folders of the options, as they are named.

    Raises UsageError on a system that cannot confine processes, and for a link in one of these names. Raises SceneError for a scene that
    is a link out of its folder.
    """
    from ..compiler.io import confinement, environment, sandbox

    session = [path for path in (options["session_layer"], environment.color_config_folder(options["ocio"])) if path]
    folders = [path.parent for path in (output, stats) if path is not None]
    try:
        confinement.confine([scene.parent, *options["allow"], *session], folders, options["memory"])
    except OSError as fault:
        raise click.UsageError(f"--sandbox: {fault.strerror or fault}") from None
    try:
        sandbox.open_main(scene, options["allow"])
    except sandbox.FileError as fault:
        raise SceneError((Diagnostic("error", fault.message, Span(str(scene)), fault.hint),)) from None


class Reading(NamedTuple):
    """A picture that was read and planned."""

    path: Path
    scene: ir.Scene
    plan: Plan
    parts: list[Plan]  # of strips, if there are several
    memory: int  # bytes that the process will take, as estimated
    seconds: dict[str, float]
    keys: kept_frames.Keys | None  # of a frame
    deadline: Deadline


class Cluster(Protocol):
    """Renders on other machines; see cluster/session.py."""

    def draw(
        self, scene: ir.Scene, plan: Plan, report: Report, cancel: threading.Event, keeper: Keeper | None = None,
        deadline: Deadline | None = None,
    ) -> Image:  # fmt: skip
        """As render_scene.draw."""
        ...

    def takes_frames(self, job: Job, frames: list[Frame]) -> bool:
        """Whether `frames` draws them faster than one after the other."""
        ...

    def frames(self, job: Job, frames: list[Frame]) -> list[dict[str, Any]]:
        """Render frames, several at a time. Returns the statistics of each. Raises KeyboardInterrupt."""
        ...

    def notes(self) -> list[Diagnostic]:
        """Warnings about workers."""
        ...


@dataclass(slots=True)
class Job:
    """A render of one picture, or of one picture per frame with the same exposure."""

    source: Source
    settings: ir.Settings
    overrides: Mapping[str, str]
    output: Path
    bits: int | None = None
    quiet: bool = False
    files: tuple[Path, ...] = ()  # files of the last scene
    checkpoint: float | None = 0.0  # seconds between checkpoints; 0: none; None: checkpoints.EVERY, after the first minute
    resume: bool = False  # go on from checkpoints
    memory: int | None = None  # bytes that may be taken; None: what is free
    cluster: Cluster | None = None  # that draws the pictures; None: this machine
    inputs: str | None = None  # the key of an animation, "" before its first frame is read; None for one picture
    exposure: float | None = None  # metered at the first picture
    reported: set[Diagnostic] = field(default_factory=set)
    noted: set[str] = field(default_factory=set)  # notes so far, without their figures
    laps: Laps = field(default_factory=Laps)  # of the last picture
    display: Display = field(default_factory=lambda: Display(quiet=True))  # of the last picture

    def run(self, frames: tuple[float, ...] | None) -> list[dict[str, Any]]:
        """Render all pictures, with `resume` those of frames that have no file. Returns the statistics of each (`--stats`).

        Raises KeyboardInterrupt after a partial one.
        """
        if frames is None:
            return [self.summarize(self.output, self._picture(self.output, {}))]
        numbers = self.source.frames(frames)
        every = [(self.frame_file(n), n, moment) for n, moment in zip(numbers, self.source.moments(numbers), strict=True)]
        self.inputs = ""
        finished = self._skip(every) if self.resume and every else {}
        missing = [frame for frame in every if frame[0] not in finished]
        if self.cluster is not None and self.cluster.takes_frames(self, missing):
            return self.cluster.frames(self, missing)
        pictures: list[dict[str, Any]] = []
        began = time.perf_counter()
        for i, (path, number, moment) in enumerate(missing, 1):
            each = (time.perf_counter() - began) / max(i - 1, 1)
            remaining = f", all in {time_range(each * (len(missing) - i + 1))}" if i > 1 else ""
            pictures.append(self.summarize(path, self._picture(path, moment, f"frame {number:g} ({i} of {len(missing)}{remaining})")))
        return pictures

    def draw(self, path: Path, what: str) -> dict[str, Any]:
        """Render one picture of several, `what` in progress lines; returns its statistics. Raises SceneError."""
        return self._picture(path, {}, what)

    def frame_file(self, number: float) -> Path:
        """The file of a frame."""
        return values.frame_path(self.output, number)

    def _skip(self, frames: list[Frame]) -> dict[Path, dict[str, str]]:
        """The frames that are kept, of which one gives the exposure. Tells of these and of the others that are there."""
        first, _, moment = frames[0]
        read = self.read(first, moment)
        finished, damaged, others = kept_frames.find((file for file, _, _ in frames), read.keys.inputs if read.keys else "")
        self.report(Diagnostic("warning", f"{file} is damaged: the frame is drawn again") for file in damaged)
        for file, _, moment in frames:
            if file in others:
                read = self.read(file, moment)
                if read.keys is not None and others[file].get("picture") == read.keys.picture:
                    finished[file] = others.pop(file)
        if others:
            are = "1 frame is" if len(others) == 1 else f"{len(others)} frames are"
            message = f"{are} of another scene, version or settings, such as {next(iter(others))}: drawn again"
            self.report([Diagnostic("warning", message)])
        if finished:
            if not self.quiet:
                click.echo(f"{len(finished)} frame{' is' if len(finished) == 1 else 's are'} there already", err=True)
            about = next(iter(finished.values()))
            self.exposure = float(about["exposure"]) if "exposure" in about else None
        return finished

    def summarize(self, path: Path, figures: dict[str, Any]) -> dict[str, Any]:
        """Print the summary of a picture, unless quiet. Returns its statistics."""
        if not self.quiet:
            click.echo(summary(path, figures))
        return figures

    def build(self) -> dict[str, Any] | None:
        """Render once for `watch`. Returns the statistics, or None after printing errors.

        Sets `files` to the files to watch. Raises KeyboardInterrupt.
        """
        self.exposure = None
        self.reported.clear()
        try:
            return self._picture(self.output, {})
        except SceneError as error:
            terminal.report(error.diagnostics)
            named = (Path(d.span.file) for d in error.diagnostics if d.span)
            self.files = tuple(dict.fromkeys((self.source.path, *self.files, *(path for path in named if path.is_file()))))
        except click.UsageError as error:
            click.echo(f"error: {error.format_message()}", err=True)
        return None

    def _picture(self, path: Path, moment: Mapping[str, float], what: str = "") -> dict[str, Any]:
        """Render and write one picture. Returns its statistics. Raises KeyboardInterrupt after a partial one."""
        with Display(self.quiet, what) as self.display:
            return self._shown_picture(path, moment)

    def _shown_picture(self, path: Path, moment: Mapping[str, float]) -> dict[str, Any]:
        read = self.read(path, moment)
        keeper = checkpoints.keeper_of(self, read)
        with terminal.catch_interrupt() as cancel:
            image = self._draw(read, cancel, keeper)
        return self.finish(read, image, keeper)

    def read(self, path: Path, moment: Mapping[str, float]) -> Reading:
        """Load and plan a picture, and report its diagnostics. Raises SceneError, and UsageError for one that cannot be drawn."""
        start = start_time.take()
        seconds: dict[str, float] = dict.fromkeys(STAGES, 0.0)
        self.laps = Laps()
        with measure_time(seconds, "import"):
            from ..render import picture_notes
            from ..render.film.deadline import Deadline
            from ..render.image import image_files
        self.display.stage("reading")
        scene, diagnostics = self.source.load(seconds, **moment)
        self.files = tuple(Path(file) for file in scene.files)
        plan = make_plan(scene, self.settings, self.overrides)
        keys = None
        if self.inputs is not None:
            keys = kept_frames.keys_of(scene, plan, self.bits, self.inputs)
            self.inputs = keys.inputs
        check_output(path, plan["aov"], self.bits, image_files.Look.of(plan, 0.0), self.files)
        parts, expected = strip_plans(scene, plan, path, self.memory)
        self.report(diagnostics.items)
        self.report([*picture_notes.plan_warnings(scene, plan), *ignored_options.notes(self.settings, plan, path)])
        self.laps.end("read")
        return Reading(path, scene, plan, parts, expected, seconds, keys, Deadline(plan["budget"], start.began, processed=start.processed))

    def _draw(self, read: Reading, cancel: threading.Event, keeper: Keeper | None) -> Image:
        """Draw a picture here, or on the cluster. Raises KeyboardInterrupt if it was cancelled before its first sample."""
        from ..render import render_scene
        from ..render.jit.cancellation import Cancelled

        draw: Draw = render_scene.draw if self.cluster is None else self.cluster.draw
        try:
            if len(read.parts) > 1:
                return self._render_strips(read, draw, cancel)
            return draw(read.scene, read.plan, self.display, cancel, keeper, deadline=self._until_written(read))
        except Cancelled:
            raise KeyboardInterrupt from None
        finally:
            if self.cluster is not None:
                self.report(self.cluster.notes())

    def _until_written(self, read: Reading) -> Deadline:
        """The deadline of drawing, before the picture is written."""
        from ..render.image import image_files

        plan, (x0, y0, x1, y1) = read.plan, read.plan["crop"]
        metered = plan["exposure"] == "metered" and self.exposure is None
        look = image_files.Look.of(plan, 0.0, self.bits or 8)
        return read.deadline.earlier(image_files.writing_time(read.path, (x1 - x0) * (y1 - y0), look, metered, len(plan["aov"])))

    def finish(self, read: Reading, image: Image, keeper: Keeper | None = None) -> dict[str, Any]:
        """Write a picture, unless it was in strips. Returns its statistics. Raises KeyboardInterrupt after a partial one."""
        from ..render import picture_notes

        path, scene, plan, parts, seconds = read.path, read.scene, read.plan, read.parts, read.seconds
        for name, value in image.metadata["seconds"].items():
            seconds[name] = seconds.get(name, 0.0) + value
        self.laps.end("draw")
        self.report(picture_notes.of_render(image.metadata, scene, plan, self.settings))
        if partial := bool(image.metadata.get("partial")):
            supervisor.finishing()
            path = _partial(path, len(parts) > 1)
        self.display.stage("writing")
        if len(parts) == 1:
            with measure_time(seconds, "write"):
                self._write(image, path, read)
        self.laps.end("write")
        if partial:
            self.display.hide()
            hint = f"; --resume goes on from {keeper.path}" if keeper is not None and keeper.path.is_file() else ""
            click.echo(f"interrupted: the partial picture is in {path}{hint}", err=True)
            raise KeyboardInterrupt
        if keeper is not None:
            keeper.remove()
        self.report(picture_notes.late_warnings({**image.metadata, "seconds": seconds}, read.deadline))
        return self._figures(read, image)

    def _write(self, image: Image, path: Path, read: Reading) -> None:
        from ..render.image import image_files

        plan = read.plan
        exposure = plan["exposure"]
        if exposure == "metered":
            if self.exposure is None:
                self.exposure = image_files.auto_exposure(image.channels["rgba"], int(plan["threads"]))
                if not self.quiet and path.suffix.lower() not in image_files.LINEAR:
                    self.display.hide()
                    click.echo(f"exposure: metered, {self.exposure:g} ev (--exposure {self.exposure:g} fixes it)", err=True)
            exposure = self.exposure
        look, about = self._encoding(read, exposure)
        about["samples"] = json_value(image.metadata.get("samples", plan["samples"]))
        error = image.metadata.get("denoised_error" if image.metadata.get("denoised") else "error")
        try:
            check_replaceable(path, self.files)  # it may have become a link to the scene
            image_files.write(image, path, look, about if error is None else {**about, "error": float(error)}, int(plan["threads"]))
        except Exception as fault:
            raise OSError(f"{fault}; {rescue.save(image, path)}") from fault

    def _encoding(self, read: Reading, exposure: float) -> tuple[Any, dict[str, Any]]:
        """The encoding of the picture and the metadata of its file."""
        from ..render.image import image_files

        plan = read.plan
        look = image_files.Look.of(plan, exposure, self.bits or 8)
        about = {
            "command": shlex.join(["maquette", *sys.argv[1:]]), "version": __version__, "backend": plan["backend"],
            "seed": plan["seed"], "samples": json_value(plan["samples"]), "exposure": exposure,
            **(read.keys._asdict() if read.keys else {}),
        }  # fmt: skip
        return look, about

    def _render_strips(self, read: Reading, draw: Draw, cancel: threading.Event) -> Image:
        """Render and write a picture in strips, for one larger than memory. Returns its metadata without pixels."""
        from ..render import large_images
        from ..render.image import image_files
        from ..render.image.image import Image

        path, plan = read.path, read.plan
        metered = plan["exposure"] == "metered"  # of a file that holds linear light
        look, about = self._encoding(read, 0.0 if metered else plan["exposure"])
        _, y0, _, y1 = plan["crop"]
        metadata: list[dict[str, Any]] = []
        with image_files.Strips(path, look, about, y1 - y0, int(plan["threads"])) as file:
            for image in large_images.draw_strips(draw, read.scene, read.parts, self.display, cancel, self._until_written(read)):
                file.add(image)
                metadata.append(image.metadata)
            if cancel.is_set():
                file.path = _partial(path, True)
            check_replaceable(file.path, self.files)
        return Image(0, 0, {}, large_images.join_metadata(metadata, plan))

    def _figures(self, read: Reading, image: Image) -> dict[str, Any]:
        warnings = [d.to_json() for d in self.reported if d.severity == "warning"]
        return json_value(
            {
                "scene": str(self.source.path),
                "backend": read.plan["backend"],
                "size": read.plan["size"],
                "samples": image.metadata.get("samples", read.plan["samples"]),
                "samples_mean": image.metadata.get("samples_mean"),
                "seconds": {stage: read.seconds[stage] for stage in STAGES},
                "instances": len(read.scene.tables.instances.geometry),
                "rays": image.metadata.get("rays"),
                "memory": peak_memory(), "memory_expected": read.memory,
                "error": image.metadata.get("error"),
                "denoised": image.metadata.get("denoised", False), "denoised_error": image.metadata.get("denoised_error"),
                "elapsed": read.deadline.spent() if read.deadline.is_finite else None,  # with what no stage counts
                "cut": cut.share if (cut := image.metadata.get("cut")) else None,
                "bias": image.metadata.get("bias"), "left_out": image.metadata.get("left_out", ()),
                "plan": read.plan.values(),
                "warnings": warnings,
            }
        )

    def report(self, diagnostics: Iterable[Diagnostic]) -> None:
        """Print the diagnostics that no earlier frame printed; without notes if quiet. Notes that differ in figures alone count as one."""
        new = [d for d in diagnostics if d not in self.reported and not (self.quiet and d.severity == "note")]
        new = [d for d in new if d.severity != "note" or _without_figures(d) not in self.noted]
        self.reported.update(new)
        self.noted.update(map(_without_figures, new))
        if new:
            self.display.hide()
        terminal.report(new)


def _without_figures(diagnostic: Diagnostic) -> str:
    return re.sub(r"\d[\d.,]*", "#", diagnostic.message)


def _partial(path: Path, in_strips: bool) -> Path:
    """The file of an interrupted picture: an .exr, which holds all channels, or in strips the format of the output."""
    return path.with_name(f"{path.stem}.partial{path.suffix if in_strips else '.exr'}")


def write_json(path: Path, data: Any) -> None:
    """Write `data` as JSON, atomically."""
    replace_file(path, (json.dumps(json_value(data), indent=2) + "\n").encode())


def json_value(value: Any) -> Any:
    """`value` for JSON: infinite numbers and nan become null, tuples lists, numpy scalars Python numbers."""
    if isinstance(value, Mapping):
        return {str(k): json_value(v) for k, v in value.items()}
    if isinstance(value, tuple | list):
        return [json_value(v) for v in value]
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
