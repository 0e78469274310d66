"""Textures as `image`, `checker`, `stripes` and `pattern`; their pictures in the folder beside the scene."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....lang.colors import srgb_to_linear
from ... import ir
from ...formula.tape import load_tape
from ...importers import images
from ..export import Export
from ..texture_values import pixels
from . import formulas, words
from .files import Files

_LEVELS = np.arange(256) / 255.0
_ENCODINGS = {"srgb": np.array([srgb_to_linear(v) for v in _LEVELS.tolist()]), "linear": _LEVELS}
_WHITE = (1.0, 1.0, 1.0)
_CLOSE = 1e-6  # of a value of 8 bits


class Picture(NamedTuple):
    """A picture beside the scene: its file and the encoding of its colours, "" for floats."""

    file: str
    encoding: str


class Textures:
    """The textures of a scene, each a `let`. `lets` are their statements."""

    def __init__(self, out: Export, files: Files, png: Any) -> None:
        self.out, self.files, self._png = out, files, png
        self.tables = out.scene.tables
        self.lets: list[str] = []
        self._names: dict[Any, str] = {}
        self._pictures: dict[int, Picture] = {}

    def name(self, row: int, use: str, gain: tuple[float, float, float], fallback: str) -> str | None:
        """The name of a texture times `gain`, for `use` as "color", "number" or "directions"; None, after a report, without one."""
        key = (row, use, gain)
        if key not in self._names:
            text = self._text(row, use, gain)
            if text is None:
                return None
            self._names[key] = self.files.identifiers.new(self._source(row, fallback), fallback)
            self.lets.append(f"let {self._names[key]} = {text}")
        return self._names[key]

    def _source(self, row: int, fallback: str) -> str:
        image, names = int(self.tables.textures.image[row]), self.out.scene.names.images
        return Path(names[image]).stem if 0 <= image < len(names) and names[image] else fallback

    def _text(self, row: int, use: str, gain: tuple[float, float, float]) -> str | None:
        textures, kind = self.tables.textures, ir.TextureKind(int(self.tables.textures.kind[row]))
        if kind == ir.TextureKind.FORMULA:
            return self._pattern(row, use, gain)
        frame = self._frame(row)
        mapping = ir.TextureMapping(int(textures.mapping[row])).name.lower()
        common = {"mapping": words.string(mapping)} if mapping != "uv" else {}
        if kind == ir.TextureKind.IMAGE:
            picture = self.picture(int(textures.image[row]))
            return words.call("image", words.string(picture.file), **self._levels(row, use, gain, picture), **common, **frame)
        if kind not in (ir.TextureKind.CHECKER, ir.TextureKind.STRIPES):
            self.out.cannot("densities of voxels are not carried", "textures", row)
            return None
        if kind == ir.TextureKind.CHECKER and "angle" in frame:
            self.out.cannot("a checker that is turned is not carried", "textures", row)
            frame.pop("angle")
        factor, offset = self._linear(row, use, gain)
        a, b = (factor * color + offset for color in (textures.color_a[row], textures.color_b[row]))
        if float(textures.size[row]) > 0.0:
            common["size"] = words.number(float(textures.size[row]))
        return words.call(kind.name.lower(), words.color(a), words.color(b), **common, **frame)

    def _levels(self, row: int, use: str, factor: tuple[float, float, float], picture: Picture) -> dict[str, str]:
        """The arguments of an image but its file and frame."""
        textures = self.tables.textures
        levels: dict[str, str] = {}
        wraps = [ir.Wrap(int(wrap[row])).name.lower() for wrap in (textures.wrap_u, textures.wrap_v)]
        if wraps[0] != "repeat":
            levels["wrap"] = words.string(wraps[0])
        if wraps[1] != wraps[0]:
            levels["wrap_v"] = words.string(wraps[1])
        if textures.nearest[row]:
            levels["filter"] = words.string("nearest")
        if picture.encoding and picture.encoding != ("srgb" if use == "color" else "linear"):
            levels["space"] = words.string(picture.encoding)
        channel = int(textures.channel[row])
        if channel >= (0 if use != "number" else 1) or use == "opacity":
            levels["channel"] = words.string("rgba"[max(channel, 0)])
        gain, bias = self._linear(row, use, factor)
        if use in ("number", "opacity"):
            gain, bias = np.full(3, gain[0]), np.full(3, bias[0])
        if (gain != 1.0).any():
            levels["gain"] = _factors(gain)
        if bias.any():
            levels["bias"] = _factors(bias)
        return levels

    def _linear(self, row: int, use: str, factor: tuple[float, float, float]) -> tuple[Any, Any]:
        """(gain, bias) of a texture times `factor`, (3,) each, as they are written: directions are colours, 0 … 1 for −1 … 1."""
        gain, bias = self.tables.textures.gain[row] * factor, self.tables.textures.bias[row] * factor
        return (gain / 2.0, (bias + 1.0) / 2.0) if use == "directions" else (gain, bias)

    def _frame(self, row: int) -> dict[str, str]:
        """`scale`, `offset` and `angle` of uv' = turn · (scale · (uv − offset))."""
        (a, b, x), (c, d, y) = self.tables.textures.frame[row].tolist()
        angle = math.atan2(-c, a) if a or c else math.atan2(b, d)
        cosine, sine = math.cos(angle), math.sin(angle)
        scale = (cosine * a - sine * c, sine * b + cosine * d)
        again = np.array([[cosine * scale[0], sine * scale[1]], [-sine * scale[0], cosine * scale[1]]])
        if np.abs(again - [[a, b], [c, d]]).max() > 1e-6 * max(map(abs, scale)) or 0.0 in scale:
            self.out.cannot("a texture that is sheared is not carried as such", "textures", row)
        offset = (-(cosine * x - sine * y) / (scale[0] or 1.0), -(sine * x + cosine * y) / (scale[1] or 1.0))
        arguments = {}
        if scale != (1.0, 1.0):
            arguments["scale"] = words.one_or_all([_tidy(v) for v in scale])
        if any(abs(v) > 1e-12 for v in offset):
            arguments["offset"] = words.one_or_all([_tidy(v) for v in offset])
        if abs(angle) > 1e-12:
            arguments["angle"] = words.degrees(angle)
        return arguments

    def _pattern(self, row: int, use: str, factor: tuple[float, float, float]) -> str | None:
        gain, bias = self._linear(row, use, factor)
        tape = load_tape(self.tables, int(self.tables.textures.tape[row]))
        text = formulas.pattern(tape, list(zip(gain.tolist(), bias.tolist(), strict=True)), self._looked_up)
        if text is None:
            self.out.cannot("a pattern is not carried: it is white", "textures", row)
        return text

    def _looked_up(self, row: int, alpha: bool) -> str:
        """The name of the image that a formula looks up, of its alpha channel or its colours."""
        key = (row, "alpha" if alpha else "texel", _WHITE)
        if key not in self._names:
            picture = self.picture(int(self.tables.textures.image[row]))
            levels = self._levels(row, "color", _WHITE, picture) | ({"channel": words.string("a")} if alpha else {})
            self._names[key] = self.files.identifiers.new(self._source(row, "picture"), "picture")
            self.lets.append(f"let {self._names[key]} = {words.call('image', words.string(picture.file), **levels)}")
        return self._names[key]

    # --- pictures ---

    def picture(self, image: int) -> Picture:
        """The picture of an image (a row), written once: as it is where it lies below the folder of the scene."""
        if image not in self._pictures:
            self._pictures[image] = self._beside(image) or self._written(image)
        return self._pictures[image]

    def _beside(self, image: int) -> Picture | None:
        """The source of an image below the folder of the scene, if it is that very picture."""
        names = self.out.scene.names.images
        path = Path(names[image]) if image < len(names) and names[image] else None
        if path is None or not path.is_file() or not path.resolve().is_relative_to(self.files.folder.resolve()):
            return None
        texels = pixels(self.tables.images, image)
        for encoding in ("srgb", "linear"):
            try:
                decoded = images.read(str(path), path.name, encoding)
            except (images.ImageError, OSError):
                return None
            if np.array_equal(decoded.texels, texels):
                return Picture(path.resolve().relative_to(self.files.folder.resolve()).as_posix(), encoding)
        return None

    def _written(self, image: int) -> Picture:
        texels = pixels(self.tables.images, image)
        source = self._stem(image)
        alpha = None if (texels[..., 3] == 1.0).all() else texels[..., 3]
        for encoding, levels in _ENCODINGS.items():
            if _is_of(texels[..., :3], levels) and (alpha is None or _is_of(alpha, _LEVELS)):
                data = self._png(texels[..., :3], color=encoding == "srgb", alpha=alpha)
                return Picture(self.files.add(source, "picture", ".png", data), encoding)
        return Picture(self.files.add(source, "picture", ".exr", exr(texels)), "")

    def _stem(self, image: int) -> str:
        names = self.out.scene.names.images
        return Path(names[image]).stem if image < len(names) else ""


def _is_of(values: NDArray[np.float32], levels: NDArray[np.float64]) -> bool:
    """Whether all values are among some levels of 8 bits."""
    nearest = np.clip(np.searchsorted(levels, values), 1, 255)
    return bool((np.minimum(np.abs(levels[nearest] - values), np.abs(levels[nearest - 1] - values)) <= _CLOSE).all())


def exr(texels: NDArray[np.float32]) -> bytes:
    """An OpenEXR file of floats with the bits of (height, width, 4) pixels; without alpha where it is 1."""
    import OpenImageIO as oiio

    opaque = bool((texels[..., 3] == 1.0).all())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "picture.exr")
        spec = oiio.ImageSpec(texels.shape[1], texels.shape[0], 3 if opaque else 4, oiio.FLOAT)
        spec.attribute("compression", "zip")
        spec.attribute("oiio:UnassociatedAlpha", 1)
        picture = oiio.ImageBuf(spec)
        picture.set_pixels(oiio.ROI.All, np.ascontiguousarray(texels[..., :3] if opaque else texels))
        picture.write(str(path))
        return path.read_bytes()


def _factors(values: Any) -> str:
    r, g, b = (float(v) for v in values)
    return words.number(r) if r == g == b else f"rgb({words.number(r)}, {words.number(g)}, {words.number(b)})"


def _tidy(value: float) -> float:
    """A factor or offset without the rounding of a turn."""
    return round(value, 9) if abs(round(value, 9) - value) < 1e-12 else value
