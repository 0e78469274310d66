"""State of the live window: what the pages set on top of the files of the scene."""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ..lang.schema.picture_channels import CHANNELS
from ..lang.schema.picture_settings import PICTURE_SETTINGS

MAX_TEXT = 4 << 20  # characters of an unsaved file
MAX_STOPS = 64.0


def channel_labels() -> list[tuple[str, str]]:
    """(name, label) of each channel that a page can show."""
    return [("color", "picture"), *((name, channel.label or name) for name, channel in CHANNELS.items() if channel.shown)]


class StateError(ValueError):
    """A message of a page that is not a state. The text says what is wrong."""


@dataclass(frozen=True, slots=True)
class Pose:
    """A camera moved by hand. Metres, world space; `extent` replaces the camera's own (None: unchanged)."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    up: tuple[float, float, float]
    extent: float | None = None


@dataclass(frozen=True, slots=True)
class State:
    """What the pages have set. None: as the scene or the command line says."""

    texts: Mapping[str, str] = field(default_factory=dict)  # unsaved texts by resolved path
    sets: Mapping[str, str] = field(default_factory=dict)  # values of params, as of --set
    camera: str | None = None
    pose: Pose | None = None
    backend: str | None = None
    exposure: float | None = None
    channel: str = "color"
    moment: float | None = None  # seconds, or a USD time code

    def changed(self, changes: Mapping[str, Any]) -> State:
        """This state with the fields of a page's message. `sets` with a value of None are removed. Raises StateError."""
        fields = {name: _READERS[name](value) for name, value in changes.items() if name in _READERS}
        if unknown := next((name for name in changes if name not in _READERS and name != "sets"), None):
            raise StateError(f"a state has no `{unknown[:100]}`")
        if "sets" in changes:
            fields["sets"] = self._sets(changes["sets"])
        return replace(self, **fields)

    def _sets(self, values: Any) -> dict[str, str]:
        if not isinstance(values, dict):
            raise StateError("`sets` are values by name")
        merged = dict(self.sets)
        for name, value in values.items():
            if value is None:
                merged.pop(str(name), None)
            else:
                merged[str(name)] = _text(value)
        return merged

    def with_text(self, path: str, text: str | None) -> State:
        """This state with an unsaved text of a file; None removes it. Raises StateError."""
        texts = {name: text for name, text in self.texts.items() if name != path}
        if text is not None:
            if len(text) > MAX_TEXT:
                raise StateError(f"the text has {len(text):,} characters, more than {MAX_TEXT:,}")
            texts[path] = text
        return replace(self, texts=texts)

    def to_json(self) -> dict[str, Any]:
        """The state without texts, as plain data."""
        pose = None
        if self.pose is not None:
            pose = {"position": self.pose.position, "look_at": self.pose.look_at, "up": self.pose.up, "extent": self.pose.extent}
        return {
            "sets": dict(self.sets), "camera": self.camera, "pose": pose, "backend": self.backend, "exposure": self.exposure,
            "channel": self.channel, "moment": self.moment,
        }  # fmt: skip


def _text(value: Any) -> str:
    is_half = isinstance(value, str) and any("\ud800" <= c <= "\udfff" for c in value)  # of a surrogate pair
    if not isinstance(value, str) or len(value) > 10_000 or is_half:
        raise StateError("a value of a param is a text")
    return value


def _optional_text(value: Any) -> str | None:
    return None if value is None else _text(value)


def _number(value: Any) -> float:
    try:
        number = math.nan if isinstance(value, bool) or not isinstance(value, int | float) else float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise StateError(f"expected a number, got {reprlib.repr(value)}")
    return number


def _optional_number(value: Any) -> float | None:
    return None if value is None else _number(value)


def _exposure(value: Any) -> float | None:
    stops = _optional_number(value)
    if stops is not None and abs(stops) > MAX_STOPS:
        raise StateError(f"an exposure is at most {MAX_STOPS:g} stops")
    return stops


def _backend(value: Any) -> str | None:
    if value is not None and value not in PICTURE_SETTINGS["backend"].choices:
        raise StateError(f"there is no backend {reprlib.repr(value)}")
    return value


def _channel(value: Any) -> str:
    if value not in [name for name, _ in channel_labels()]:
        raise StateError(f"there is no channel {reprlib.repr(value)}")
    return value


def _vector(value: Any) -> tuple[float, float, float]:
    if not isinstance(value, list) or len(value) != 3:
        raise StateError(f"expected three numbers, got {reprlib.repr(value)}")
    x, y, z = (_number(v) for v in value)
    return x, y, z


def _pose(value: Any) -> Pose | None:
    if value is None:
        return None
    if not isinstance(value, dict) or not {"position", "look_at", "up"} <= set(value):
        raise StateError("a pose has position, look_at and up")
    extent = _optional_number(value.get("extent"))
    if extent is not None and extent <= 0.0:
        raise StateError("an extent is more than 0")
    return Pose(_vector(value["position"]), _vector(value["look_at"]), _vector(value["up"]), extent)


_READERS = {
    "camera": _optional_text, "pose": _pose, "backend": _backend, "exposure": _exposure, "channel": _channel, "moment": _optional_number,
}  # fmt: skip
