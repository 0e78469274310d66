"""From what was asked on the command line to pictures on disk: load, plan, draw, expose, write; frames, interruption, figures."""

from __future__ import annotations

import json
import math
import os
import shlex
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .. import __version__
from ..compiler.io.replace_file import replace_file
from ..lang import file_types
from ..lang.diagnostics import Diagnostic, Diagnostics, SceneError, Span
from . import option_types as values
from . import terminal

if TYPE_CHECKING:
    from ..compiler import ir
    from ..compiler.plan.plan import Plan
    from ..render.film.bounce_error import Cut
    from ..render.image.image import Image

STAGES = ("import", "parse", "evaluate", "lower", "validate", "compile_kernels", "build", "render", "write")


@dataclass(frozen=True, slots=True)
class Source:
    """A scene file with what the command line says about reading it."""

    path: Path
    sets: Mapping[str, str]
    time: float | None
    allow: tuple[Path, ...]
    variants: Mapping[str, str]

    def load(self, seconds: dict[str, float], time: float | None = None, code: float | None = None) -> tuple[ir.Scene, Diagnostics]:
        """The scene at `time` seconds or at a USD time code (default: --time), and what was found about it. Raises SceneError."""
        with timed(seconds, "import"):
            from ..compiler import load

        found = Diagnostics()
        scene = load.load(
            self.path, sets=self.sets, time=self.time if time is None else time, code=code, allow=self.allow, variants=self.variants,
            diagnostics=found, seconds=seconds,
        )  # fmt: skip
        return scene, found

    def moments(self, frames: tuple[int, ...]) -> list[dict[str, float]]:
        """What `load` takes for each frame: of a stage they are time codes, elsewhere they follow at the scene's own rate."""

        if self.path.suffix.lower() in file_types.USD:
            return [{"code": float(number)} for number in frames]
        scene, _ = self.load({})
        return [{"time": number / scene.fps} for number in frames]


def make_plan(scene: ir.Scene, settings: ir.Settings, overrides: Mapping[str, str]) -> Plan:
    """The plan; what cannot be planned as asked is a usage error."""
    from ..compiler.plan import plan

    try:
        return plan.make(scene, settings, overrides)
    except plan.PlanError as error:
        raise click.UsageError(str(error)) from None


def check_folder(path: Path) -> None:
    """Raise OSError with a whole sentence where no file can be put at `path`."""
    folder = path.parent
    if not folder.is_dir():
        raise FileNotFoundError(f"there is no folder {folder} to write {path.name} into")
    if path.is_dir():
        raise IsADirectoryError(f"{path} is a folder")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise PermissionError(f"the folder {folder} is not writable")


def check_stats(stats: Path | None, *others: Path) -> None:
    """See that figures can be written, and do not replace the scene or its picture: a usage error if they would."""
    if stats is None:
        return
    check_folder(stats)
    if taken := next((other for other in others if other.resolve() == stats.resolve()), None):
        raise click.UsageError(f"--stats {stats} would replace {taken}: give the figures a file of their own, as {stats.stem}.json")


def check_output(path: Path, aov: tuple[str, ...] = (), bits: int | None = None, view: str = "sRGB") -> None:
    """See that `path` can be written: a name that cannot be is a usage error, a folder that cannot be written to an OSError."""
    from ..render.image import image_files

    try:
        image_files.check(path, aov, bits, view)
    except image_files.FormatError as error:
        raise click.UsageError(str(error)) from None
    check_folder(path)


class Laps:
    """Seconds, and CPU seconds of all threads, of one part after the other."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.cpu: dict[str, float] = {}
        self._last = time.perf_counter(), time.process_time()

    def end(self, part: str) -> None:
        """What passed since the last part is this one's."""
        (seconds, cpu), now = self._last, (time.perf_counter(), time.process_time())
        self.seconds[part], self.cpu[part] = now[0] - seconds, now[1] - cpu
        self._last = now


@dataclass(slots=True)
class Job:
    """What to render and where to: one picture, or one a frame with the same exposure."""

    source: Source
    settings: ir.Settings
    overrides: Mapping[str, str]
    output: Path
    bits: int | None = None
    quiet: bool = False
    files: tuple[Path, ...] = ()  # what the last scene was read from
    exposure: float | None = None  # metered, at the first picture
    said: set[Diagnostic] = field(default_factory=set)
    laps: Laps = field(default_factory=Laps)  # of the last picture

    def run(self, frames: tuple[int, ...] | None) -> list[dict[str, Any]]:
        """Render everything; returns the figures of each picture (`--stats`). Raises KeyboardInterrupt after a partial one."""
        if frames is None:
            return [self._told(self.output, self._picture(self.output, {}, "rendering"))]
        pictures = []
        for i, (number, moment) in enumerate(zip(frames, self.source.moments(frames), strict=True), 1):
            path = values.numbered(self.output, number)
            pictures.append(self._told(path, self._picture(path, moment, f"frame {number} ({i} of {len(frames)})")))
        return pictures

    def _told(self, path: Path, figures: dict[str, Any]) -> dict[str, Any]:
        if not self.quiet:
            click.echo(summary(path, figures))
        return figures

    def build(self) -> dict[str, Any] | None:
        """Render once for `watch`, which tells of it: the figures, or None where something is wrong, which is printed.

        `files` are then those to watch, if any are known. Raises KeyboardInterrupt.
        """
        self.exposure = None
        self.said.clear()
        try:
            return self._picture(self.output, {}, "rendering")
        except SceneError as error:
            terminal.report(error.diagnostics)
            named = (Path(d.span.file) for d in error.diagnostics if d.span)
            self.files = tuple(dict.fromkeys((self.source.path, *self.files, *(path for path in named if path.is_file()))))
        except click.UsageError as error:
            click.echo(f"error: {error.format_message()}", err=True)
        return None

    def _picture(self, path: Path, moment: Mapping[str, float], what: str) -> dict[str, Any]:
        """Draw and write one picture; its figures. Raises KeyboardInterrupt after a partial one."""
        seconds: dict[str, float] = dict.fromkeys(STAGES, 0.0)
        self.laps = Laps()
        with timed(seconds, "import"):
            from ..render import render_scene
            from ..render.jit import kernel_cache
        scene, found = self.source.load(seconds, **moment)
        self.files = tuple(Path(file) for file in scene.files)
        plan = make_plan(scene, self.settings, self.overrides)
        check_output(path, plan["aov"], self.bits, plan["view"])
        parts = _strips_of(plan)
        self._say(found.items)
        self._say(plan_warnings(scene, plan))
        self.laps.end("read")
        with terminal.Progress(self.quiet) as progress, interruptible() as cancel:
            progress.begin(what, "compiling kernels (the first time only)" if kernel_cache.is_empty() else "")
            if len(parts) > 1:
                image = self._in_strips(scene, plan, parts, path, progress, cancel)
            else:
                image = render_scene.draw(scene, plan, progress, cancel)
        for name, value in image.metadata["seconds"].items():
            seconds[name] = seconds.get(name, 0.0) + value
        self.laps.end("draw")
        self._say(Diagnostic("note", message, span_of(scene, table, row)) for message, table, row in image.metadata["notes"])
        self._say(unproved(image.metadata["unproved"]))
        self._say(left_out(image.metadata["issues"]))
        self._say(cut_off(image.metadata.get("cut"), scene, plan))
        partial = bool(image.metadata.get("partial"))
        if partial:
            path = _partial(path, len(parts) > 1)
        if len(parts) == 1:
            with timed(seconds, "write"):
                self._write(image, path, plan)
        self.laps.end("write")
        if partial:
            click.echo(f"interrupted: what was done is in {path}", err=True)
            raise KeyboardInterrupt
        return self._figures(scene, plan, image, seconds)

    def _write(self, image: Image, path: Path, plan: Plan) -> None:
        from ..render.image import image_files

        exposure = plan["exposure"]
        if exposure == "metered":
            if self.exposure is None:
                self.exposure = image_files.metered(image.channels["rgba"])
                if not self.quiet and path.suffix.lower() not in image_files.LINEAR:
                    click.echo(f"exposure: metered, {self.exposure:g} ev (--exposure {self.exposure:g} fixes it)", err=True)
            exposure = self.exposure
        look, about = self._said_of(plan, exposure)
        about["samples"] = plain(image.metadata.get("samples", plan["samples"]))
        error = image.metadata.get("error")
        try:
            image_files.write(image, path, look, about if error is None else {**about, "error": float(error)})
        except Exception as fault:
            raise OSError(f"{fault}; {_rescued(image, path)}") from fault

    def _said_of(self, plan: Plan, exposure: float) -> tuple[Any, dict[str, Any]]:
        """How light becomes numbers in a file, and what it says of its picture."""
        from ..render.image import image_files

        look = image_files.Look(exposure, plan["view"], self.bits or 8, alpha=plan["background"] == "transparent")
        about = {
            "command": shlex.join(["maquette", *sys.argv[1:]]), "version": __version__, "backend": plan["backend"],
            "seed": plan["seed"], "samples": plain(plan["samples"]), "exposure": exposure,
        }  # fmt: skip
        return look, about

    def _in_strips(self, scene: ir.Scene, plan: Plan, parts: list[Plan], path: Path, progress: Any, cancel: Any) -> Image:
        """Draw and write a picture that is too large to be held; what is told of it, without its pixels. A partial one is moved aside."""
        from ..render import large_images
        from ..render.image import image_files
        from ..render.image.image import Image

        look, about = self._said_of(plan, plan["exposure"])
        _, y0, _, y1 = plan["crop"]
        told: list[dict[str, Any]] = []
        with image_files.Strips(path, look, about, y1 - y0) as file:
            for image in large_images.draw_strips(scene, parts, progress, cancel):
                file.add(image)
                told.append(image.metadata)
            if cancel.is_set():
                file.path = _partial(path, True)
        return Image(0, 0, {}, large_images.join_metadata(told, plan))

    def _figures(self, scene: ir.Scene, plan: Plan, image: Image, seconds: Mapping[str, float]) -> dict[str, Any]:
        warnings = [d.to_json() for d in self.said if d.severity == "warning"]
        return plain(
            {
                "scene": str(self.source.path),
                "backend": plan["backend"],
                "size": plan["size"],
                "samples": image.metadata.get("samples", plan["samples"]),
                "seconds": {stage: seconds[stage] for stage in STAGES},
                "rays": image.metadata.get("rays"),
                "error": image.metadata.get("error"),
                "cut": cut.share if (cut := image.metadata.get("cut")) else None,
                "plan": plan.values(),
                "warnings": warnings,
            }
        )

    def _say(self, found: Iterable[Diagnostic]) -> None:
        """Print what has not been said already for another frame; notes only when not quiet."""
        new = [d for d in found if d not in self.said and not (self.quiet and d.severity == "note")]
        self.said.update(new)
        terminal.report(new)


def _strips_of(plan: Plan) -> list[Plan]:
    """The plan, or those of its strips where its picture is too large to be held; what then cannot be had is a usage error."""
    from ..render import large_images

    parts = large_images.strip_plans(plan)
    if len(parts) > 1 and (why := large_images.refusal(plan)):
        raise click.UsageError(f"a picture of {plan['size'][0]} by {plan['size'][1]} pixels is drawn strip by strip: {why}")
    return parts


def _partial(path: Path, in_strips: bool) -> Path:
    """Where a picture goes that was interrupted: to what keeps all that is known, or, in strips, to the kind of file it was begun as."""
    return path.with_name(f"{path.stem}.partial{path.suffix if in_strips else '.exr'}")


def _rescued(image: Image, path: Path) -> str:
    """Where a picture went that could not be written at `path`: an EXR beside it, or in the folder of temporary files."""
    from ..render.image import image_files

    for folder in (path.parent, Path(tempfile.gettempdir())):
        other = folder / f"{path.stem}.rescued.exr"
        try:
            image_files.write(image, other, image_files.Look(), {})
        except Exception as fault:
            reason = fault
        else:
            return f"its pixels are in {other}"
    return f"its pixels are lost: {reason}"


def span_of(scene: ir.Scene, table: str, row: int) -> Span | None:
    """Where the row of a table came from."""
    rows = scene.spans.rows.get(table)
    if rows is None or not 0 <= row < len(rows):
        return None
    source, *place = (int(n) for n in rows[row])
    return Span(scene.spans.sources[source], *place)


@contextmanager
def timed(seconds: dict[str, float], stage: str) -> Iterator[None]:
    """Add the time the block takes to `seconds[stage]`."""
    began = time.perf_counter()
    try:
        yield
    finally:
        seconds[stage] = seconds.get(stage, 0.0) + time.perf_counter() - began


@contextmanager
def interruptible() -> Iterator[threading.Event]:
    """An event that the first Ctrl-C sets; the second raises KeyboardInterrupt at once."""
    event = threading.Event()

    def interrupt(number: int, frame: Any) -> None:
        if event.is_set():
            raise KeyboardInterrupt
        event.set()

    before = signal.signal(signal.SIGINT, interrupt)
    try:
        yield event
    finally:
        signal.signal(signal.SIGINT, before)


def write_json(path: Path, data: Any) -> None:
    """Write `data` as JSON, whole or not at all."""
    replace_file(path, (json.dumps(plain(data), indent=2) + "\n").encode())


def plain(value: Any) -> Any:
    """`value` as JSON can hold it: endless numbers are null, tuples lists, numpy's scalars Python's."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, tuple | list):
        return [plain(v) for v in value]
    if hasattr(value, "item"):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def plan_warnings(scene: ir.Scene, plan: Plan) -> list[Diagnostic]:
    """What the plan finds odd about the scene."""
    from ..compiler.plan import plan as planner

    return [Diagnostic("warning", text) for text in planner.warnings(scene, plan)]


def summary(path: Path, figures: Mapping[str, Any]) -> str:
    """A picture in one line."""
    width, height = figures["size"]
    before = " before denoising" if figures["plan"]["denoise"] else ""
    error = f", √relMSE {figures['error']:.2%}{before}" if figures["error"] is not None else ""
    total = sum(figures["seconds"].values())
    return f"{path}: {width}x{height}, {figures['backend']}, {figures['samples']:g} samples a pixel{error}, {total:.2f} s"


def left_out(samples: int) -> list[Diagnostic]:
    """What is said of samples whose light was infinite or no number."""
    if not samples:
        return []
    are = "the light of 1 sample was" if samples == 1 else f"the light of {samples:,} samples was"
    message = f"{are} infinite or no number, and left out of the picture"
    return [Diagnostic("warning", message, None, "some strength or size is too large")]


def cut_off(cut: Cut | None, scene: ir.Scene, plan: Plan) -> list[Diagnostic]:
    """What is said of a limit on bounces that leaves out more light than is allowed: a warning where an error was asked for."""
    from ..compiler.plan import plan as planner

    if cut is None or not cut.matters:
        return []
    than = "is the error asked for" if plan["error"] else "noise hides"
    message = f"the limit of {plan['bounces']} bounces leaves out {cut.share:.1%} of a place's light (± {cut.error:.1%}), more than {than}"
    enough = cut.enough or planner.MAX_BOUNCES
    hint = f"render(bounces: {enough}) or --bounces {enough} leaves out less" + ("" if cut.enough else "; light goes on and on here")
    return [Diagnostic("warning" if plan["error"] else "note", message, scene.spans.at("settings", 0), hint)]


def unproved(rays: int) -> list[Diagnostic]:
    """What is said of rays whose first meeting with a formula's surface could not be proved."""
    if not rays:
        return []
    message = f"{rays:,} rays passed places where a formula's surface could neither be found nor ruled out"
    return [Diagnostic("warning", message, None, "--aov issues (in an .exr) shows where")]
