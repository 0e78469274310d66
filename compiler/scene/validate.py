"""Validates a scene between front ends and backends: no backend raises on a validated scene.

Unrepairable faults are errors; repairable ones are repaired, counted and reported once. Checks cover the structure of the tables, then
references, then numbers; meshes come last (validate_meshes.py).
"""

from __future__ import annotations

from dataclasses import replace
from enum import IntEnum

import numpy as np

from ...lang.diagnostics import Diagnostics
from ...lang.schema.setting_values import MAX_SIDE
from ...lights import DIRECTED, PICTURED, PLACED, PROFILED, RECTANGLES, SURFACES
from ...shapes import SHAPES
from ...shapes.contract import Measure
from .. import ir
from ..ir.light_links import ALL_SETS, EVERYTHING
from . import transforms, validate_meshes, validate_tapes
from .check import Check

MOST_MEDIA = 127  # of a scene: render/material/medium_stack.py counts them in seven bits
Kind = ir.GeometryKind
ALL_VISIBLE = 7 | ALL_SETS
_REFERENCES = (  # table, column, table it points into, whether -1 is allowed
    ("geometries", "normals", "attributes", True),
    ("geometries", "uvs", "attributes", True),
    ("geometries", "colors", "attributes", True),
    ("geometries", "tape", "tapes", True),
    ("instances", "geometry", "geometries", False),
    ("instances", "transform", "transforms", False),
    ("instances", "material", "materials", False),
    ("instances", "light", "lights", True),
    ("materials", "textures", "textures", True),
    ("materials", "medium", "media", True),
    ("media", "density", "textures", True),
    ("media", "transform", "transforms", False),
    ("textures", "image", "images", True),
    ("textures", "tape", "tapes", True),
    ("lights", "transform", "transforms", False),
    ("lights", "image", "images", True),
    ("lights", "instance", "instances", True),
    ("cameras", "transform", "transforms", False),
)
_CHOICES: tuple[tuple[str, str, type[IntEnum]], ...] = (
    ("attributes", "interpolation", ir.Interpolation),
    ("geometries", "kind", ir.GeometryKind),
    ("materials", "model", ir.MaterialModel),
    ("materials", "shading", ir.Shading),
    ("textures", "kind", ir.TextureKind),
    ("textures", "mapping", ir.TextureMapping),
    ("textures", "wrap_u", ir.Wrap),
    ("textures", "wrap_v", ir.Wrap),
    ("lights", "kind", ir.LightKind),
    ("lights", "falloff", ir.FalloffKind),
    ("cameras", "projection", ir.Projection),
    ("cameras", "fit", ir.Fit),
)
_FINITE = (
    ("transforms", "matrix"), ("materials", "values"), ("media", "scattering"), ("media", "absorption"),
    ("media", "emission"), ("media", "anisotropy"), ("media", "draine"), ("media", "priority"), ("media", "falloff"), ("textures", "frame"),
    ("textures", "size"), ("textures", "color_a"), ("textures", "color_b"), ("textures", "gain"), ("textures", "bias"),
    ("lights", "color"), ("lights", "position"), ("lights", "direction"), ("lights", "size"), ("lights", "cos_cone"),
    ("lights", "cos_full"), ("lights", "angle"), ("lights", "coefficients"),
    ("cameras", "extent"), ("cameras", "aspect"), ("cameras", "near"), ("cameras", "shift"),
    ("cameras", "opening"), ("cameras", "shutter"), ("cameras", "lens"),
    ("cameras", "focus"), ("cameras", "pixel_aspect"), ("cameras", "planes"), ("keys", "move"), ("keys", "turn"), ("keys", "stretch"),
)  # fmt: skip
_OWN_LENGTH = {"pools": (), "images": ("texels",)}  # columns with their own length; () means all


def validate(scene: ir.Scene, diagnostics: Diagnostics | None = None) -> tuple[ir.Scene, Diagnostics]:
    """The scene with repairs, and the diagnostics. A scene with errors must not be drawn. Never raises."""
    messages = diagnostics if diagnostics is not None else Diagnostics()
    with np.errstate(all="ignore"):  # the tables may hold any numbers
        return _validate(Check(scene, messages)), messages


def _validate(check: Check) -> ir.Scene:
    for step in (_structure, _references, _numbers):
        step(check)
        if check.errors:
            return check.scene
    _value_ranges(check)
    validate_meshes.validate(check)
    validate_tapes.validate(check)
    if not check.errors:
        _without_empty_instances(check)
    return check.finished()


def _structure(check: Check) -> None:
    """Columns have their type and shape and, within one table, equal length; names and spans match the rows."""
    for table, columns in check.tables.items():
        apart = _OWN_LENGTH.get(table)
        lengths = set()
        for column, values in columns.items():
            dtype, shape = ir.column_type(table, column)
            if not isinstance(values, np.ndarray) or values.dtype != dtype or values.shape[1:] != shape or values.ndim != 1 + len(shape):
                check.fatal(f"the IR's column {table}.{column} has not the type it should have")
                return
            if not values.flags.c_contiguous:
                check.set(table, column, np.ascontiguousarray(values))
            if apart is None or (apart and column not in apart):
                lengths.add(len(values))
        if len(lengths) > 1:
            check.fatal(f"the IR's table {table} has columns of different lengths: {', '.join(map(str, sorted(lengths)))}")
            return
    for names in ir.Names.__dataclass_fields__:
        table, count = ("lights" if names == "groups" else names), len(getattr(check.scene.names, names))
        if count != check.rows(table) and not (names == "groups" and count == 0):
            check.fatal(f"the IR has {check.rows(table)} {table} and {count} names of them")
    for table, rows in check.spans.items():
        counted = "instances" if table == "calls" else table
        count = len(rows) if table == "settings" else check.rows(counted) if counted in check.tables else -1
        if np.shape(rows) != (count, 5):
            check.fatal(f"the IR's spans of {table} do not go with its rows")
    if not check.rows("transforms") or not np.array_equal(check.tables["transforms"]["matrix"][0], np.eye(3, 4)):
        check.fatal("the IR's first transform is not the identity")
    if not check.rows("cameras"):
        check.fatal("the scene has no camera")


def _references(check: Check) -> None:
    """Every index refers to a row, every kind is valid, every range lies in its pool."""
    for table, column, target, optional in _REFERENCES:
        values = check.tables[table][column]
        if not len(values):
            continue
        wrong = (values < (-1 if optional else 0)) | (values >= check.rows(target))
        check.bad(table, wrong if wrong.ndim == 1 else wrong.any(axis=1), f"its {column} is not a row of {target}")
    for table, column, kinds in _CHOICES:
        values = check.tables[table][column]
        if not len(values):
            continue
        wrong = (values < 0) | (values >= len(kinds))
        if wrong.any():
            check.bad(table, wrong, f"its {column} is none of {', '.join(k.name.lower() for k in kinds)}")
    visible = check.tables["instances"]["visible"]
    check.bad("instances", (visible < 0) | (visible & ~ALL_VISIBLE != 0), "its visibility has bits that mean nothing")
    pools, images, attributes, geometries = (check.tables[name] for name in ("pools", "images", "attributes", "geometries"))
    texels = images["width"].astype(np.int64) * images["height"]
    outside = ~_inside(images["first"], texels, len(images["texels"])) | (images["width"] < 1) | (images["height"] < 1)
    check.bad("images", outside, "its pixels are not among the texels")
    floats = attributes["count"].astype(np.int64) * attributes["width"]
    outside = ~_inside(attributes["first"], floats, len(pools["values"])) | (attributes["width"] < 1) | (attributes["count"] < 1)
    check.bad("attributes", outside, "its values are not in the pool")
    meshes = geometries["kind"] == Kind.MESH
    for what, length in () if not meshes.any() else (
        ("vertex", len(pools["positions"])), ("triangle", len(pools["triangles"])), ("polygon", check.rows("polygons")),
    ):  # fmt: skip
        outside = ~_inside(geometries[f"first_{what}"], geometries[f"{what}_count"], length)
        check.bad("geometries", outside & meshes, f"its range of {what} rows is not in the pool")


def _inside(first: np.ndarray, count: np.ndarray, length: int) -> np.ndarray:
    """Whether ranges lie in a pool; computed in int64 to avoid overflow."""
    start, size = first.astype(np.int64), count.astype(np.int64)
    return (start >= 0) & (size >= 0) & (start <= length) & (size <= length - start)


def _numbers(check: Check) -> None:
    """Numbers are finite, and stored inverses match their transforms."""
    for table, column in _FINITE:
        values = check.tables[table][column]
        if not len(values):
            continue
        check.bad(table, ~np.isfinite(values).all(axis=tuple(range(1, values.ndim))), f"its {column} is not a finite number")
    texels = check.tables["images"]["texels"]
    lost = int(np.count_nonzero(~np.isfinite(texels)))
    if lost:
        check.diagnostics.warning(f"{lost} texels' values are not finite: they are drawn as 0")
        check.set("images", "texels", np.nan_to_num(texels, nan=0.0, posinf=0.0, neginf=0.0))
    _transforms(check)


def _transforms(check: Check) -> None:
    table = check.tables["transforms"]
    matrices = table["matrix"]
    linear = matrices[:, :, :3]
    determinants = np.linalg.det(linear)
    lengths = np.hypot.reduce(linear, axis=1).prod(axis=1)  # no squares that overflow
    flat = ~(np.abs(determinants) > transforms.SINGULAR * lengths) | ~np.isfinite(determinants)
    if check.bad("transforms", flat, "it flattens to nothing (no inverse)"):
        return
    inverses = table["inverse"]
    # One of the two products is unaffected by the rounding of a stretched matrix.
    products = (inverses[:, :, :3] @ linear, linear @ inverses[:, :, :3])
    off = np.minimum(*(np.abs(product - np.eye(3)).max(axis=(1, 2), initial=0.0) for product in products))
    moved = (inverses[:, :, :3] @ matrices[:, :, 3:])[:, :, 0] + inverses[:, :, 3]
    reach = np.abs(inverses[:, :, :3]) @ np.abs(matrices[:, :, 3:])
    wrong = ~(off < 1e-6) | ~(np.abs(moved) <= 1e-9 * (1 + reach[:, :, 0])).all(axis=1)
    if check.bad("transforms", wrong, "its inverse was not its inverse: computed again", "warning"):
        inverses = inverses.copy()
        for row in np.flatnonzero(wrong):
            inverse = transforms.inverse(matrices[row])
            if inverse is None:
                check.bad("transforms", np.arange(len(matrices)) == row, "it flattens to nothing (no inverse)")
                return
            inverses[row] = inverse
        check.set("transforms", "inverse", inverses)
    if check.bad("transforms", table["flips"] != (determinants < 0), "its orientation was wrong: computed again", "warning"):
        check.set("transforms", "flips", determinants < 0)


def _keys(check: Check) -> None:
    table, keys = check.tables["transforms"], check.tables["keys"]
    first, count = table["first_key"], table["keys"]
    moving = first >= 0
    if not (moving.any() or count.any() or check.rows("keys")):
        return
    check.bad("transforms", moving & ((count < 2) | (first.astype(np.int64) + count > check.rows("keys"))), "its keys are not there")
    check.bad("transforms", ~moving & (count != 0), "it has keys and does not move")
    check.bad("keys", ~(np.abs(np.linalg.norm(keys["turn"], axis=1) - 1.0) < 1e-6), "its turn is not a unit quaternion")
    determinants = np.linalg.det(keys["stretch"])
    for row in np.flatnonzero(moving).tolist() if not check.errors else ():
        signs = np.sign(determinants[first[row] : first[row] + count[row]])
        check.bad("transforms", (np.arange(len(first)) == row) & ((signs != signs[0]).any() or signs[0] == 0), "it flattens on its way")


def _value_ranges(check: Check) -> None:
    _keys(check)
    _shapes(check)
    _materials(check)
    _lights(check)
    _cameras(check)
    _settings(check)


_FORMULA = (
    Measure("sheet", minimum=0.0), Measure("x"), Measure("y"), Measure("z"), Measure("radius of the clipping sphere", minimum=0.0),
    Measure("largest coordinate", above=0.0),
)  # fmt: skip
_MEASURES = {Kind.FORMULA: _FORMULA, **{kind: shape.MEASURES for kind, shape in SHAPES.items()}}


def _have_sense(kind: int, rows: np.ndarray) -> np.ndarray:
    """(n,) whether the parameters (n, 13) of a kind are in their limits."""
    good = np.ones(len(rows), dtype=bool)
    measures = _MEASURES.get(kind, ())
    for k, column in enumerate(rows.T):
        measure = measures[k] if k < len(measures) else Measure("")
        good &= np.isfinite(column) | (measure.may_be_infinite & (column == np.inf))
        if measure.above is not None:
            good &= column > measure.above
        if measure.minimum is not None:
            good &= column >= measure.minimum
    shape = SHAPES.get(kind)
    return good if shape is None or shape.has_sense is None else good & shape.has_sense(rows)


def _shapes(check: Check) -> None:
    table = check.tables["geometries"]
    kinds, parameters, bounds = table["kind"], table["parameters"], table["bounds"]
    good = np.ones(len(kinds), dtype=bool)
    for kind in frozenset(kinds.tolist()):
        of_kind = kinds == kind
        good[of_kind] = _have_sense(kind, parameters[of_kind])
    check.bad("geometries", ~good & (kinds != Kind.MESH), "its measures are not finite, or not above 0")
    moved = (kinds != Kind.MESH) & table["origin"].any(axis=1)
    check.bad("geometries", moved, "only meshes have an origin")
    formulas = kinds == Kind.FORMULA
    holds = np.isfinite(bounds).all(axis=(1, 2)) & (bounds[:, 1] > bounds[:, 0]).all(axis=1) & (table["tape"] >= 0)
    check.bad("geometries", formulas & ~holds, "a formula's surface has a tape, and a box that holds it")
    analytic = np.flatnonzero((kinds != Kind.MESH) & ~formulas & good)
    right = bounds.copy()
    for row in analytic:
        right[row] = SHAPES[int(kinds[row])].bounds(parameters[row].tolist())
    wrong = ~((bounds[:, 0] <= right[:, 0]) & (bounds[:, 1] >= right[:, 1])).all(axis=1)
    wrong[kinds == Kind.MESH] = False
    if check.bad("geometries", wrong, "its bounds did not hold it: computed again", "warning"):
        check.set("geometries", "bounds", right)


_WEIGHTS = [int(slot) for slot in ir.Slot if slot != ir.Slot.BUMP]


def _materials(check: Check) -> None:
    table = check.tables["materials"]
    check.bad("materials", (table["values"] < 0)[:, _WEIGHTS].any(axis=(1, 2)), "it has a negative coefficient")
    blend, row = table["model"] == ir.MaterialModel.BLEND, np.arange(len(table["model"]))
    for part in ("first", "second"):
        check.bad("materials", blend & ((table[part] < 0) | (table[part] >= row)), "its parts are not rows before it")
    check.bad("materials", ~(table["values"][:, ir.Slot.IOR, 0] > 0), "its index of refraction is not above 0")
    _media(check)
    textures = check.tables["textures"]
    if not len(textures["kind"]):
        return
    pictureless = (textures["kind"] == ir.TextureKind.IMAGE) & (textures["image"] < 0)
    check.bad("textures", pictureless, "it has no picture")
    check.bad("textures", (textures["kind"] == ir.TextureKind.FORMULA) & (textures["tape"] < 0), "it has no tape")
    check.bad("textures", (textures["channel"] < -1) | (textures["channel"] > 3), "its channel is none of -1 … 3")
    check.bad("textures", textures["size"] < 0, "its cell is of negative size")


def _media(check: Check) -> None:
    table, textures = check.tables["media"], check.tables["textures"]
    for column in ("scattering", "absorption", "emission", "falloff"):
        negative = table[column] < 0
        check.bad("media", negative if negative.ndim == 1 else negative.any(axis=1), f"its {column} is negative")
    materials, used = check.tables["materials"], np.unique(check.tables["instances"]["material"])
    held = int((materials["medium"][used] >= 0).sum())
    if held > MOST_MEDIA:
        message = f"{held} materials of this scene have a medium inside: {MOST_MEDIA} are drawn, those of the highest priority"
        check.diagnostics.warning(message, hint="shapes with one medium and one material count once; each one with a formula counts")
    check.bad("media", abs(table["anisotropy"]) > 1, "its anisotropy is not between -1 and 1")
    g, of_draine, alpha, weight = table["draine"].T
    wrong = (abs(g) > 1) | (abs(of_draine) >= 1) | (alpha < 0) | (weight < 0) | (weight > 1)
    check.bad("media", wrong, "its phase function of Draine has g beyond -1 and 1, α below 0, or a weight beyond 0 and 1")
    check.bad("media", np.isnan(table["top"]) | np.isnan(table["bounds"]).any(axis=(1, 2)), "its bounds are not numbers")
    check.bad("media", np.cumsum(table["everywhere"]) * table["everywhere"] > 1, "the scene has another one that fills it")
    kinds = np.append(textures["kind"], ir.TextureKind.FORMULA)[table["density"]]  # the last stands for row -1
    check.bad("media", ~ir.is_in(kinds, (ir.TextureKind.FORMULA, ir.TextureKind.VOXELS)), "its density is a picture, not a formula")
    endless = ~np.isfinite(table["bounds"]).all(axis=(1, 2)) | (table["bounds"][:, 1] <= table["bounds"][:, 0]).any(axis=1)
    check.bad("media", (table["density"] >= 0) & endless, "its density is in no bounded box")
    voxels = textures["kind"] == ir.TextureKind.VOXELS
    heights = np.append(check.tables["images"]["height"], 1)[textures["image"]]
    slices = np.maximum(textures["slices"], 1)
    check.bad("textures", voxels & ((textures["image"] < 0) | (textures["slices"] < 1) | (heights % slices != 0)), "it has no whole slices")


def _lights(check: Check) -> None:
    t = check.tables["lights"]
    kind = t["kind"]
    if not len(kind):
        return
    area = ir.is_in(kind, SURFACES)
    check.bad("lights", (t["color"] < 0).any(axis=1), "its strength is negative")
    directed = ir.is_in(kind, DIRECTED)
    lengths = np.linalg.norm(t["direction"], axis=1)
    check.bad("lights", directed & ~(np.abs(lengths - 1) < 1e-6), "its direction is not of length 1")
    check.bad("lights", ir.is_in(kind, PICTURED) & (t["image"] < 0), "a dome has a picture")
    profiled = (t["image"] >= 0) & ~ir.is_in(kind, PICTURED)
    check.bad("lights", profiled & ~ir.is_in(kind, PLACED), "it is far away and has a factor by direction")
    check.bad("lights", (profiled | ir.is_in(kind, PROFILED)) & (t["instance"] >= 0), "it has a factor by direction and a visible shape")
    extent = np.where(ir.is_in(kind, RECTANGLES), t["size"].min(axis=1, initial=np.inf), t["size"][:, 0])
    check.bad("lights", area & ~(extent > 0), "it has no area: it gives no light", "error", "make its size more than 0")
    beyond = (t["cos_cone"] > t["cos_full"]) | (np.abs(t["cos_cone"]) > 1) | (np.abs(t["cos_full"]) > 1)
    check.bad("lights", beyond, "its cone is none: −1 ≤ cos_cone ≤ cos_full ≤ 1 does not hold")
    check.bad("lights", (t["angle"] < 0) | (t["angle"] > np.pi / 2), "its disk is wider than half of the sky")
    c = t["coefficients"]
    polynomial = (t["falloff"] == ir.FalloffKind.POLYNOMIAL) & ((c < 0).any(axis=1) | ~(c > 0).any(axis=1))
    ramp = (t["falloff"] == ir.FalloffKind.RAMP) & ~((c[:, 0] >= 0) & (c[:, 1] > c[:, 0]))
    check.bad("lights", polynomial | ramp, "its fall-off is none")
    valid = (t["receivers"] == EVERYTHING) | (t["receivers"] & ~ALL_VISIBLE == 0)
    valid &= t["blockers"] & ~ALL_VISIBLE == 0
    check.bad("lights", ~valid, "its links have bits that mean nothing")
    dark = ~(t["color"] > 0).any(axis=1)
    check.bad("lights", dark, "its strength is 0: it gives no light", "warning")
    shape = t["instance"]
    has_shape = shape >= 0
    back = np.zeros(len(kind), dtype=bool)
    back[has_shape] = check.tables["instances"]["light"][shape[has_shape]] == np.flatnonzero(has_shape)
    check.bad("lights", has_shape & ~back, "the instance that is its shape does not say so")


def _cameras(check: Check) -> None:
    t = check.tables["cameras"]
    check.bad("cameras", ~(t["extent"] > 0), "its field of view is not above 0")
    check.bad("cameras", t["aspect"] < 0, "its aspect is negative")
    check.bad("cameras", ~(t["pixel_aspect"] > 0), "the aspect of its pixels is not above 0")
    parallel = t["projection"] == ir.Projection.ORTHOGRAPHIC
    check.bad("cameras", ~(((t["near"] >= 0) | parallel) & (t["far"] > t["near"])), "its near and far are in the wrong order")
    check.bad("cameras", ~((t["lens"] >= 0) & (t["focus"] > 0)), "its lens has no radius, or nothing it is focused on")
    check.bad("cameras", (t["lens"] > 0) & (t["projection"] != ir.Projection.PERSPECTIVE), "only perspective cameras have a lens")
    check.bad("cameras", np.isinf(t["exposure"]), "its exposure is not finite")
    check.bad("cameras", t["shutter"] < 0, "its shutter is open for less than no time")


def _settings(check: Check) -> None:
    s = check.scene.settings
    if s.size is not None and not (len(s.size) == 2 and all(isinstance(v, int) and 1 <= v <= MAX_SIDE for v in s.size)):
        check.fatal(f"a picture is 1 to 65536 pixels wide and high, not {s.size}")


def _without_empty_instances(check: Check) -> None:
    """Removes instances of meshes that have no triangles left."""
    geometries, instances = check.tables["geometries"], check.tables["instances"]
    empty = (geometries["kind"] == Kind.MESH) & (geometries["triangle_count"] == 0)
    keep = ~empty[instances["geometry"]]
    if not check.bad("instances", ~keep, "its mesh has no triangle that can be drawn: it is left out", "warning"):
        return
    renumbered = np.where(keep, np.cumsum(keep) - 1, -1).astype(np.int32)
    for column, values in list(instances.items()):
        check.set("instances", column, values[keep])
    names = tuple(name for name, is_kept in zip(check.names.instances, keep, strict=True) if is_kept)
    check.names = replace(check.names, instances=names)
    for table in check.spans.keys() & {"instances", "calls"}:
        check.spans[table] = check.spans[table][keep]
    shapes = check.tables["lights"]["instance"]
    check.set("lights", "instance", np.where(shapes >= 0, renumbered[np.maximum(shapes, 0)], -1).astype(np.int32))
