"""The messages of pages: what each kind holds. cattrs checks every message of a page by these classes before anything else reads it."""

from __future__ import annotations

import json
import math
import operator
import reprlib
from functools import partial
from typing import Any

import cattrs
from attrs import define

from .state import StateError

MAX_LINE = 1 << 30
MAX_SHOWN = 400  # characters of an answer


@define
class Hello:
    """A page greets; one of a server that is gone brings its state and its unsaved texts by path."""

    boot: str | None = None
    state: dict[str, Any] | None = None
    texts: dict[str, str] | None = None


@define
class Change:
    """Fields of State.changed, which checks each."""

    state: dict[str, Any]


@define
class Text:
    """The unsaved text of a file."""

    path: str
    text: str


@define
class Save:
    """The text of a file to write. `saved` is the digest of the text that the page knows."""

    path: str
    text: str
    saved: str | None = None
    force: bool = False


@define
class WriteParams:
    """The names of params whose values go into the source; None: all."""

    names: list[str] | None = None


@define
class Pick:
    """A place of the picture, as shares of its width and height."""

    x: float
    y: float


@define
class Outline:
    """A line of a file, from 1."""

    path: str
    line: int


@define
class Camera:
    """The page asks for the camera as source."""


KINDS: dict[str, tuple[type, str]] = {
    "hello": (Hello, "a greeting may have boot, state and texts by path"),
    "change": (Change, "a change has a `state`"),
    "text": (Text, "a text has a path and a text"),
    "save": (Save, "a text to save has a path and a text"),
    "write_params": (WriteParams, "params to write are a list of names"),
    "pick": (Pick, "a click has x and y"),
    "outline": (Outline, "an outline has a line"),
    "camera": (Camera, ""),
}  # fmt: skip


def parsed(data: str | bytes) -> Any:
    """The value of a message's JSON. Raises StateError for what is none, nests too deep or has numbers that JSON lacks."""
    if isinstance(data, bytes):
        raise StateError("a message is text, not bytes")
    try:
        return json.loads(data, parse_constant=_refuse)
    except RecursionError:
        raise StateError("the message nests too deep") from None
    except ValueError as fault:
        raise StateError(f"the message is not JSON: {fault}"[:MAX_SHOWN]) from None


def check(message: Any) -> str:
    """The kind of a sound message. Raises StateError with what is wrong."""
    kind = message.get("type") if isinstance(message, dict) else None
    if not isinstance(kind, str) or kind not in KINDS:
        raise StateError(f"there is no message {reprlib.repr(kind)}")
    wanted, text = KINDS[kind]
    try:
        _CONVERTER.structure(message, wanted)
    except Exception as fault:  # cattrs raises groups of what the hooks raise
        raise StateError(text) from fault
    return kind


def _refuse(name: str) -> Any:
    raise ValueError(f"{name} is not a number of JSON")


def _text(value: Any, _: Any) -> str:
    if not isinstance(value, str):
        raise TypeError("expected a text")
    value.encode()  # half of a surrogate pair raises UnicodeEncodeError
    return value


def _integer(value: Any, _: Any) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value <= MAX_LINE:
        raise ValueError("expected a line")
    return value


def _number(value: Any, _: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value) or abs(value) > MAX_LINE:
        raise ValueError("expected a number")
    return float(value)


def _flag(value: Any, _: Any) -> bool:
    if not isinstance(value, bool):
        raise TypeError("expected true or false")
    return value


def _table(value: Any, _: Any) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise TypeError("expected fields by name")
    return value


def _texts(value: Any, _: Any) -> dict[str, str]:
    return {_text(name, None): _text(text, None) for name, text in _table(value, None).items()}


def _names(value: Any, _: Any) -> list[str]:
    if not isinstance(value, list):
        raise TypeError("expected a list")
    return [_text(name, None) for name in value]


_CONVERTER = cattrs.Converter()
_CONVERTER.register_structure_hook(str, _text)
_CONVERTER.register_structure_hook(int, _integer)
_CONVERTER.register_structure_hook(float, _number)
_CONVERTER.register_structure_hook(bool, _flag)
for _kind, _hook in ((dict[str, Any], _table), (dict[str, str], _texts), (list[str], _names)):
    _CONVERTER.register_structure_hook_func(partial(operator.eq, _kind), _hook)
