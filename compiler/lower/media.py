"""Lowers participating media: what fills closed shapes, and the fog of a scene."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...lang.elements import Color, Element
from ...lang.formula_graph import Formula
from ...materials import MATERIALS
from ...shapes import SHAPES
from .. import ir
from ..formula import upper_bounds
from ..formula.tape import Tape
from ..importers import voxels
from ..importers.images import ImageError
from ..io.sandbox import FileError
from ..mesh import built_geometry
from ..mesh.topology import merged
from ..scene import phase_functions
from ..scene.row_records import (
    BLACK,
    WHITE,
    Input,
    MaterialData,
    MediumData,
    Piece,
    TextureData,
    multiply_colors,
    scale_color,
)
from .context import Context

KOSCHMIEDER = 3.912  # extinction times visibility: −ln 2 %
DEPTH = 0.1  # metres, the mean free path without one
VISIBILITY = 100.0  # metres
HEIGHTS = 8.0  # of visibility over the falloff of a fog that has neither top nor falloff
Kind, Model, Slot = ir.GeometryKind, ir.MaterialModel, ir.Slot
_TO_CLOSE = {
    "mesh": "mesh(…, repair: true) fills its holes and turns its faces outwards",
    "heightfield": "with a `base` it is a solid",
    "text": "give it a `depth`",
    "revolve": "leave out `closed: false`",
    "curve": 'leave out `caps: "open"`',
    "implicit": "an inequality (<=) is a solid; == is a surface alone",
    "triangle": "a thin `box` has an inside",
    "polygon": "`extrude` makes a solid of it",
    "plane": "a `box` has an inside",
}


class Inside:
    """The medium inside of one placed shape. `own`: it is an argument of the shape, not of a block around it."""

    def __init__(self, element: Element, own: bool, bounds: np.ndarray, matrix: np.ndarray) -> None:
        self.element, self.own, self.bounds, self.matrix = element, own, bounds, matrix


class Media:
    """Rows of the media of one scene."""

    def __init__(self, lowering: Context) -> None:
        self._lowering = lowering
        self._closed: dict[tuple[Any, ...], str] = {}
        self._textures: dict[int, int] = {}  # by the identity of a medium
        self._tapes: dict[int, Tape] = {}  # of densities by formulas, likewise
        self._unbounded: set[int] = set()  # media that have been told of
        self._data: dict[int, MediumData | None] = {}

    # --- shapes ---

    def inside(self, shape: Element, medium: Element, material: Element | None, pieces: list[Piece], frame: np.ndarray) -> Inside | None:
        """The medium of a shape whose pieces are placed by `frame` (4, 4); None, after a diagnostic, if it cannot be filled."""
        own = shape.args.get("medium") is not None
        if material is not None and material.kind == "emissive":
            self._warn_of_unseen(shape)
            return None
        reason = self._why_open(shape, pieces)
        if reason:
            tell = self._lowering.error if own else self._lowering.warn
            tell(shape, f"{reason}: a medium fills a closed shape" + ("" if own else ", so this one gets none of its block"), _hint(shape))
            return None
        alike = all(np.array_equal(piece.matrix, pieces[0].matrix) for piece in pieces)
        bounds = [self._lowering.builder.shape(piece.geometry)[2] for piece in pieces]
        box = np.stack([np.min([b[0] for b in bounds], axis=0), np.max([b[1] for b in bounds], axis=0)])
        if isinstance(medium.args["density"], Formula | Element) and not np.isfinite(box).all():
            self._lowering.error(
                shape, "this shape has no end, and its medium a density by a formula", "give the medium to a box or another bounded shape"
            )
            return None
        return Inside(medium, own, box if alike else np.full((2, 3), np.nan), frame)

    def boundary(self, shape: Element, inside: Inside, material: int, piece: Piece) -> int:
        """The row of a material with the medium inside. A material of -1: light passes the boundary straight."""
        builder = self._lowering.builder
        bounds = inside.bounds if np.isfinite(inside.bounds).all() else builder.shape(piece.geometry)[2]
        priority = inside.element.args["priority"]
        material = builder.material(_clear(priority or 0.0), shape.place) if material < 0 else material
        material = material if piece.mixed is None else piece.mixed(material)
        if builder.material_data(material).medium >= 0:
            message = f"the material of this {shape.kind} has a medium inside of it, and its `medium` is another one"
            self._lowering.error(shape, message, "leave out one of them")
        elif not self._passes(material):
            self._warn_of_unseen(shape, self._is_partial(material))
        row = self._row(inside, self._priority(material) if priority is None else priority, bounds, piece)
        return material if row < 0 else self._filled(material, row, shape)

    def _filled(self, material: int, medium: int, shape: Element) -> int:
        """The row of a material with a medium inside; the parts of a blend have it, too."""
        builder = self._lowering.builder
        data = builder.material_data(material)
        if data.model == Model.BLEND:
            data = replace(data, first=self._filled(data.first, medium, shape), second=self._filled(data.second, medium, shape))
        return builder.material(replace(data, medium=medium), shape.place)

    def warn_of_open_body(self, shape: Element, row: int, pieces: list[Piece]) -> None:
        """Warn of a material with a medium inside of it on a shape without an inside."""
        builder = self._lowering.builder
        if row < 0 or not builder.count("media") or builder.material_data(row).medium < 0:
            return
        reason = self._why_open(shape, pieces)
        if reason:
            message = f"{reason}: light that enters its material does not find the other side"
            self._lowering.warn(shape, message, _hint(shape))

    def _warn_of_unseen(self, shape: Element, partial: bool = False) -> None:
        message = f"the medium of this {shape.kind} is never seen: no light passes its material"
        if partial:
            message = f"the medium of this {shape.kind} is never seen: light that passes by an opacity does not enter it"
        self._lowering.warn(shape, message, "write glass(), or leave out its material")

    def _row(self, inside: Inside, priority: float, bounds: np.ndarray, piece: Piece) -> int:
        """The row of a medium; -1 after a diagnostic."""
        builder, element = self._lowering.builder, inside.element
        self._lowering.photometric |= element.photometric
        if id(element) not in self._data:
            self._data[id(element)] = self._coefficients(element)
        data = self._data[id(element)]
        if data is None:
            return -1
        data = replace(data, priority=priority)
        if isinstance(element.args["density"], Formula | Element):
            texture, frame = self._density(element), builder.transform(inside.matrix @ piece.matrix)
            if texture < 0 or frame < 0 or self._is_unbounded(element, bounds):
                return -1
            low, high = (tuple(corner) for corner in bounds.tolist())
            data = replace(data, density=texture, transform=frame, bounds=(low, high))  # type: ignore[arg-type]
        return builder.medium(data, element.place)

    def _density(self, element: Element) -> int:
        """The row of the texture of a density; -1 after a diagnostic."""
        if id(element) not in self._textures:
            formula, builder = element.args["density"], self._lowering.builder
            if isinstance(formula, Element):
                self._textures[id(element)] = self._voxels(formula)
                return self._textures[id(element)]
            tape = self._lowering.materials.pattern_tape(element, formula, color=False, unit=formula.unit, what="density")
            if tape is not None:
                self._tapes[id(element)] = tape
            texture = None if tape is None else TextureData(ir.TextureKind.FORMULA, tape=builder.tape(tape), channel=-1)
            self._textures[id(element)] = -1 if texture is None else builder.texture(texture, element.place)
        return self._textures[id(element)]

    def _is_unbounded(self, element: Element, bounds: np.ndarray) -> bool:
        """Whether no bound is known of the density of a medium in a box; reports it. Light could not be followed through it."""
        if id(element) in self._unbounded:
            return True
        if id(element) not in self._tapes or not upper_bounds.exceeds(self._tapes[id(element)], bounds, upper_bounds.DENSEST):
            return False
        self._unbounded.add(id(element))
        message = f"the density of this medium may exceed {upper_bounds.DENSEST:g} in the box around its shape, as by a division by 0"
        self._lowering.error(element, message, "keep divisors away from 0, as in 1 / max(x, 0.01)")
        return True

    def _voxels(self, element: Element) -> int:
        """The row of a texture of voxels; -1 after a diagnostic."""
        lowering, args = self._lowering, element.args
        try:
            voxels.refuse(args["file"])
            path = lowering.files.find(args["file"], lowering.folder(element), "file of voxels")
            image, slices = voxels.row(lowering.builder, path, args["slices"], element.place)
        except (FileError, ImageError) as failure:
            lowering.error(element, failure.message, failure.hint)
            return -1
        return lowering.builder.texture(TextureData(ir.TextureKind.VOXELS, image, channel=0, slices=slices), element.place)

    # --- coefficients ---

    def _coefficients(self, element: Element) -> MediumData | None:
        """Coefficients, emission and phase; None after a diagnostic."""
        args = element.args
        r, g, b = args["depth"] or (DEPTH, DEPTH, DEPTH)
        scattering, absorption = self._by_albedo(element, (1.0 / r, 1.0 / g, 1.0 / b), args["emission"] is not None)
        factor = args["density"] if isinstance(args["density"], float) else 1.0
        if scattering is None:
            return None
        emission = scale_color(args["emission"] or BLACK, factor)
        cosine, draine = phase_functions.of(args["phase"], args["alpha"], args["droplet"])
        return MediumData(scale_color(scattering, factor), scale_color(absorption, factor), emission, cosine, draine)

    def _by_albedo(self, element: Element, extinction: Color, may_be_none: bool) -> tuple[Color | None, Color]:
        """(scattering, absorption) by coefficients or by a colour; scattering is None after a diagnostic."""
        args = element.args
        given = {"scattering", "absorption"} & element.given or (may_be_none and not {"color", "depth"} & element.given)
        if given:
            return args["scattering"] or BLACK, args["absorption"] or BLACK
        color = WHITE if args["color"] is None else args["color"]
        if max(color) > 1.0 or min(color) < 0.0:
            message = f"a {element.kind} sends on no more light than it gets: a channel of its colour is {max(color, key=abs):g}"
            self._lowering.error(element, message, "channels of a colour are 0 to 1")
            return None, BLACK
        r, g, b = color
        return multiply_colors(color, extinction), multiply_colors((1.0 - r, 1.0 - g, 1.0 - b), extinction)

    # --- fog ---

    def fog(self, element: Element) -> None:
        """The fog of the scene."""
        if self._lowering.beyond(element):
            return
        args = element.args
        visibility = args["visibility"] or VISIBILITY
        extinction = KOSCHMIEDER / visibility
        scattering, absorption = self._by_albedo(element, (extinction, extinction, extinction), False)
        if scattering is None:
            return
        thickest = max(a + b for a, b in zip(scattering, absorption, strict=True))
        if thickest <= 0.0:
            self._lowering.warn(element, "this fog neither scatters nor absorbs light: it is left out", "give it a `visibility`, as 100m")
            return
        top, falloff = args["top"] or 0.0, args["falloff"]
        if falloff is None:
            falloff = 0.0 if args["top"] is not None else KOSCHMIEDER / thickest / HEIGHTS
        cosine, draine = phase_functions.of(args["phase"], args["alpha"], args["droplet"])
        data = MediumData(scattering, absorption, BLACK, cosine, draine, everywhere=True, top=top, falloff=falloff)
        self._lowering.builder.medium(data, element.place)

    # --- shapes and materials as they are ---

    def _passes(self, material: int) -> bool:
        """Whether light enters the medium behind a material."""
        data = self._lowering.builder.material_data(material)
        if data.model == Model.BLEND:
            return self._passes(data.first) or self._passes(data.second)
        lobe = MATERIALS[data.model].LOBE
        through = data.model == Model.GLASS or (lobe is not None and lobe.THROUGH)
        return through or max(data.inputs[Slot.TRANSMISSION].value) > 0.0

    def _is_partial(self, material: int) -> bool:
        """Whether light passes a material beside its surface, by its opacity."""
        opacity = self._lowering.builder.material_data(material).inputs[Slot.OPACITY]
        return opacity.value[0] < 1.0 or opacity.texture >= 0

    def _priority(self, material: int) -> float:
        data = self._lowering.builder.material_data(material)
        return data.inputs[Slot.PRIORITY].value[0] if data.model == Model.GLASS else 0.0

    def _why_open(self, shape: Element, pieces: list[Piece]) -> str:
        """Why pieces enclose no volume; empty if they do."""
        key = (*(piece.geometry for piece in pieces), *(piece.matrix.tobytes() for piece in pieces))
        if key not in self._closed:
            self._closed[key] = self._reason(shape, pieces)
        return self._closed[key]

    def _reason(self, shape: Element, pieces: list[Piece]) -> str:
        meshes: list[tuple[np.ndarray, np.ndarray]] = []
        for piece in pieces:
            kind, parameters, _, _ = self._lowering.builder.shape(piece.geometry)
            if kind == Kind.MESH:
                points, triangles = self._lowering.builder.triangles(piece.geometry)
                turned = np.linalg.det(piece.matrix[:3, :3]) < 0
                meshes.append((points @ piece.matrix[:3, :3].T + piece.matrix[:3, 3], triangles[:, ::-1] if turned else triangles))
            elif kind == Kind.FORMULA:
                if parameters[0]:
                    return f"this {shape.kind} is a surface without an inside"
            elif not SHAPES[kind].is_closed(parameters):
                return f"this {shape.kind} {SHAPES[kind].OPEN[0]}"
        return _open_mesh(shape.kind, meshes) if meshes and not built_geometry.is_left_out() else ""


def _open_mesh(kind: str, meshes: list[tuple[np.ndarray, np.ndarray]]) -> str:
    """Why meshes (points, triangles) do not enclose a volume together; empty if they do."""
    starts = np.cumsum([0, *(len(points) for points, _ in meshes)])
    points, triangles = merged(
        np.concatenate([points for points, _ in meshes]),
        np.concatenate([triangles.astype(np.int64) + start for (_, triangles), start in zip(meshes, starts, strict=False)]),
    )
    sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    low, high = sides.min(axis=1), sides.max(axis=1)
    edges, index = np.unique(low * len(points) + high, return_inverse=True)
    there = np.bincount(index.reshape(-1), np.where(sides[:, 0] == low, 1.0, -1.0), len(edges))
    left = int(np.count_nonzero(there))
    if left:
        return f"this {kind} is open at {left:,} edge{'s' * (left != 1)}"
    corners = points[triangles] - points.mean(axis=0)
    volume = float(np.einsum("ni,ni->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])))
    return "" if volume > 0.0 else f"the faces of this {kind} point inwards, or enclose nothing"


def _hint(shape: Element) -> str:
    """How to close a shape."""
    known = _TO_CLOSE.get(shape.kind)
    return known if known is not None else _OPEN.get(shape.kind, "use a box, a sphere or another closed shape")


_OPEN = {each.entry.name: shape.OPEN[1] for shape in SHAPES.values() for each in shape.ELEMENTS if shape.OPEN[1]}


def _clear(priority: float) -> MaterialData:
    """The boundary of a medium alone: glass of index 1."""
    inputs = {
        Slot.TRANSMISSION: Input(WHITE), Slot.IOR: Input.number(1.0), Slot.ROUGHNESS: Input.number(0.0),
        Slot.PRIORITY: Input.number(priority), Slot.ABSORPTION: Input(BLACK),
    }  # fmt: skip
    return MaterialData(Model.GLASS, inputs, name="medium")
