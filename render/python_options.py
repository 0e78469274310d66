"""Keyword arguments of the functions in Python: which are settings, which values of a scene's params; values as text of the language."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from typing import Any, NamedTuple

from ..compiler import ir
from ..lang.diagnostics import Diagnostic, SceneError, SceneWarning, suggest
from ..lang.schema.picture_settings import PICTURE_SETTINGS
from .image.image import Image

SETTINGS = tuple(field.name for field in fields(ir.Settings))


class Swept(NamedTuple):
    """A picture of `sweep`, and the values of the params that it shows."""

    values: dict[str, Any]
    image: Image


def as_text(value: Any) -> str:
    """A Python value in the syntax of a scene."""
    if hasattr(value, "tolist"):  # of numpy
        value = value.tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(as_text, value))}]"
    return value if isinstance(value, str) else repr(value)


def split(options: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """(settings, all others) of keyword arguments."""
    settings = {name: value for name, value in options.items() if name in SETTINGS}
    return settings, {name: value for name, value in options.items() if name not in SETTINGS}


def read(name: str, value: Any, reader: Callable[[Any], Any]) -> Any:
    """The value of a keyword argument by its reader; None stays None. Raises ValueError with the name."""
    try:
        return None if value is None else reader(value)
    except ValueError as error:
        raise ValueError(f"{name}={value!r}: {error}") from None


def picture_settings(arguments: Mapping[str, Any]) -> ir.Settings:
    """The settings of keyword arguments, as numbers, tuples and names or as texts of the command line: error=0.01 or error="1%".

    Raises ValueError for a value that a setting cannot have, and for settings that exclude each other.
    """
    values = {name: read(name, value, PICTURE_SETTINGS[name].read) for name, value in arguments.items() if value is not None}
    if "samples" in values and "error" in values:
        raise ValueError("samples and error exclude each other: samples sets the work, error the quality")
    return ir.Settings(**values)


def settings_of(scene: ir.Scene, arguments: Mapping[str, Any]) -> ir.Settings:
    """The settings of `render` for a compiled scene, whose params have their values.

    Raises TypeError for other keyword arguments, ValueError as `picture_settings`.
    """
    settings, others = split(arguments)
    for name in others:
        if any(param.name == name for param in scene.params):
            raise TypeError(f"`{name}` is a param of this scene, which is compiled: give it to maquette.load, or to render with the file")
        near = suggest(name, SETTINGS)
        raise TypeError(f"render has no setting `{name}`{f'; {near}' if near else ''}: it has {', '.join(SETTINGS)}")
    return picture_settings(settings)


def explain_unknown(error: SceneError, function: str, params: Iterable[str]) -> None:
    """Add a note to an error about params that the scene does not have, where a setting has a similar name."""
    for name in params:
        near = suggest(name, SETTINGS)
        if near and any(item.message.startswith(f"the scene has no param `{name}`") for item in error.diagnostics):
            error.add_note(f"nor has {function} a setting `{name}`; {near}")


def warn(diagnostics: Iterable[Diagnostic], stacklevel: int) -> None:
    """Hand warnings to Python's `warnings`, each as one line. Notes are left out."""
    for item in diagnostics:
        if item.severity == "warning":
            place = f"{item.span}: " if item.span else ""
            warnings.warn(f"{place}{item.message}{f'; {item.hint}' if item.hint else ''}", SceneWarning, stacklevel=stacklevel + 1)


def combinations(params: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """The values of each picture of a sweep: a list, tuple, range or array holds several, which are combined; the last varies fastest.

    Raises ValueError where no param has several values, or one has an empty list.
    """
    several = {name: _items(value) for name, value in params.items() if _items(value) is not None}
    for name, values in several.items():
        if not values:
            raise ValueError(f"{name}={params[name]!r}: the list of its values is empty")
    if not several:
        raise ValueError("no param has several values: write maquette.sweep(file, radius=[0.4, 0.8, 1.6])")
    for chosen in itertools.product(*(values or () for values in several.values())):
        yield {**params, **dict(zip(several, chosen, strict=True))}


def _items(value: Any) -> Sequence[Any] | None:
    """The values of a list, tuple, range or array; None for one value."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    return value if isinstance(value, list | tuple | range) else None
