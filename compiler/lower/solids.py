"""Lowers CSG and deformed solids: the fields of their children become one tape, or their meshes one mesh."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...lang.elements import Element
from ...shapes import SHAPES
from .. import ir
from ..fillets import arcs
from ..formula import solid_fields
from ..formula.builder import Builder
from ..formula.opcodes import Op
from ..formula.solid_fields import NoSolid, Point
from ..formula.tape import Tape, X, Y, Z
from ..io import stage_cache
from ..mesh import built_geometry, mesh_csg
from ..mesh.mesh_csg import Solid
from ..scene import transforms
from ..scene.row_records import Piece
from . import formulas, solid_materials, sweeps
from .bodies import Body, Refused, no_field, placed
from .context import Context
from .solid_materials import Field, Looks

MOST_COPIES = 4096
_OF_MESHES = frozenset({"repeat", "mirrored"})
_TAKEN = "meshes can be in union, intersection and difference, repeat and mirrored"
_NO_SOLIDS = "solids are made of shapes with an inside: sphere, box, cylinder, implicit with an inequality, closed mesh, …"


def solid(lowering: Context, element: Element) -> list[Piece]:
    """The surface of a solid with its children."""
    try:
        body = _body(lowering, element, transforms.identity())
    except Refused:
        return []
    if not (body.bounds[1] > body.bounds[0]).all():
        lowering.warn(element, f"nothing is left of this {element.kind}: it is not drawn")
        return []
    if not np.isfinite(body.bounds).all():
        hint = "cut it by an intersection with a box or sphere"
        return lowering.refuse(element, f"this {element.kind} is endless", hint)
    def mixed(default: int) -> int:
        return solid_materials.row(lowering, element, body.looks, default)

    if body.mesh is not None:
        mesh = built_geometry.box(*body.bounds) if built_geometry.is_left_out() else mesh_csg.mesh(body.mesh)
        return [Piece(lowering.builder.mesh(mesh, element.place), transforms.identity(), mixed=mixed)]
    builder = Builder()
    with built_geometry.part("put into one formula"):
        tape = builder.finish(body.field(builder, (X, Y, Z)))
    if not len(tape.code):
        lowering.warn(element, f"nothing is left of this {element.kind}: it is not drawn")
        return []
    margin = formulas.MARGIN * (body.bounds[1] - body.bounds[0])
    bounds = formulas.shrunk(tape, np.stack([body.bounds[0] - margin, body.bounds[1] + margin]))
    if bounds is None:
        lowering.warn(element, f"nothing is left of this {element.kind}: it is not drawn")
        return []
    return [replace(piece, mixed=mixed) for piece in formulas.implicit_piece(lowering, element, tape, bounds, (0.0,) * 5)]


def _body(lowering: Context, element: Element, matrix: np.ndarray) -> Body:
    """A solid element in the frame of `matrix`."""
    with lowering.scaled(matrix):
        bodies = [body for child in element.children for body in _bodies(lowering, child, transforms.identity(), None)]
        return placed(_COMBINED[element.kind](lowering, element, bodies), matrix)


def _bodies(lowering: Context, element: Element, matrix: np.ndarray, material: Element | None) -> list[Body]:
    """The bodies of an element in a solid, each shape of a block by itself, with its own material or that of the block."""
    material = element.args.get("material") or material
    if element.args.get("medium") is not None:
        lowering.error(element, "a part of a solid has no medium of its own", "write medium: for the whole solid")
        raise Refused
    block = lowering.block(element)
    if block is not None:
        return [body for child in element.children for body in _bodies(lowering, child, matrix @ block, material)]
    return [body._replace(looks=body.looks.within(material)) for body in _own_bodies(lowering, element, matrix)]


def _own_bodies(lowering: Context, element: Element, matrix: np.ndarray) -> list[Body]:
    """The bodies of a shape or solid."""
    frame = matrix @ transforms.place(*(element.args.get(name) for name in ("translate", "rotate", "scale")))
    if element.kind in KINDS:
        return [_body(lowering, element, frame)]
    if not lowering.is_shape(element):
        lowering.error(element, f"`{element.kind}` cannot be a part of a solid", _NO_SOLIDS)
        raise Refused
    if element.args.get("materials") is not None:
        lowering.error(element, "a mesh in a solid has one material: `materials` does not go there", "write material:")
        raise Refused
    swept = sweeps.field(element)
    if swept is not None:
        return [placed(Body(*swept, meshed=lambda _: _swept(lowering, element, frame)), frame)]
    with lowering.scaled(frame):
        pieces = lowering.pieces(element)
    if not pieces:
        raise Refused
    if all(lowering.builder.shape(piece.geometry)[0] == ir.GeometryKind.MESH for piece in pieces):
        return [placed(_mesh(lowering, element, pieces), frame)]
    return [_shape(lowering, element, piece, frame @ piece.matrix) for piece in pieces]


def _swept(lowering: Context, element: Element, frame: np.ndarray) -> Solid:
    """The mesh of a swept shape, in its own frame, for a tolerance in that around `frame`."""
    with lowering.scaled(frame):
        solid = _mesh(lowering, element, lowering.pieces(element)).mesh
    assert solid is not None
    return solid


def _mesh(lowering: Context, element: Element, pieces: list[Piece]) -> Body:
    """A closed mesh as a body."""
    if built_geometry.is_left_out():
        boxes = [lowering.builder.bounds(piece.geometry, piece.matrix) for piece in pieces]
        bounds = np.stack([np.min([box[0] for box in boxes], axis=0), np.max([box[1] for box in boxes], axis=0)])
        return Body(no_field, bounds, mesh_csg.of_box(bounds))
    try:
        solid, inside_out = mesh_csg.solid_of_pieces(lowering.builder, pieces)
    except NoSolid as reason:
        hint = "close it (most modelling programs have a repair for printing), or draw it beside the solid"
        lowering.error(element, f"`{element.kind}` cannot be a part of a solid: {reason}", hint)
        raise Refused from None
    if inside_out:
        lowering.warn(element, "all triangles of this mesh face inwards: it is taken the other way round")
    return Body(no_field, mesh_csg.bounds(solid), solid)


def _shape(lowering: Context, element: Element, piece: Piece, matrix: np.ndarray) -> Body:
    """A shape as a body."""
    kind, parameters, bounds, tape = lowering.builder.shape(piece.geometry)
    if transforms.inverse(matrix) is None:
        lowering.error(element, "this is flattened to nothing by its transform", "a scale must not be 0 along any axis")
        raise Refused
    if kind == ir.GeometryKind.FORMULA:
        if parameters[0]:
            hint = "write an inequality that holds in a region: neither == nor a square <= 0"
            lowering.error(element, "this is a sheet, which has no inside", hint)
            raise Refused
        solid = tape

        def field(b: Builder, point: Point) -> int:
            assert solid is not None
            return b.inline(solid, point)[0]

        return placed(Body(field, bounds), matrix)
    shape = SHAPES[kind]
    try:
        shape.field(Builder(), parameters, (0, 1, 2))
    except NoSolid as reason:
        lowering.error(element, f"`{element.kind}` cannot be a part of a solid: {reason}", _NO_SOLIDS)
        raise Refused from None
    if kind == ir.GeometryKind.PLANE:
        bounds = np.array([[-math.inf] * 3, [math.inf, 0.0, math.inf]])
    body = Body(lambda b, point: shape.field(b, parameters, point), bounds)
    closed = shape.closed_mesh
    if closed is None or closed(parameters, math.inf) is None:
        return placed(body, matrix)

    def meshed(tolerance: float) -> Solid:
        mesh = closed(parameters, tolerance)
        assert mesh is not None
        positions, faces, off = mesh
        return Solid(mesh_csg.of_triangles(positions, faces), off)

    return placed(body._replace(meshed=meshed), matrix)


# --- operators ------------------------------------------------------------------------------------------------------


def _wrong_behind(lowering: Context, element: Element) -> bool:
    """Whether an error follows this element's name: it may have removed children."""
    span, items = element.place, lowering.builder.diagnostics.items
    return span is not None and any(d.severity == "error" and d.span is not None and d.span > span for d in items)


def _combined(bounds_of: Callable[[list[np.ndarray], float], np.ndarray]) -> Callable[[Context, Element, list[Body]], Body]:
    def make(lowering: Context, element: Element, bodies: list[Body]) -> Body:
        if not bodies:
            if not _wrong_behind(lowering, element):
                lowering.error(element, f"this {element.kind} is empty", f"put shapes in it: {element.kind} {{ sphere(1); box(1.5) }}")
            raise Refused
        radius = element.args["round"]
        if any(body.mesh is not None for body in bodies):
            return _of_meshes(lowering, element, bodies)
        bounds = bounds_of([body.bounds for body in bodies], radius if len(bodies) > 1 else 0.0)
        if element.args.get("seams") == "blended" and not radius:
            lowering.warn(element, "without `round` there is no fillet to mix materials over", "give a radius, or leave out `seams`")
        rounded = radius > 0 and len(bodies) > 1 and not built_geometry.is_left_out()
        field = _rounded(element.kind, bodies, radius) if rounded else _sharp(element.kind, bodies)
        meshed = None if rounded else _sharp_mesh(lowering, element, bodies)
        return Body(field, bounds, meshed=meshed, looks=_looks(element, bodies))

    return make


def _sharp_mesh(lowering: Context, element: Element, bodies: list[Body]) -> Callable[[float], Solid] | None:
    """The mesh of bodies with sharp edges, by CSG of their meshes; None where none of them has one of its own."""
    if all(body.meshed is None for body in bodies):
        return None
    return lambda tolerance: mesh_csg.combine(element.kind, [_triangles(lowering, element, body, bodies, tolerance) for body in bodies])


def _looks(element: Element, bodies: list[Body]) -> Looks:
    """The materials of combined bodies: of a union where their fields are least, of an intersection where they are largest."""
    size = max((float(np.ptp(body.bounds, axis=0).max()) for body in bodies if np.isfinite(body.bounds).all()), default=1.0)
    signs = [element.kind == "union" or (element.kind == "difference" and k > 0) for k in range(len(bodies))]
    parts = [(body.looks, body.field if sign else _negated(body.field)) for body, sign in zip(bodies, signs, strict=True)]
    return solid_materials.nearest(parts, size, element.args["round"] if element.args.get("seams") == "blended" else 0.0)


def _negated(field: Field) -> Field:
    return lambda b, point: b.op(Op.NEGATE, field(b, point))


def _sharp(kind: str, bodies: list[Body]) -> Field:
    """The field of bodies with sharp edges."""

    def field(b: Builder, point: Point) -> int:
        first, *rest = (body.field(b, point) for body in bodies)
        if kind == "difference":
            rest = [b.op(Op.NEGATE, name) for name in rest]
        return b.reduce(Op.MIN if kind == "union" else Op.MAX, [first, *rest])

    return field


def _rounded(kind: str, bodies: list[Body], radius: float) -> Field:
    """The field of bodies with fillets, found once in their own frame."""
    tapes: list[Tape] = []
    for k, body in enumerate(bodies):
        builder = Builder()
        name = body.field(builder, (X, Y, Z))
        tapes.append(builder.finish(builder.op(Op.NEGATE, name) if kind == "difference" and k else name))
    bounds = tuple(body.bounds for body in bodies)
    with built_geometry.part("rounded"):
        inputs, complement = (tuple(tapes), bounds, radius, kind), kind != "union"
        tape = stage_cache.cached("edges rounded", inputs, lambda: arcs.fillet_union(tapes, bounds, radius, complement))
    return lambda b, point: b.inline(tape, point)[0]


def _of_meshes(lowering: Context, element: Element, bodies: list[Body]) -> Body:
    """CSG of parts of which some are meshes."""
    if element.args["round"]:
        lowering.error(element, "a solid with a mesh in it has no round edges", "leave out `round`, or make a formula of the mesh's shape")
        raise Refused
    materials = {id(material): material for body in bodies for material in body.looks.materials}
    if len(materials) > 1:
        message = "the parts of a solid with a mesh in it are of one material"
        lowering.error(element, message, f"give it to the {element.kind}, or draw the parts beside each other")
        raise Refused
    sizes = [float(np.ptp(body.bounds, axis=0).max()) for body in bodies if np.isfinite(body.bounds).all()]
    default = max((size for size in sizes if math.isfinite(size)), default=1.0) / mesh_csg.FINENESS
    tolerance = lowering.tolerance or default
    least = bodies[:1] if built_geometry.is_left_out() and element.kind == "difference" else bodies  # boxes might leave nothing
    solid = mesh_csg.combine(element.kind, [_triangles(lowering, element, body, bodies, tolerance) for body in least])
    return Body(no_field, mesh_csg.bounds(solid), solid, looks=bodies[0].looks)


def _triangles(lowering: Context, element: Element, body: Body, beside: list[Body], tolerance: float) -> Solid:
    """The mesh of a part within a tolerance; of an unbounded one, the portion near the bounded parts if that suffices."""
    if body.mesh is not None:
        return body.mesh
    if body.meshed is not None and not built_geometry.is_left_out():
        return body.meshed(tolerance)
    bounds, builder = body.bounds, Builder()
    field = body.field(builder, (X, Y, Z))
    if not np.isfinite(bounds).all():
        ends = np.array([other.bounds for other in beside if np.isfinite(other.bounds).all()])
        if element.kind == "union" or (element.kind == "difference" and body is beside[0]):
            lowering.error(element, f"this {element.kind} is endless", "cut it by an intersection with a box or sphere")
            raise Refused
        low, high = ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)
        bounds = np.stack([low - 0.05 * (high - low), high + 0.05 * (high - low)])
        half, middle = 0.5 * (bounds[1] - bounds[0]), bounds.mean(axis=0)
        field = builder.op(Op.MAX, field, SHAPES[ir.GeometryKind.BOX].field(builder, half.tolist(), _shifted(builder, middle)))
    margin = formulas.MARGIN * (bounds[1] - bounds[0])
    if built_geometry.is_left_out():
        return mesh_csg.of_box(bounds)
    try:
        deviation = None if lowering.tolerance is None else tolerance
        return mesh_csg.of_field(builder.finish(field), np.stack([bounds[0] - margin, bounds[1] + margin]), deviation)
    except NoSolid as reason:
        lowering.error(element, f"a part of this {element.kind} is not a solid: {reason}")
        raise Refused from None


def _shifted(b: Builder, middle: np.ndarray) -> Point:
    x, y, z = (b.offset(name, -float(c)) for name, c in zip((X, Y, Z), middle, strict=True))
    return x, y, z


def _all(bounds: list[np.ndarray], radius: float) -> np.ndarray:
    """The union of bounds; a fillet may exceed it by the radius."""
    union = np.stack([np.min([b[0] for b in bounds], axis=0), np.max([b[1] for b in bounds], axis=0)])
    return np.stack([union[0] - radius, union[1] + radius])


def _common(bounds: list[np.ndarray], radius: float) -> np.ndarray:
    return np.stack([np.max([b[0] for b in bounds], axis=0), np.min([b[1] for b in bounds], axis=0)])


def _on_union(change: Callable[[Context, Element, Body], Body]) -> Callable[[Context, Element, list[Body]], Body]:
    """An operator of one solid: several children are united first."""
    together = _combined(_all)

    def make(lowering: Context, element: Element, bodies: list[Body]) -> Body:
        if any(body.mesh is not None for body in bodies) and element.kind not in _OF_MESHES:
            lowering.error(element, f"`{element.kind}` of a mesh is not built yet: it needs a field", _TAKEN)
            raise Refused
        if len(bodies) != 1:
            plain = Element("union", {"round": 0.0}, element.span, trace=element.trace)
            return change(lowering, element, together(lowering, plain if bodies else element, bodies))
        return change(lowering, element, bodies[0])

    return make


def _shell(lowering: Context, element: Element, body: Body) -> Body:
    return body.changed(lambda b, point: solid_fields.shell(b, body.field(b, point), element.args["thickness"]), body.bounds)


def _offset(lowering: Context, element: Element, body: Body) -> Body:
    by = element.args["by"]
    return body.changed(lambda b, point: b.offset(body.field(b, point), -by), np.stack([body.bounds[0] - by, body.bounds[1] + by]))


def _twist(lowering: Context, element: Element, body: Body) -> Body:
    rate = element.args["angle"] / element.args["over"]
    reach = float(np.hypot(np.abs(body.bounds[:, 0]).max(), np.abs(body.bounds[:, 2]).max()))
    bounds = np.array([[-reach, body.bounds[0, 1], -reach], [reach, body.bounds[1, 1], reach]])
    return _deformed(body, bounds, lambda b, point: solid_fields.untwist(b, point, rate))


def _deformed(body: Body, bounds: np.ndarray, change: Callable[[Builder, Point], Point]) -> Body:
    return body.changed(lambda b, point: body.field(b, change(b, point)), bounds, change)


def _bend(lowering: Context, element: Element, body: Body) -> Body:
    rate = element.args["angle"] / element.args["over"]
    if not rate:
        return body
    if abs(rate) * float(np.abs(body.bounds[:, 0]).max()) > math.pi:
        lowering.error(element, "bent this far its ends go through each other", "a smaller angle, or over a greater length")
        raise Refused
    radius = 1 / rate
    reach = float(np.abs(radius - body.bounds[:, 1]).max())
    low, high = (min(radius - reach, radius + reach), max(radius - reach, radius + reach))
    bounds = np.array([[-reach, low, body.bounds[0, 2]], [reach, high, body.bounds[1, 2]]])
    return _deformed(body, bounds, lambda b, point: solid_fields.unbend(b, point, rate))


def _repeat(lowering: Context, element: Element, body: Body) -> Body:
    step, count = np.array(element.args["step"]), element.args["count"]
    if body.mesh is not None:
        moved = [body.mesh.moved(transforms.translation(tuple(k * step))) for k in range(count)]
        solid = mesh_csg.combine("union", moved)
        return Body(no_field, mesh_csg.bounds(solid), solid, looks=body.looks)
    if count > MOST_COPIES:
        lowering.error(
            element, f"{count} copies are too many for one solid: {MOST_COPIES} at the most", "use for (…) { … } without a solid round it"
        )
        raise Refused

    copies = [placed(body, transforms.translation(tuple(k * step))) for k in range(count)]

    def field(b: Builder, point: Point) -> int:
        fields = [copy.field(b, point) for copy in copies]
        while len(fields) > 1:
            fields = [b.op(Op.MIN, *fields[k : k + 2]) if k + 1 < len(fields) else fields[k] for k in range(0, len(fields), 2)]
        return fields[0]

    ends = [body.bounds, body.bounds + (count - 1) * step]
    return Body(field, _all(ends, 0.0), looks=_united(copies))


def _mirror(lowering: Context, element: Element, body: Body) -> Body:
    normal = transforms.unit(np.array(element.args["normal"]))
    assert normal is not None  # the schema requires a direction
    turned = np.eye(4)
    turned[:3, :3] -= 2 * np.outer(normal, normal)
    if body.mesh is not None:
        solid = mesh_csg.combine("union", [body.mesh, body.mesh.moved(turned)])
        return Body(no_field, mesh_csg.bounds(solid), solid, looks=body.looks)
    other = placed(body, turned)

    def field(b: Builder, point: Point) -> int:
        return b.op(Op.MIN, body.field(b, point), other.field(b, point))

    return Body(field, _all([body.bounds, other.bounds], 0.0), looks=_united([body, other]))


def _united(copies: list[Body]) -> Looks:
    """The materials of copies of a body: each copy's where its field is least."""
    if len(copies[0].looks.materials) == 1:
        return copies[0].looks
    return solid_materials.nearest([(copy.looks, copy.field) for copy in copies], float(np.ptp(copies[0].bounds, axis=0).max()))


def _morph(lowering: Context, element: Element, bodies: list[Body]) -> Body:
    if len(bodies) != 2:
        hint = "group several in a union" if len(bodies) > 2 else "write morph(0.5) { sphere(1); box(1.5) }"
        lowering.error(element, f"a morph is between two solids, got {len(bodies)}", hint)
        raise Refused
    if any(body.mesh is not None for body in bodies):
        lowering.error(element, "`morph` of a mesh is not built yet: it needs a field", _TAKEN)
        raise Refused
    share = element.args["share"]

    def field(b: Builder, point: Point) -> int:
        return b.linear([(1 - share, bodies[0].field(b, point)), (share, bodies[1].field(b, point))])

    looks = solid_materials.interpolated([body.looks for body in bodies], (1 - share, share))
    return Body(field, _all([body.bounds for body in bodies], 0.0), looks=looks)


_COMBINED: dict[str, Callable[[Context, Element, list[Body]], Body]] = {
    "union": _combined(_all),
    "intersection": _combined(_common),
    "difference": _combined(lambda bounds, radius: bounds[0]),
    "shell": _on_union(_shell),
    "offset": _on_union(_offset),
    "twist": _on_union(_twist),
    "bend": _on_union(_bend),
    "repeat": _on_union(_repeat),
    "mirrored": _on_union(_mirror),
    "morph": _morph,
}
KINDS = frozenset(_COMBINED)
