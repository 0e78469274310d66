"""Saves a scene to an .npz file and loads it: tables as arrays, the rest as JSON, no pickle."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...lang.diagnostics import Diagnostic, SceneError, Span
from ...lang.elements import ParamInfo
from .. import ir
from ..io import array_files
from ..io.replace_file import replacing

VERSION = 7
FORMAT = "maquette ir"
_DAMAGE = (ValueError, KeyError, TypeError, AttributeError, IndexError, RuntimeError, MemoryError)


def save(scene: ir.Scene, path: Path | str) -> None:
    """Write a scene to `path` atomically. Raises OSError."""
    with replacing(Path(path)) as partial, partial.open("wb") as file:
        np.savez(file, allow_pickle=False, **to_arrays(scene))  # pyright: ignore[reportArgumentType]


def to_arrays(scene: ir.Scene) -> dict[str, np.ndarray]:
    """A scene as arrays by name, views of its own where they are columns; `about` is JSON in UTF-8, as bytes."""
    arrays = {f"{table}.{column}": values for table, column, values in columns(scene)}
    arrays |= {f"spans.{table}": rows for table, rows in scene.spans.rows.items()}
    arrays["about"] = np.frombuffer(json.dumps(_about(scene)).encode("utf-8"), dtype=np.uint8)
    return arrays


def from_arrays(arrays: Mapping[str, np.ndarray]) -> ir.Scene:
    """The scene of `to_arrays`, not validated; arrays of the right type are not copied. Raises SceneError for those of another version."""
    about = json.loads(arrays["about"].tobytes().decode("utf-8"))
    if about["format"] != FORMAT:
        raise _refused(None, "it is not maquette's")
    if about["version"] != VERSION:
        raise _refused(None, f"it is of version {about['version']}, and this program reads {VERSION}: compile the scene again")
    return _scene(arrays, about)


def load(path: Path | str) -> ir.Scene:
    """The scene from a file written by `save`, not validated. Raises SceneError for a damaged or foreign file."""
    try:
        return from_arrays(array_files.read(path))
    except SceneError as error:
        raise SceneError([replace(d, span=Span(str(path))) for d in error.diagnostics]) from None
    except array_files.ArrayFileError as fault:
        raise _refused(path, str(fault)) from None
    except _DAMAGE:
        raise _refused(path, "it is damaged, or something else") from None


def content_hash(scene: ir.Scene) -> str:
    """SHA-256 of a scene's drawn content: tables, names and settings, without source positions."""
    digest = hashlib.sha256()
    for table, column, values in columns(scene):
        digest.update(f"{table}.{column} {values.dtype.str} {values.shape}\n".encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    about = _about(scene)
    digest.update(json.dumps({key: about[key] for key in ("names", "settings", "photometric", "duration", "fps")}).encode())
    return digest.hexdigest()


def columns(scene: ir.Scene) -> list[tuple[str, str, np.ndarray]]:
    """(table, column, values) of all tables, in table order."""
    return [
        (table, column, values) for table in ir.TABLES for column, values in getattr(scene.tables, table)._asdict().items()
    ]  # fmt: skip


def _refused(path: Path | str | None, reason: str) -> SceneError:
    return SceneError([Diagnostic("error", f"cannot read the saved scene: {reason}", None if path is None else Span(str(path)))])


def _about(scene: ir.Scene) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "version": VERSION,
        "name": scene.name,
        "names": {f.name: list(getattr(scene.names, f.name)) for f in fields(scene.names)},
        "sources": scene.spans.sources,
        "settings": asdict(scene.settings),
        "photometric": scene.photometric,
        "duration": scene.duration,
        "fps": scene.fps,
        "defaults": scene.defaults,
        "files": scene.files,
        "params": [asdict(p) for p in scene.params],
        "meters": [asdict(m) for m in scene.meters],
        "is_wide": scene.is_wide,
    }


def _scene(arrays: Any, about: dict[str, Any]) -> ir.Scene:
    tables = {}
    for name, table in ir.TABLES.items():
        columns = {column: arrays[f"{name}.{column}"] for column in table._fields}  # type: ignore[attr-defined]
        for column, values in columns.items():
            dtype, shape = ir.column_type(name, column)
            if values.dtype != dtype or values.shape[1:] != shape:
                raise ValueError(f"{name}.{column}")
        tables[name] = ir.table_of(name, columns)
    spans = {name: arrays[f"spans.{name}"] for name in (*ir.TABLES, "calls", "settings") if f"spans.{name}" in arrays}
    if any(rows.dtype != np.int32 or rows.ndim != 2 or rows.shape[1] != 5 for rows in spans.values()):
        raise ValueError("spans")
    settings = {f.name for f in fields(ir.Settings)}
    return ir.Scene(
        str(about["name"]),
        ir.Tables(**tables),
        ir.Names(**{table: tuple(map(str, names)) for table, names in about["names"].items()}),
        ir.Spans(tuple(map(str, about["sources"])), spans),
        ir.Settings(**{key: tuples(value) for key, value in about["settings"].items() if key in settings}),
        bool(about["photometric"]),
        None if about["duration"] is None else float(about["duration"]),
        float(about["fps"]),
        tuple(map(str, about["defaults"])),
        tuple(map(str, about["files"])),
        tuple(_param(p) for p in about["params"]),
        tuple(_meter(m) for m in about["meters"]),
        bool(about.get("is_wide", False)),
    )


def _param(data: dict[str, Any]) -> ParamInfo:
    plain = {key: tuples(value) for key, value in data.items() if key != "span"}
    return ParamInfo(**plain, span=Span(**data["span"]))


def _meter(data: dict[str, Any]) -> ir.Meter:
    plain = {key: tuples(value) for key, value in data.items() if key != "place"}
    return ir.Meter(**plain, place=None if data["place"] is None else Span(**data["place"]))


def tuples(value: Any) -> Any:
    """JSON lists converted back to tuples."""
    return tuple(tuples(v) for v in value) if isinstance(value, list) else value
