"""Writes and reads the checkpoints of a render job, and notes why a picture has none."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import click

from ...lang.diagnostics import Diagnostic
from ..progress import Display

if TYPE_CHECKING:
    from ...compiler import ir
    from ...compiler.plan.plan import Plan
    from ...render.film.checkpoint import Keeper

FIRST, EVERY = 60.0, 30.0  # seconds to the first checkpoint, and between others


class Job(Protocol):
    """What is needed of a render_job.Job."""

    output: Path
    quiet: bool
    files: tuple[Path, ...]
    checkpoint: float | None
    resume: bool
    display: Display

    def report(self, diagnostics: Iterable[Diagnostic]) -> None:
        """Print diagnostics."""
        ...


class Reading(Protocol):
    """What is needed of a render_job.Reading."""

    @property
    def path(self) -> Path: ...
    @property
    def scene(self) -> ir.Scene: ...
    @property
    def plan(self) -> Plan: ...
    @property
    def parts(self) -> Sequence[Plan]: ...


def keeper_of(job: Job, read: Reading) -> Keeper | None:
    """The writer of a picture's checkpoints, beside its file; None for none. Tells of a checkpoint that exists."""
    from ...render import render_scene

    why = "it is drawn in strips" if len(read.parts) > 1 else render_scene.why_without_checkpoint(read.plan)
    if why:
        tell_of_none(job, why, read.path == job.output)
    file = read.path.with_name(f"{read.path.name}.checkpoint")
    if len(read.parts) > 1 or (job.checkpoint == 0.0 and not (job.resume and os.path.isfile(file))):
        return None
    from ...render.cluster.identity import identity
    from ...render.film import checkpoint

    first, every = (FIRST, EVERY) if job.checkpoint is None else (job.checkpoint or math.inf,) * 2

    def key() -> str:
        return checkpoint.key_of(read.scene, read.plan, json.dumps(identity()))

    def fail(fault: OSError) -> None:
        hint = "the picture goes on; make room there, or give --checkpoint off"
        job.report([Diagnostic("warning", f"cannot write {file}: {fault.strerror or fault}", hint=hint)])

    exists = checkpoint.exists(file, job.files)
    keeper = checkpoint.Keeper(file, key, first, every, job.resume, fail)
    if job.resume and exists and keeper.saved_state is None:
        again = "is damaged, or of another scene, version, machine or settings: the picture begins anew"
        job.report([Diagnostic("warning", f"{file} {again}")])
    elif exists and not job.quiet:
        state = keeper.saved_state
        job.display.hide()
        click.echo(
            f"goes on from {file}, with {state.arrays['samples'].mean():.3g} samples a pixel" if state is not None
            else f"{file} is there: --resume goes on from it",
            err=True,
        )  # fmt: skip
    elif job.resume and not why and read.path == job.output:
        job.report([Diagnostic("note", f"--resume has no effect: there is no {file}")])
    return keeper


def tell_of_none(job: Job, why: str, alone: bool) -> None:
    """Note the options of checkpoints that have no effect on a picture; --resume has one if it is not `alone`, but a frame."""
    if job.checkpoint:
        job.report([Diagnostic("note", f"--checkpoint has no effect: the picture has no checkpoints, as {why}")])
    if job.resume and alone:
        job.report([Diagnostic("note", f"--resume has no effect: the picture has no checkpoints, as {why}")])
