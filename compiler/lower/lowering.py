"""Lowering driver: blocks compose transforms and pass on materials; each element becomes rows of the builder."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ...lang import file_types
from ...lang.diagnostics import Span
from ...lang.elements import Document, Element
from ...lang.schema.meters import METER
from .. import ir
from ..importers.common.mesh_options import MeshOptions
from ..importers.common.replacements import Replacements
from ..io.sandbox import FileError
from ..scene import defaults, transforms
from ..scene.builder import SceneBuilder
from ..scene.row_records import Piece
from . import cameras, lights, materials, media, meters, shapes
from .placements import ORIGIN, Frame, Placements, compose, matrix, own_frame, rotation_of

LARGEST = 1e18  # of any number of an element: products of a few stay finite
_OF_BODIES = ("emissive", "subsurface", "blend")  # materials for which it counts what a shape encloses
MAX_EMISSIVE_SPHERES = 64  # sampled as lights; more are visible, and light others by bounces alone
Folder = Callable[[str], Path | None]


def lower(document: Document, builder: SceneBuilder, folder: Folder | None = None) -> ir.Scene:
    """The scene of an evaluated document. Errors go to the builder's diagnostics; other elements are lowered.

    `folder(shown file name)` is where the files that a source names are looked for (the scene's own folder when None).
    """
    with np.errstate(all="ignore"):  # overflows are reported where values are used
        return _lower(document, builder, folder)


def _lower(document: Document, builder: SceneBuilder, folder: Folder | None) -> ir.Scene:
    lowering = Lowering(document, builder, folder)
    lowering.place()
    if "fog" in document.settings:
        lowering.media.fog(document.settings["fog"])
    for element in document.cameras:
        if not lowering.beyond(element):
            cameras.camera(lowering, element)
    settings = cameras.settings(lowering, document.settings.get("render"), document.cameras)
    animate = document.settings.get("animate")
    return builder.finish(
        document.name,
        settings=settings,
        photometric=lowering.photometric,
        duration=animate.args["duration"] if animate else None,
        fps=animate.args["fps"] if animate else 24.0,
        defaults=defaults.add(builder, settings, Span(document.name)),
        files=tuple(dict.fromkeys((*document.files, *builder.files.read))),
        params=document.params,
        meters=tuple(lowering.meters),
    )


class Lowering:
    """The state of lowering one document: its builder and what elements share."""

    def __init__(self, document: Document, builder: SceneBuilder, folder: Folder | None) -> None:
        self.document = document
        self.builder = builder
        self.files = builder.files
        self.photometric = False
        self.materials = materials.Materials(weakref.proxy(self))  # without a cycle, so that the document is freed at once
        self.media = media.Media(weakref.proxy(self))
        self.placements = Placements(builder)
        self.centered: dict[Any, int] = {}
        self._folder = folder
        self._emissive = 0
        self._scale = 1.0  # of the frame of the element, at most
        self.generated: dict[tuple[object, ...], list[Piece]] = {}
        self.meters: list[ir.Meter] = []
        self._meshes: dict[tuple[Any, ...], list[Piece]] = {}

    # --- Context ---

    def error(self, element: Element, message: str, hint: str = "") -> None:
        self.builder.diagnostics.error(*_located(element, message, hint))

    def warn(self, element: Element, message: str, hint: str = "") -> None:
        self.builder.diagnostics.warning(*_located(element, message, hint))

    @property
    def tolerance(self) -> float | None:
        deviation = self.builder.deviation
        return None if deviation is None else deviation / max(self._scale, 1e-300)

    @contextmanager
    def scaled(self, matrix: np.ndarray) -> Iterator[None]:
        before = self._scale
        if self.builder.deviation is not None:
            size = float(np.linalg.norm(matrix[:3, :3], 2)) if np.isfinite(matrix).all() else 1.0
            self._scale = before * (size or 1.0)
        try:
            yield
        finally:
            self._scale = before

    def is_shape(self, element: Element) -> bool:
        return element.kind in shapes.KINDS

    def pieces(self, element: Element) -> list[Piece]:
        """The geometries of a shape."""
        return shapes.pieces(self, element)

    def block(self, element: Element) -> np.ndarray | None:
        """The transform of a block; None for other elements."""
        return matrix(_BLOCKS[element.kind](element)) if element.kind in _BLOCKS else None

    def refuse(self, element: Element, message: str, hint: str = "") -> list[Piece]:
        """An error, and no pieces."""
        self.error(element, message, hint)
        return []

    def folder(self, element: Element) -> Path | None:
        """The folder of the source of an element, which its file names are relative to."""
        return self._folder(element.place.file) if self._folder else None

    def beyond(self, element: Element) -> bool:
        """Whether an element has a number above LARGEST; reports it."""
        args = element.args
        for name in element.given:
            if _is_beyond(args[name]):
                self.error(element, f"`{name}` holds {_biggest(args[name]):.6g}: that is too big to be drawn", f"at most {LARGEST:g}")
                return True
        return False

    # --- placing ---

    def place(self) -> None:
        """Place every element of the document, in order, without recursion."""
        waiting: list[tuple[Element, Frame, Element | None, Element | None, str]] = [
            (element, ORIGIN, None, None, "") for element in reversed(self.document.elements)
        ]
        while waiting:
            element, block, material, medium, path = waiting.pop()
            kind, args = element.kind, element.args
            if self.beyond(element):
                continue
            if kind in lights.KINDS:
                self._light(element, block)
                continue
            if kind == METER.name:
                self._meter(element, block, path)
                continue
            frame = compose(block, _BLOCKS.get(kind, own_frame)(element))
            material, medium = args.get("material") or material, args.get("medium") or medium
            if type(frame) is not tuple and not np.abs(frame).max() <= LARGEST**2:
                self.error(element, "the blocks around this make it bigger, or move it farther, than can be drawn")
            elif kind in _BLOCKS:
                name = args.get("name")
                inner_path = f"{path}{name}/" if name else path
                waiting.extend([(child, frame, material, medium, inner_path) for child in reversed(element.children)])
            elif kind in shapes.KINDS:
                self._shape(element, frame, material, medium, path)
            elif kind == "usd":
                self.placements.flush()
                if medium is not None:
                    self.warn(element, "shapes of a USD file get no medium of the block around them", "write it around other shapes alone")
                self._usd(element, matrix(frame), material, path)
            else:
                self.error(element, f"`{kind}` is not built yet")
        self.placements.flush()

    def _light(self, element: Element, block: Frame) -> None:
        self.placements.flush()
        if isinstance(block, np.ndarray) and transforms.inverse(np.asarray(block)) is None:
            self.warn(element, "the block around this light flattens it to nothing: it is left out", "a scale must not be 0")
        else:
            lights.light(self, element, matrix(block))

    def _meter(self, element: Element, block: Frame, path: str) -> None:
        meter = meters.meter(self, element, matrix(block), path)
        if meter is not None:
            self.meters.append(meter)

    def _shape(self, element: Element, frame: Frame, material: Element | None, medium: Element | None, path: str) -> None:
        args = element.args
        name = path + (args["name"] or element.scope or element.kind)
        if element.kind in shapes.CENTERED and medium is None and (material is None or material.kind not in _OF_BODIES):
            geometry, center = shapes.centered(self, element)
            row = -1 if material is None else self.materials.row(material)
            self.placements.add(frame, center, geometry, row, name, element.place, element.call)
            return
        with self.scaled(matrix(frame)):
            pieces = self.pieces(element)
        inside = self.media.inside(element, medium, material, pieces, matrix(frame)) if medium is not None and pieces else None
        for piece in pieces:
            if (
                material is not None
                and not piece.chosen
                and material.kind == "emissive"
                and self._shining_sphere(element, material, matrix(compose(frame, piece.matrix)))
            ):
                continue
            row = piece.material if piece.material >= 0 and (args["material"] is None or piece.chosen) else -1
            if row < 0 and material is not None:
                row = self.materials.row(material)
            if inside is not None:
                row = self.media.boundary(element, inside, row, piece)
            else:
                row = row if piece.mixed is None else piece.mixed(row)
                self.media.warn_of_open_body(element, row, pieces)
            full = f"{name}/{piece.name}" if piece.name else name
            self.placements.add(frame, piece.matrix, piece.geometry, row, full, element.place, element.call)

    def _shining_sphere(self, element: Element, material: Element, matrix: np.ndarray) -> bool:
        """Make a uniformly scaled sphere of one emitted colour a light. Returns whether it is one."""
        color = material.args["color"]
        if element.kind != "sphere" or isinstance(color, Element) or transforms.inverse(matrix) is None:
            return False
        frame, scale, _ = lights.rigid(matrix)
        skewed = np.abs(matrix[:3, :3].T @ matrix[:3, :3] - np.diag(scale**2)).max()
        if self._emissive >= MAX_EMISSIVE_SPHERES or np.ptp(scale) > 1e-6 * scale[0] or skewed > 1e-6 * scale[0] ** 2:
            return False
        self._emissive += 1
        self.placements.flush()
        self.photometric |= material.photometric
        radiance = tuple(material.args["luminance"] * c for c in color)
        size = (element.args["radius"] * float(scale.mean()), 0.0)
        lights.add_area_light(self, element, ir.LightKind.SPHERE, frame, size, radiance)  # type: ignore[arg-type]
        return True

    # --- files ---

    def mesh_file(self, element: Element) -> list[Piece]:
        """The pieces of a mesh file, which is read once."""
        from ..importers import mesh_files

        path = self._find(element, "mesh")
        if path is None:
            return []
        args = element.args
        scaled = args["height"] is not None  # then the unit is of no account
        key = path, args["unit"], args["up"], scaled, args["repair"]
        if key not in self._meshes:
            options = MeshOptions(args["unit"] or ("m" if scaled else None), args["up"], repair=args["repair"] or None)
            with self._within(element):
                parts = mesh_files.read(
                    path, self._shown(path), self.builder, self.builder.diagnostics, element.place, self.files, options=options
                )
            self._meshes[key] = [
                Piece(
                    part.geometry,
                    transforms.identity() if part.transform is None else transforms.from_rows(part.transform),
                    -1 if part.material is None else part.material,
                    part.name,
                    material_name=part.material_name,
                )
                for part in parts
            ]
        return self._meshes[key]

    @contextmanager
    def _within(self, element: Element) -> Iterator[None]:
        """Diagnostics in other files get `element` in their trace."""
        items = self.builder.diagnostics.items
        count = len(items)
        yield
        for i, diagnostic in enumerate(items[count:], count):
            if diagnostic.span is not None and element.place is not None and diagnostic.span.file != element.place.file:
                items[i] = replace(diagnostic, trace=(*diagnostic.trace, (element.kind, element.place)))

    def _shown(self, path: Path) -> str:
        """A file's name in messages: relative to the scene's folder if possible."""
        beside = Path(self.document.name).parent
        return str(beside / path.relative_to(self.files.root)) if path.is_relative_to(self.files.root) else str(path)

    def _find(self, element: Element, what: str) -> Path | None:
        try:
            return self.files.find(element.args["file"], self.folder(element), what)
        except FileError as failure:
            self.error(element, failure.message, failure.hint)
            return None

    def _usd(self, element: Element, matrix: np.ndarray, material: Element | None, path: str) -> None:
        from ..importers.usd import load

        file = self._find(element, "stage")
        if file is not None:
            args = element.args
            row = -1 if material is None else self.materials.row(material)
            name = path + (args["name"] or element.scope)
            replaced = Replacements(self.material_rows(element), -1 if args["material"] is None else row)
            unit = None if args["unit"] is None else file_types.UNITS[args["unit"]]
            stage = load.Placed(file, matrix, args["prim"], row, name, replaced, args["height"], rotation_of(element), unit, args["up"])
            load.place(self.builder, stage, element.place)

    def material_rows(self, element: Element) -> tuple[tuple[str, int], ...]:
        """The rows of the argument `materials`, by the names in it."""
        return tuple((name, self.materials.row(material)) for name, material in element.args["materials"] or ())


def _is_beyond(value: object) -> bool:
    """Whether a number, or one in nested tuples, has a magnitude above LARGEST."""
    if type(value) is float:
        return not -LARGEST <= value <= LARGEST
    if type(value) is tuple:
        for part in value:
            if type(part) is float:
                if not -LARGEST <= part <= LARGEST:
                    return True
            elif type(part) is tuple and _is_beyond(part):
                return True
    return False


def _biggest(value: object) -> float:
    """The largest magnitude in a number or nested tuples of numbers; 0 for anything else."""
    if isinstance(value, float):
        return abs(value)
    return max(map(_biggest, value), default=0.0) if isinstance(value, tuple) else 0.0


def _transform_block(element: Element) -> Frame:
    rows = element.args["matrix"]
    return own_frame(element) if rows is None else transforms.from_rows(rows)


_BLOCKS: dict[str, Callable[[Element], Frame]] = {
    "group": own_frame,
    "transform": _transform_block,
    "translate": lambda element: element.args["by"],
    "rotate": lambda element: transforms.rotation(element.args["by"]),
    "scale": lambda element: transforms.scaling(element.args["by"]),
}


def _located(element: Element, message: str, hint: str) -> tuple[str, Span, str, tuple[tuple[str, Span], ...]]:
    """(message, place, hint, trace) about an element. For one of the library: at the call from outside, and where the element is."""
    if element.place is element.span:
        return message, element.span, hint, element.trace
    (name, place), *outer = element.calls
    return f"{message} (in {name}, {element.span})", place, hint, tuple(outer)
