"""The formats that `maquette convert` writes, a row each. The command, its messages and docs/export.md read them."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

from ...lang.diagnostics import Diagnostic

if TYPE_CHECKING:
    from .export import Export
    from .export_job import ExportJob


@dataclass(frozen=True, slots=True)
class Writer:
    """One format.

    `endings` are the endings of its files with what they are. `module`, in compiler/exporters, has the function `export`, which takes
    an ExportJob and returns an Export; it is loaded for such a file alone. `geometry`, `materials` and `lights` say what a file holds.
    `planned`: it has a camera, so that the options of pictures apply; `refusal` is the answer to them otherwise. `deviation`: it holds
    triangles, whose distance from the surface an option limits. `bakes`: patterns become pictures, whose size an option limits.
    """

    name: str
    endings: dict[str, str]
    module: str
    geometry: str
    materials: str = "none"
    lights: str = "none"
    planned: bool = True
    deviation: bool = True
    bakes: bool = False
    refusal: str = "a file of triangles has no camera: leave out the options of pictures"


_COLORS = "a colour for each triangle, or for each vertex of a mesh that has them"
_OWN = "shapes as they are, others as triangles", "the nearest of the program's own", "the program's own"
WRITERS = (
    Writer(
        "saved IR",
        {".npz": "a saved IR"},
        "saved",
        "everything, for maquette itself",
        "everything",
        "everything",
        False,
        False,
        refusal="a saved IR has no render plan: give options of the picture to `maquette render OUT.npz`",
    ),
    Writer(
        "the language",
        {".scene": "readable source"},
        "language.scene",
        "shapes as they are, meshes beside it, others as triangles",
        "everything",
        "everything but motion",
    ),
    Writer("Mitsuba 3", {".xml": "Mitsuba 3"}, "mitsuba.scene", *_OWN, deviation=False),
    Writer("POV-Ray 3.7", {".pov": "POV-Ray 3.7"}, "povray.scene", *_OWN, deviation=False),
    Writer(
        "glTF 2.0",
        {".glb": "glTF 2.0"},
        "gltf.scene",
        "triangles",
        "metallic–roughness, glass, clear coat, pictures; patterns as pictures",
        "point, spot, directional; area lights as shining meshes",
        bakes=True,
    ),
    Writer(
        "USD",
        {".usda": "USD, as text", ".usdc": "USD", ".usdz": "USD with its pictures"},
        "usd.scene",
        "triangles, equal ones written once",
        "UsdPreviewSurface, and OpenPBR by MaterialX; pictures; patterns as graphs, else as pictures",
        "UsdLux with light links; the first camera is `main_cam`",
        bakes=True,
    ),
    Writer("STL", {".stl": "triangles for printing"}, "triangles.stl", "closed triangles in millimetres, z up", planned=False),
    Writer("3MF", {".3mf": "the same"}, "triangles.threemf", "closed triangles in millimetres, z up", _COLORS, planned=False),
    Writer(
        "OBJ",
        {".obj": "triangles"},
        "triangles.obj",
        "closed triangles in metres, y up",
        f"{_COLORS}, with a `.mtl` beside it",
        planned=False,
    ),
    Writer("PLY", {".ply": "triangles"}, "triangles.ply", "closed triangles in metres, y up", _COLORS, planned=False),
)


def writer_of(ending: str) -> Writer | None:
    """The row for files with an ending in small letters; None for formats that are not written."""
    return next((writer for writer in WRITERS if ending in writer.endings), None)


def known_endings() -> str:
    """The endings of all formats with what they are."""
    return ", ".join(f"{ending} ({what})" for writer in WRITERS for ending, what in writer.endings.items())


def with_deviation() -> str:
    """The endings of formats of triangles."""
    return ", ".join(ending for writer in WRITERS if writer.deviation for ending in writer.endings)


def with_pictures() -> str:
    """The endings of formats in which patterns become pictures."""
    return ", ".join(ending for writer in WRITERS if writer.bakes for ending in writer.endings)


def help_lines() -> list[str]:
    """A line for each format: its endings, its name and its geometry."""
    rows = [(" ".join(writer.endings), f"{writer.name}: {writer.geometry}") for writer in WRITERS]
    width = max(len(endings) for endings, _ in rows) + 2
    return [f"{endings:<{width}}{text}" for endings, text in rows]


def table() -> str:
    """The formats as a table of Markdown, for docs/export.md."""
    rows = [(f"{', '.join(f'`{e}`' for e in w.endings)} ({w.name})", w.geometry, w.materials, w.lights) for w in WRITERS]
    head = ["| file | geometry | materials | lights and cameras |", "|---|---|---|---|"]
    return "\n".join([*head, *(f"| {' | '.join(row)} |" for row in rows)])


def export(writer: Writer, job: ExportJob) -> Export:
    """A scene in a format. Raises ExportError."""
    write = cast("Callable[[ExportJob], Export]", importlib.import_module(f".{writer.module}", __package__).export)
    exported = write(job)
    if job.scene.meters and writer.lights != "none" and writer.lights != "everything":
        warning = Diagnostic("warning", "light meters are not carried", job.scene.meters[0].place, "a saved IR (.npz) keeps them")
        exported.diagnostics.append(warning)
    return exported
