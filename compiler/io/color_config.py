"""Configurations of OpenColorIO: their displays, views, looks and colour spaces, by the library inside of OpenImageIO.

A configuration is a file, an archive `.ocioz`, or one of the library's own, as `ocio://studio-config-latest`. It reads files of look-up
tables. These lie below its own folder; a configuration that names others is refused before it is opened.
"""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...lang import color_spaces
from ...lang.diagnostics import suggest
from ...lang.input_error import InputError
from . import environment, library_messages
from .regular_files import is_regular, read_bytes

ARCHIVE = ".ocioz"
HALF_MAX = 65504.0  # of light that configurations are made for
MAX_CONFIG = 64 << 20  # bytes
_REC709 = "lin_rec709_scene"
_XYZ_ROLE, _ACES_ROLE = "cie_xyz_d65_interchange", "aces_interchange"
_TRANSFORM, _SOURCE = re.compile(r"!<FileTransform>"), re.compile(r"""\bsrc["']?\s*:\s*("[^"\n]*"|'[^'\n]*'|[^,}\n]*)""")
_SEARCH = re.compile(r"^search_path\s*:[ \t]*(.*(?:\n[ \t]*-[^\n]*)*)", re.MULTILINE)
_ESCAPES = re.compile(r'"[^"\n]*\\[^"\n]*"|^\s*\?\s|%TAG', re.MULTILINE)


class ConfigError(InputError):
    """A configuration that cannot be used, or a name that it does not have."""


_used: ContextVar[str | None] = ContextVar("used", default=None)


@contextmanager
def used_by_pictures(name: str | None) -> Iterator[None]:
    """In the block, pictures may be of the colour spaces of a configuration."""
    token = _used.set(name)
    try:
        yield
    finally:
        _used.reset(token)


def of_pictures() -> Config | None:
    """The configuration for the colour spaces of pictures; None where neither a setting nor $OCIO names one. Raises ConfigError."""
    name = _used.get()
    return opened(environment.color_config(name)) if name or environment.has_color_config() else None


@functools.lru_cache(maxsize=8)
@library_messages.left_out()
def opened(name: str) -> Config:
    """A configuration. Raises ConfigError for one that is missing or broken, or that reads files elsewhere."""
    import OpenImageIO as oiio

    if not name.startswith(environment.BUILT_IN):
        _check_files(Path(name))
    config = oiio.ColorConfig(name)
    if fault := str(config.geterror()):
        reason = fault.replace(str(Path(name).parent) + os.sep, "").split("Error: ")[-1]
        raise ConfigError(f"the colour configuration {name} cannot be read: {' '.join(reason.split())}", "write the name of a config.ocio")
    return Config(name, config)


class Config:
    """An open configuration."""

    def __init__(self, name: str, config: Any) -> None:
        self.name, self._config = name, config
        self.spaces = tuple(map(str, config.getColorSpaceNames()))
        self.displays = tuple(map(str, config.getDisplayNames()))
        self.looks = tuple(map(str, config.getLookNames()))
        self.default_display = str(config.getDefaultDisplayName())

    def views(self, display: str = "") -> tuple[str, ...]:
        """The names of the views of a display, by default the first."""
        return tuple(map(str, self._config.getViewNames(display or self.default_display)))

    def default_view(self, display: str = "") -> str:
        """The first view of a display. Raises ConfigError for a display that it does not have."""
        self._check_display(display)
        return str(self._config.getDefaultViewName(display or self.default_display))

    def has_space(self, name: str) -> bool:
        """Whether it has a colour space, role or alias of this name."""
        return bool(name) and self._config.getColorSpaceIndex(name) >= 0

    def encoding(self, display: str, view: str) -> str:
        """The Color Interop Forum's name of what a view writes; "" where it has none."""
        space = self._config.getDisplayViewColorSpaceName(display or self.default_display, view)
        return str(self._config.get_color_interop_id(space) or "") if space else ""

    def check(self, display: str, view: str, look: str) -> None:
        """Raise ConfigError where it has no such display or look, or where a file of the view is missing or broken."""
        self._check_display(display)
        for name in filter(None, (part.strip().lstrip("+-").strip() for part in re.split("[,:|]", look))):
            if name not in self.looks:
                raise ConfigError(f"no look is called `{name}`; there are: {', '.join(self.looks) or 'none'}", suggest(name, self.looks))
        self.show(np.full((1, 1, 3), 0.18), display, view, look)

    def _check_display(self, display: str) -> None:
        if display and display not in self.displays:
            raise ConfigError(f"no display is called `{display}`; there are: {', '.join(self.displays)}", suggest(display, self.displays))

    def show(self, rgb: NDArray[np.float64], display: str, view: str, look: str) -> NDArray[np.float64]:
        """(h, w, 3) linear Rec.709 as values of a display, 0 to 1."""
        import OpenImageIO as oiio

        space, into = self._scene_space()
        light = np.nan_to_num(rgb, nan=0.0, posinf=HALF_MAX, neginf=0.0)
        light = light if into is None else light @ into.T
        source = oiio.ImageBuf(np.ascontiguousarray(light, dtype=np.float32))
        where = display or self.default_display
        shown = oiio.ImageBufAlgo.ociodisplay(source, where, view, space, look, False, colorconfig=self.name)
        return np.clip(_pixels(shown, f"the view `{view}` failed"), 0.0, 1.0).reshape(rgb.shape)

    def to_rec709(self, rgb: NDArray[np.float32], space: str) -> NDArray[np.float32]:
        """(h, w, 3) values of a colour space as linear Rec.709. Raises ConfigError."""
        import OpenImageIO as oiio

        target, into = self._scene_space()
        source = oiio.ImageBuf(np.ascontiguousarray(rgb, dtype=np.float32))
        made_linear = oiio.ImageBufAlgo.colorconvert(source, space, target, False, colorconfig=self.name)
        linear = _pixels(made_linear, f"the colour space `{space}` failed").astype(np.float32).reshape(rgb.shape)
        return linear if into is None else (linear @ np.linalg.inv(into).T).astype(np.float32)

    @functools.lru_cache(maxsize=1)  # noqa: B019 (configurations live as long as the process)
    def _scene_space(self) -> tuple[str, NDArray[np.float64] | None]:
        """A linear colour space, and the matrix from linear Rec.709 to it; None where it is that."""
        names = {color_spaces.find(space): space for space in reversed(self.spaces)}
        for row in (color_spaces.find(_REC709), color_spaces.find("acescg"), color_spaces.find("aces2065_1")):
            alias = _REC709 if row is not None and row.name == "lin_rec709" and self.has_space(_REC709) else names.get(row)
            if alias and row is not None and row.primaries is not None:
                plain = row.primaries == color_spaces.REC709
                return alias, None if plain else np.array(color_spaces.matrix(color_spaces.REC709, row.primaries))
        if self.has_space(_ACES_ROLE):
            return _ACES_ROLE, np.array(color_spaces.matrix(color_spaces.REC709, color_spaces.AP0))
        if self.has_space(_XYZ_ROLE):
            return _XYZ_ROLE, np.array(color_spaces.to_xyz(color_spaces.REC709))
        return "scene_linear", None


def _pixels(result: Any, failed: str) -> NDArray[np.float64]:
    import OpenImageIO as oiio

    if result.has_error:
        raise ConfigError(f"{failed}: {' '.join(str(result.geterror()).replace('Exception from OCIO:', '').split())}")
    return np.asarray(result.get_pixels(oiio.FLOAT), dtype=np.float64)


def _check_files(path: Path) -> None:
    """Raise ConfigError for a configuration that is no file, or that names a look-up table outside of its folder."""
    if not is_regular(path):
        reason = "it is not an ordinary file" if path.exists() else "there is no such file"
        raise ConfigError(f"the colour configuration {path} cannot be read: {reason}", "write the name of a config.ocio, or ocio://default")
    if path.suffix.lower() == ARCHIVE:  # its files are inside of it
        return
    try:
        text = read_bytes(str(path), MAX_CONFIG).decode("utf-8")
    except (OSError, UnicodeDecodeError) as fault:
        raise ConfigError(
            f"the colour configuration {path} cannot be read: {getattr(fault, 'strerror', None) or 'it is no text'}"
        ) from None
    base = path.absolute().parent.resolve()
    named = [match[1].strip().strip("\"'") for match in _SOURCE.finditer(text)]
    odd = any(not name or name[0] in "*&" or name.count('"') == 1 for name in named)
    if odd or len(named) < len(_TRANSFORM.findall(text)) or _ESCAPES.search(text):
        raise ConfigError(
            f"the colour configuration {path} names its look-up tables in a form that is not read", "write `src: name` in each"
        )
    for name in named:
        for target in _candidate_files(base, _search_paths(text), name):
            if not target.is_relative_to(base):
                message = f"the colour configuration {path} reads `{name}`, which lies outside of its folder"
                raise ConfigError(message, "copy it there, and write its new name")


def _search_paths(text: str) -> list[str]:
    entries = [re.split(r"\n\s*-|[:,]", match[1]) for match in _SEARCH.finditer(text)]
    return [entry.strip().strip("-[]\"' ") for parts in entries for entry in parts]


def _candidate_files(base: Path, searched: list[str], name: str) -> Iterator[Path]:
    if "$" in name or "%" in name or any("$" in entry or "%" in entry for entry in searched):
        raise ConfigError(f"a look-up table has a variable in its name: `{name}`", "write the name of the file")
    yield from (Path(base, entry, name).resolve() for entry in {"", *searched})
