"""Exports a scene as tables that every command reads as a scene (.npz)."""

from __future__ import annotations

from functools import partial

from ..scene import serialize
from .export import Export
from .export_job import ExportJob


def export(job: ExportJob) -> Export:
    """The tables of the scene."""
    return Export(job.scene, write=partial(serialize.save, job.scene))
