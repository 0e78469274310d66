"""The renderer of the live window: one thread that compiles and draws the newest state; an edit cancels the picture before it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..compiler import ir
from ..compiler.io import stage_cache
from ..compiler.plan import importance, omitted_light
from ..compiler.plan import plan as planner
from ..compiler.plan.plan import Plan
from ..lang.diagnostics import Diagnostic, Diagnostics, SceneError
from ..lang.plain_values import show_value
from ..lang.schema.picture_channels import SEEN
from ..lang.schema.picture_settings import BACKENDS
from ..render import picture_notes, render_scene
from ..render.film.progress import Progress
from ..render.image import image_files
from ..render.image.image import Image
from ..render.jit import compile_events
from ..render.jit.cancellation import Cancelled
from . import channels, params, picking, poses, scene_files
from .edit_counts import Work
from .interrupts import Interrupted, Interruptible
from .passes import MAX_PIXELS, Pace, Quick, Shown
from .previews import Previews
from .scene_files import Opened
from .state import State, channel_labels

PATIENCE = 1.0  # seconds of a first picture after which an edit cancels it: shorter ones are shown, so that dragging never starves
TICK = 0.12  # seconds between progress messages and between partial pictures
SHARE = 0.15  # of the time that may go into partial pictures
REST = 0.03  # seconds after the first whole picture in which no other is drawn, so that pages can show it

Tell = Callable[[dict[str, Any]], None]
Show = Callable[[dict[str, Any], bytes], None]


@dataclass(frozen=True, slots=True)
class Compiled:
    """A compiled scene, and what it was compiled from."""

    key: Any
    scene: ir.Scene
    warnings: tuple[Diagnostic, ...]


@dataclass(eq=False, slots=True)
class Current:
    """The last picture: what is shown, of which scene and plan, and the finished image."""

    version: int
    scene: ir.Scene
    plan: Plan
    shown: Shown
    finished: Image | None = None
    complete: bool = False  # the last pass is shown
    exposure: float = 0.0


class _Patient(threading.Event):
    """Set once a newer state has come and PATIENCE has passed."""

    def __init__(self, newer: Callable[[], bool]) -> None:
        super().__init__()
        self._newer, self._began = newer, time.monotonic()

    def is_set(self) -> bool:
        return self._newer() and time.monotonic() - self._began > PATIENCE


class Studio:
    """Draws one scene. `tell` takes messages for all pages, `show` pictures with their description; both in this thread."""

    def __init__(
        self, opened: Opened, tell: Tell, show: Show, finished: Callable[[Current, State], None] | None = None,
        edited: Callable[[dict[str, Any]], None] | None = None,
    ) -> None:  # fmt: skip
        """`finished` is called with each finished picture of the saved scene, without changes of the pages; `edited` with the
        counts of each edit, see edit_counts.py, when it ends or the next one comes."""
        self.opened, self._edited = opened, edited
        self.tell, self.show, self._finished = tell, show, finished
        self.state = State()
        self.files: tuple[Path, ...] = (scene_files.real_path(opened.path),)
        self.current: Current | None = None
        self._compiled: Compiled | None = None
        self._stages = stage_cache.StageCache()
        self.work = Work(self._stages)
        self._compilation = Interruptible()
        self._changed = threading.Condition()
        self._cancel = threading.Event()
        self._version = 1  # of the state and the files
        self._view = 0  # of the exposure
        self._stopped = False
        self._pace = Pace()
        self._pose: Any = None  # of the last picture
        self._rows: Any = None  # of the last plan that was told
        self._disk: Any = None
        self._thread = threading.Thread(target=self._run, name="studio", daemon=True)

    # --- from other threads ---

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """End the thread; a picture that is being drawn is cancelled."""
        with self._changed:
            self._stopped = True
            self._compilation.interrupt(0.0)
            self._cancel.set()
            self._changed.notify_all()
        if self._thread.is_alive():
            self._thread.join(timeout=3.0)

    def change(self, update: Callable[[State], State]) -> State:
        """Replace the state by update(state) and draw it. Raises StateError, which `update` raises."""
        with self._changed:
            before, self.state = self.state, update(self.state)
            same_texts = replace(self.state, texts=before.texts)
            if replace(same_texts, exposure=before.exposure) != before or self._texts_differ(before):
                self._newer()
            elif self.state != before:
                self._view += 1
                self._changed.notify_all()
            return self.state

    def _texts_differ(self, before: State) -> bool:
        """Whether the contents of sources are not those that were compiled last."""
        texts = self.state.texts
        return texts != before.texts and scene_files.fingerprint(self.files, texts) != self._disk

    def files_changed(self) -> None:
        """Compile again if the contents of files have changed."""
        with self._changed:
            if self._disk is not None and self._disk != scene_files.fingerprint(self.files, self.state.texts):
                self._newer()

    def _newer(self) -> None:
        self._version += 1
        self._compilation.interrupt(PATIENCE)
        self._cancel.set()
        self._changed.notify_all()

    # --- the thread ---

    def _run(self) -> None:
        done, viewed = 0, 0
        while True:
            with self._changed:
                while not self._stopped and (self._version, self._view) == (done, viewed):
                    self._changed.wait()
                if self._stopped:
                    return
                version, viewed, state = self._version, self._view, self.state
                self._cancel.clear()
            if version == done:
                self._publish(state)
                continue
            done = version
            self.work.begin()
            try:
                self._draw(version, state)
            except (Interrupted, Cancelled):
                pass  # the next state is there
            except SceneError as error:
                self._tell_errors(error.diagnostics, state)
            except planner.PlanError as error:
                self._tell_errors([Diagnostic("error", str(error))], state)
            except MemoryError:
                self._tell_errors([Diagnostic("error", "not enough memory for this picture", None, "give a smaller --size")], state)
            except Exception as fault:
                message = f"internal error: {type(fault).__name__}: {fault}"
                self._tell_errors([Diagnostic("error", message, None, "this is a bug in maquette, not an error in the scene")], state)
            counts = self.work.end()
            if self._edited is not None:
                self._edited(counts)

    def _tell_errors(self, diagnostics: Any, state: State) -> None:
        self.tell({"type": "diagnostics", "failed": True, "items": scene_files.diagnostics_json(diagnostics, state.texts)})
        self.tell({"type": "progress", "stage": "failed", "share": 0.0})

    def _compile(self, state: State) -> Compiled:
        key = scene_files.fingerprint(self.files, state.texts), dict(state.sets), state.moment
        if self._compiled is not None and self._compiled.key == key:
            return self._compiled
        self._disk, began = key[0], time.time_ns()
        self.tell({"type": "progress", "stage": "compiling", "share": 0.0})
        diagnostics, self._compiled = Diagnostics(), None
        self.work.counted["scenes evaluated"] += 1
        try:
            with self._compilation.running(), self._stages.compiling():
                scene = self.opened.compile(state, diagnostics)
        except SceneError as error:
            named = (scene_files.real_path(d.span.file) for d in error.diagnostics if d.span and Path(d.span.file).is_file())
            self._set_files([*self.files, *named], began, state.texts)
            raise
        self._set_files([scene_files.real_path(self.opened.path), *map(Path, scene.files)], began, state.texts)
        key = (self._disk, *key[1:])
        self._compiled = Compiled(key, scene, tuple(diagnostics.items))
        self.tell({"type": "params", "items": params.controls(scene)})
        cameras = [name for name in scene.names.cameras if name]
        choices = {"channels": channel_labels(), "backends": BACKENDS}
        about = {**choices, "cameras": cameras, "defaults": list(scene.defaults), "timeline": self.opened.timeline(scene)}
        self.tell({"type": "scene", "name": self.opened.path.name, **about})
        return self._compiled

    def _set_files(self, files: list[Path], began: int, texts: Mapping[str, str]) -> None:
        """Set the files that were read since `began`, nanoseconds since 1970; compile again if a new one was changed meanwhile."""
        with self._changed:
            before, self.files = self.files, tuple(dict.fromkeys(files))
            if before == self.files:
                return
            self._disk = scene_files.fingerprint(self.files, texts)
            if any(scene_files.changed_since(began, file) for file in self.files if file not in before):
                self._newer()
        self.tell({"type": "files"})

    def _draw(self, version: int, state: State) -> None:
        compiled = self._compile(state)
        scene = compiled.scene
        settings = replace(
            self.opened.settings, backend=state.backend or self.opened.settings.backend, camera=state.camera or self.opened.settings.camera
        )
        plan = planner.make_plan(scene, settings, self.opened.overrides)
        if plan["size"][0] * plan["size"][1] > MAX_PIXELS:
            raise planner.PlanError(f"the window shows at most {MAX_PIXELS:,} pixels: give a smaller --size")
        if state.pose is not None:
            scene = poses.place(scene, plan["camera"], state.pose)
            plan = planner.make_plan(scene, settings, self.opened.overrides)
        warnings = [*compiled.warnings, *picture_notes.plan_warnings(scene, plan)]
        self.tell({"type": "diagnostics", "failed": False, "items": scene_files.diagnostics_json(warnings, state.texts)})
        self._tell_plan(plan)
        self.work.reach("compiled")
        began = time.monotonic()
        listener = self._compiling
        compile_events.LISTENERS.append(listener)
        try:
            quick = Quick(scene, settings, self.opened.overrides, plan, state.channel)
            complete = self._first_pictures(version, state, quick) and self._draw_channels(version, quick, False)
            if complete and state.channel not in SEEN and not self._cancel.is_set():
                image = self._last_picture(version, state, scene, plan)
                self._finish(version, state, image, warnings, began)
                if not image.metadata["partial"]:
                    self._draw_channels(version, quick, True)
            elif complete and self.current is not None:
                self.current.complete = True
                self._publish(self.state)
                self._tell_done(1.0, {}, plan, began)
        finally:
            compile_events.LISTENERS.remove(listener)

    def _first_pictures(self, version: int, state: State, quick: Quick) -> bool:
        """Draw the coarse and the whole picture; False if a newer state came."""
        moving, self._pose = state.pose != self._pose, state.pose
        for k, plan in enumerate(quick.first(self._pace, moving)):
            cancel = _Patient(lambda: self._stopped or self._version != version) if k == 0 else self._cancel
            image = self._draw_picture(quick.scene, plan, None, cancel)
            if image.metadata["partial"]:
                return False
            if not plan["aov"]:
                self._pace.add(image.width * image.height, image.metadata["seconds"]["render"])
            self.current = Current(version, quick.scene, quick.plan, Shown.from_image(image, {}))
            self._publish(self.state)
            self.work.reach("first picture")
            if image.channels.keys() > {"rgba"}:
                self._tell_channels()
            if self._version != version:
                return False
        self.work.reach("whole picture")
        with self._changed:
            return not self._changed.wait_for(lambda: self._stopped or self._version != version, REST)

    def _draw_channels(self, version: int, quick: Quick, full: bool) -> bool:
        """Draw the channels for clicks and outlines; False if a newer state came."""
        plan, current = quick.channels(full), self.current
        if plan is None or current is None:
            return True
        image = self._draw_picture(quick.scene, plan)
        if image.metadata["partial"] or self._version != version:
            return False
        current.shown = Shown(current.shown.rgba, {name: image.channels[name] for name in plan["aov"]}, current.shown.samples)
        self._tell_channels()
        return True

    def _draw_picture(
        self, scene: ir.Scene, plan: Plan, report: Callable[[Progress], None] | None = None, cancel: threading.Event | None = None
    ) -> Image:  # fmt: skip
        image = render_scene.draw(scene, plan, report, cancel or self._cancel, quick=report is None, progressive=True)
        self.work.counted["pictures drawn"] += 1
        self.work.counted["pixels drawn"] += image.width * image.height
        return image

    def _tell_channels(self) -> None:
        """Tell the camera, whose distance channels give, and that clicks and outlines have new channels."""
        current = self.current
        assert current is not None
        self._tell_view()
        self.tell({"type": "channels", "version": current.version})

    def _last_picture(self, version: int, state: State, scene: ir.Scene, plan: Plan) -> Image:
        current = self.current
        assert current is not None
        first = current.shown
        began = last = time.monotonic()
        spent, view, samples, previews = 0.0, self._view, None, Previews()

        def report(progress: Progress) -> None:
            nonlocal last, spent, view, samples
            now = time.monotonic()
            samples = samples if progress.picture is None else progress.picture.samples
            if now - last < max(TICK, spent / SHARE) and view == self._view:
                return
            previews.offer(progress, now - began)
            denoised = previews.take()
            if denoised is not None:
                current.shown = Shown(denoised, first.channels, samples)
            elif progress.picture is not None and not previews.shown:
                current.shown = first.refined(*progress.picture)
            if denoised is not None or (progress.picture is not None and (view != self._view or not previews.shown)):
                self._publish(self.state)
            self._tell_progress(progress, previews.shown)
            spent, view = time.monotonic() - now, self._view
            last = time.monotonic()

        self.tell({"type": "progress", "stage": "rendering", "share": 0.0, "samples": 1, "most": 0, "error": None})
        image = self._draw_picture(scene, plan, report)
        if not image.metadata["partial"]:
            current.shown = Shown(image.channels["rgba"], first.channels, samples)
        return image

    def _finish(self, version: int, state: State, image: Image, warnings: list[Diagnostic], began: float) -> None:
        current = self.current
        if image.metadata["partial"] or current is None:
            return
        current.finished, current.complete = image, True
        self.work.reach("finished")
        self._publish(self.state)
        all_warnings = [*warnings, *picture_notes.of_render(image.metadata, current.scene, current.plan, self.opened.settings)]
        all_warnings += picture_notes.late_drawing_warnings(image.metadata, current.plan)
        self.tell({"type": "diagnostics", "failed": False, "items": scene_files.diagnostics_json(all_warnings, state.texts)})
        denoised = bool(image.metadata.get("denoised"))
        self._tell_done(image.metadata["samples_mean"], image.metadata, current.plan, began, denoised)
        untouched = State(channel=state.channel, exposure=state.exposure)
        if self._finished is not None and state == untouched and self._version == version:
            self._finished(current, state)

    # --- messages ---

    def _publish(self, state: State) -> None:
        """Show the current picture with the exposure and the channel of `state`."""
        current = self.current
        if current is None:
            return
        shown, plan = current.shown, current.plan
        name = state.channel
        exposure = plan["exposure"] if state.exposure is None else state.exposure
        metered = exposure == "metered"
        if metered:
            exposure = image_files.auto_exposure(shown.rgba)
        current.exposure = float(exposure)
        if name == "samples" and shown.samples is not None:
            codes = channels.auxiliary(name, shown.samples)
        elif name in shown.channels:
            codes = channels.auxiliary(name, shown.channels[name])
        else:
            name = "color"
            codes = channels.colors(shown.rgba, image_files.Look.of(plan, float(exposure)))
        height, width = codes.shape[:2]
        x0, y0, x1, y1 = plan["crop"]
        about = {
            "version": current.version, "width": width, "height": height, "full": [x1 - x0, y1 - y0], "channel": name,
            "exposure": float(exposure), "metered": metered, "finished": current.complete,
        }  # fmt: skip
        self.show(about, codes.tobytes())

    def _tell_plan(self, plan: Plan) -> None:
        rows = plan_rows(plan)
        if rows != self._rows:
            self._rows = rows
            self.tell({"type": "plan", "rows": rows})

    def _tell_view(self) -> None:
        current = self.current
        assert current is not None
        camera = current.plan["camera"]
        pose = self.state.pose or poses.read(current.scene, camera, picking.center_depth(current.shown))
        cameras = current.scene.tables.cameras
        names = current.scene.names.cameras
        self.tell({
            "type": "view", "position": pose.position, "look_at": pose.look_at, "up": pose.up,
            "extent": float(cameras.extent[camera]),
            "projection": ir.Projection(int(cameras.projection[camera])).name.lower(), "horizontal": bool(cameras.fit[camera]),
            "camera": names[camera] if camera < len(names) else "", "backend": current.plan["backend"], "size": list(current.plan["size"]),
            "version": current.version,
        })  # fmt: skip

    def _tell_progress(self, progress: Progress, denoised: bool) -> None:
        self.tell({
            "type": "progress", "stage": progress.stage, "share": progress.share, "samples": progress.samples, "most": progress.most,
            "error": _finite(progress.error), "denoised": denoised,
        })  # fmt: skip

    def _tell_done(self, samples: float, metadata: Mapping[str, Any], plan: Plan, began: float, denoised: bool = False) -> None:
        error, bias = _finite(metadata.get("error")), metadata.get("bias")
        words = omitted_light.phrase(error, bias, metadata.get("left_out", ()), plan["bounces"])
        about = {"samples": samples, "seconds": time.monotonic() - began, "denoised": denoised}
        about |= {"error": omitted_light.with_bias(error, bias), "told": words}
        self.tell({"type": "progress", "stage": "done", "share": 1.0, **about})

    def _compiling(self, event: compile_events.Compiling | None) -> None:
        if event is not None:
            stage = f"compiling kernel {event.number} of about {event.total}"
            self.tell({"type": "progress", "stage": stage, "share": event.number / (event.total + 1)})

    def camera_source(self) -> str:
        """The camera that the window shows, as source; "" before the first picture."""
        current = self.current
        if current is None:
            return ""
        camera = current.plan["camera"]
        pose = self.state.pose or poses.read(current.scene, camera, picking.center_depth(current.shown))
        return poses.source_text(current.scene, camera, pose, current.plan["size"])


def plan_rows(plan: Plan) -> list[dict[str, Any]]:
    """The decisions of a plan for the page, the most important ones first."""
    first = importance.most_important(plan)
    rest = [d for d in plan.decisions.values() if d not in first]
    return [
        {"name": d.name, "value": show_value(d.value), "reason": d.reason, "switch": d.fixed or d.switch, "matters": d in first}
        for d in (*first, *rest)
    ]


def _finite(value: Any) -> float | None:
    return float(value) if value is not None and abs(value) < float("inf") else None
