"""Dumps a scene as stable, compact text for `inspect --ir` and golden tests, or as plain data."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

from ...shapes import SHAPES
from .. import ir
from . import serialize

MAX_ROWS = 1000  # most rows of a table to print
_KINDS: dict[tuple[str, str], type] = {
    ("geometries", "kind"): ir.GeometryKind,
    ("attributes", "interpolation"): ir.Interpolation,
    ("materials", "model"): ir.MaterialModel,
    ("materials", "shading"): ir.Shading,
    ("textures", "kind"): ir.TextureKind,
    ("textures", "mapping"): ir.TextureMapping,
    ("textures", "wrap_u"): ir.Wrap,
    ("textures", "wrap_v"): ir.Wrap,
    ("lights", "kind"): ir.LightKind,
    ("lights", "falloff"): ir.FalloffKind,
    ("cameras", "projection"): ir.Projection,
    ("cameras", "fit"): ir.Fit,
}
_MEASURES = {ir.GeometryKind.MESH: 0, ir.GeometryKind.FORMULA: 6, **{kind: len(shape.MEASURES) for kind, shape in SHAPES.items()}}
_DEFAULTS = {  # default values: columns with them are left out
    "geometries": {"origin": 0, "first_vertex": 0, "vertex_count": 0, "first_triangle": 0, "triangle_count": 0, "first_polygon": 0,
                   "polygon_count": 0, "normals": -1, "uvs": -1, "colors": -1, "tape": -1},
    "instances": {"transform": 0, "light": -1, "visible": 7},
    "materials": {"shading": 0, "normalized": 0, "threshold": 0, "first": -1, "second": -1, "medium": -1},
    "media": {"scattering": 0, "absorption": 0, "emission": 0, "anisotropy": 0, "draine": 0, "priority": 0, "everywhere": 0,
              "top": np.inf, "falloff": 0, "density": -1, "transform": 0, "bounds": ((-np.inf,) * 3, (np.inf,) * 3)},
    "textures": {"mapping": 0, "wrap_u": 0, "wrap_v": 0, "nearest": 0, "image": -1, "tape": -1, "channel": -1, "size": 0, "gain": 1,
                 "bias": 0, "slices": 0, "frame": ((1, 0, 0), (0, 1, 0))},
    "lights": {"position": 0, "direction": (0, 1, 0), "transform": 0, "size": 0, "cos_cone": -1, "cos_full": -1, "angle": 0, "falloff": 0,
               "coefficients": 0, "image": -1, "instance": -1, "shadows": 1,
               "receivers": -1, "blockers": 2},
    "cameras": {"projection": 0, "fit": 0, "aspect": 0, "near": 0, "far": np.inf, "shift": 0, "exposure": np.nan,
                "opening": 0, "shutter": 0, "lens": 0, "focus": 1, "pixel_aspect": 1, "planes": 0},
    "transforms": {"flips": 0, "first_key": -1, "keys": 0},
}  # fmt: skip

_NUMBERS = frozenset(ir.Slot) - ir.COLOR_SLOTS - {ir.Slot.NORMAL, ir.Slot.COAT_NORMAL, ir.Slot.ABSORPTION}


def text(scene: ir.Scene) -> str:
    """Every row of every table, a line each; pools as a count and a short hash of their content."""
    lines = [f"scene {scene.name}"]
    lines += [f"  {name}: {_value(value)}" for name, value in _about(scene).items()]
    for name in ir.TABLES:
        if name == "pools":
            lines += _pools(scene)
        elif name == "polygons":
            lines += _pool_lines("polygons", scene.tables.polygons._asdict())
        else:
            lines += _table(scene, name)
    return "\n".join(lines) + "\n"


def data(scene: ir.Scene) -> dict[str, Any]:
    """Plain data: rows as dicts by column, pools as counts and hashes."""
    dumped: dict[str, Any] = {"scene": scene.name, "hash": serialize.content_hash(scene), **_plain(_about(scene))}
    dumped["params"] = [_plain(asdict(p)) for p in scene.params]
    dumped["files"] = list(scene.files)
    for name in ir.TABLES:
        table = getattr(scene.tables, name)._asdict()
        if name in ("pools", "polygons"):
            dumped[name] = {column: {"count": len(values), "hash": short_hash(values)} for column, values in table.items()}
            continue
        texels = table.pop("texels", None)
        names = getattr(scene.names, name, None)
        dumped[name] = [
            {**({"name": names[row]} if names else {}), **{c: _plain(_shown(name, c, v[row])) for c, v in table.items()}}
            for row in range(len(next(iter(table.values()))))
        ]
        for row, picture in enumerate(dumped[name] if texels is not None else ()):
            picture["hash"] = short_hash(_texels(scene, row))
    return dumped


def cells(scene: ir.Scene, table: str, row: int) -> dict[str, str]:
    """One row of a table (not a pool) as text by column, without default values; material slots are separate entries."""
    shown: dict[str, str] = {}
    for column, values in getattr(scene.tables, table)._asdict().items():
        if column in ("texels", "inverse"):
            continue
        if table == "materials" and column in ("values", "textures"):
            shown |= dict(part.split("=", 1) for part in _slots(column, values[row]))
        elif text := _cell(scene, table, column, values[row], row):
            shown[column] = text.removeprefix(f"{column}=")
    return shown


def short_hash(values: np.ndarray) -> str:
    """Hash of an array's content, ten digits."""
    return hashlib.sha256(np.ascontiguousarray(values).tobytes()).hexdigest()[:10]


def _about(scene: ir.Scene) -> dict[str, Any]:
    about: dict[str, Any] = {key: value for key, value in asdict(scene.settings).items() if value is not None}
    if scene.photometric:
        about["photometric"] = True
    if scene.duration is not None:
        about |= {"duration": scene.duration, "fps": scene.fps}
    if scene.defaults:
        about["defaults"] = scene.defaults
    for meter in scene.meters:
        about[f"meter {meter.name}"] = meter.on or (*(row[3] for row in meter.frame[:3]), *meter.size, *meter.cells)
    return about


def _table(scene: ir.Scene, name: str) -> list[str]:
    columns = getattr(scene.tables, name)._asdict()
    columns.pop("texels", None)
    if name == "transforms":
        columns.pop("inverse")  # derived from the matrix
    count = len(next(iter(columns.values())))
    if not count:
        return []
    names = getattr(scene.names, name, ("",) * count)
    lines = [f"{name} {count}"]
    for row in range(min(count, MAX_ROWS)):
        parts = [f'"{names[row]}"'] if names[row] else []
        parts += [text for column, values in columns.items() if (text := _cell(scene, name, column, values[row], row))]
        if name == "images":
            parts.append(f"#{short_hash(_texels(scene, row))}")
        lines.append(f"  {row}: {' '.join(parts)}".rstrip())
    if count > MAX_ROWS:
        rest = np.concatenate([np.ascontiguousarray(v[MAX_ROWS:]).view(np.uint8).reshape(-1) for v in columns.values()])
        lines.append(f"  … {count - MAX_ROWS} more #{short_hash(rest)}")
    return lines


def _texels(scene: ir.Scene, row: int) -> np.ndarray:
    images = scene.tables.images
    first = int(images.first[row])
    return images.texels[first : first + int(images.width[row]) * int(images.height[row])]


def _pools(scene: ir.Scene) -> list[str]:
    return _pool_lines("pools", scene.tables.pools._asdict())


def _pool_lines(name: str, columns: dict[str, np.ndarray]) -> list[str]:
    filled = [f"  {column}: {len(values)} #{short_hash(values)}" for column, values in columns.items() if len(values)]
    return [name, *filled] if filled else []


def _cell(scene: ir.Scene, table: str, column: str, value: Any, row: int) -> str:
    """`column=value`, or "" for a default value."""
    if table == "geometries" and column == "parameters":
        used = _MEASURES[ir.GeometryKind(int(scene.tables.geometries.kind[row]))]
        return f"parameters={_value(value[:used])}" if used else ""
    if table == "materials" and column in ("values", "textures"):
        return " ".join(_slots(column, value))
    if table == "materials" and column == "textured":
        return ""  # implied by the textures
    quiet = _DEFAULTS.get(table, {}).get(column)
    if quiet is not None and _same(value, quiet):
        return ""
    shown = _shown(table, column, value)
    return shown if isinstance(shown, str) and column in ("kind", "model") else f"{column}={_value(shown)}"


def _same(value: Any, quiet: Any) -> bool:
    """Whether all of a value equals the default, with NaN equal to NaN."""
    a, b = np.asarray(value, dtype=np.float64), np.asarray(quiet, dtype=np.float64)
    return bool(np.all((a == b) | (np.isnan(a) & np.isnan(b))))


def _slots(column: str, value: np.ndarray) -> Iterator[str]:
    for slot in ir.Slot:
        name = slot.name.lower()
        if column == "textures" and value[slot] >= 0:
            yield f"{name}*=texture {value[slot]}"
        elif column == "values":
            number = slot in _NUMBERS
            plain = 1.0 if slot in (ir.Slot.IOR, ir.Slot.OPACITY) else 0.0
            if (number and value[slot, 0] != plain) or (not number and value[slot].any()):
                yield f"{name}={_value(value[slot, 0] if number else value[slot])}"


def _shown(table: str, column: str, value: Any) -> Any:
    kinds = _KINDS.get((table, column))
    if kinds is not None:
        return kinds(int(value)).name.lower()
    return value


def _value(value: Any) -> str:
    if isinstance(value, np.ndarray | tuple | list):
        return f"[{' '.join(_value(v) for v in value)}]"
    if isinstance(value, bool | np.bool_):
        return "true" if value else "false"
    if isinstance(value, float | np.floating):
        return f"{float(value) + 0.0:.9g}"  # + 0.0: no negative zero
    return f'"{value}"' if isinstance(value, str) and " " in value else str(value)


def _plain(value: Any) -> Any:
    """numpy values and tuples as JSON types; non-finite numbers as null."""
    if isinstance(value, dict):
        return {key: _plain(v) for key, v in value.items()}
    if isinstance(value, np.ndarray | tuple | list):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
