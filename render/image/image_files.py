"""Writes image files: linear EXR with named channels, and 8 or 16-bit pictures after exposure and view transform."""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from ...compiler.io import color_config, environment, library_messages
from ...compiler.io.replace_file import Replacement, as_utf8
from ...lang.schema.picture_channels import CHANNELS, LIGHT, component_names
from . import color_channels, cryptomatte, metering, png_stream, srgb, tone_curves
from .srgb import encode_srgb

try:
    import resource
except ImportError:  # Windows
    resource = None

LINEAR = (".exr",)
DEPTHS = {".png": (8, 16), ".tif": (8, 16), ".tiff": (8, 16), ".jpg": (8,), ".jpeg": (8,)}  # bits a channel, by extension
JPEG = (".jpg", ".jpeg")
EXIF_DESCRIPTION, EXIF_SOFTWARE = 0x10E, 0x131
WITH_ALPHA = (".png", ".tif", ".tiff")
ROWS = 64  # of pixels, that a thread takes at a time
PLAIN = ("sRGB", "standard")  # views without a curve
# CPU seconds of writing a noisy picture: of any size, a pixel of 8 bits, of 16 bits or another view, of metering, and of 32 bits a channel
STARTING, WRITING_8, WRITING_16, METERING, WRITING_32 = 0.15, 1.8e-7, 6e-7, 5e-8, 1e-7
FULL = 1 << 16  # free bytes below which a disk is full
ABOUT = "maquette:"  # prefix of attribute names

CHANNEL_NAMES: dict[str, tuple[str, ...]] = {
    "rgba": ("R", "G", "B", "A"),
    **{name: component_names(name) for name, channel in CHANNELS.items() if channel.components},
    **{name: cryptomatte.channel_names(name) for name in cryptomatte.LAYERS},
}


class Picture(Protocol):
    """The parts of an image.Image that are written."""

    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def channels(self) -> dict[str, NDArray[np.float32]]: ...
    @property
    def metadata(self) -> dict[str, Any]: ...


class FormatError(ValueError):
    """An unsupported or incompatible file name, bit depth or view; the message lists the supported ones."""


@dataclass(frozen=True, slots=True)
class Look:
    """Conversion of scene-linear light to an 8 or 16-bit picture. Exposure is in stops: + 1 is twice as bright."""

    exposure: float = 0.0
    view: str = "sRGB"
    bits: int = 8
    alpha: bool = False  # keep coverage as the alpha channel
    white: float = 0.0  # kelvin of the light that becomes white; 0: light as it is
    ocio: str = ""  # configuration of OpenColorIO, of a view that is not in tone_curves; "": the default
    display: str = ""  # of that configuration; "": its first
    look: str = ""  # of that configuration; "": the view's own

    @classmethod
    def of(cls, plan: Any, exposure: float, bits: int = 8, alpha: bool | None = None) -> Look:
        """The look of a Plan. `alpha`: by default that of a transparent background."""
        keep = plan["background"] == "transparent" if alpha is None else alpha
        return cls(exposure, plan["view"], bits, keep, plan["white"], plan["ocio"], plan["display"], plan["look"])

    @classmethod
    def asked(cls, settings: Any) -> Look:
        """What ir.Settings say of the look before the scene is read; the default where its view depends on the scene."""
        if settings.view is None:
            return cls()
        return cls(0.0, settings.view, ocio=settings.ocio or "", display=settings.display or "", look=settings.look or "")


def check(path: Path, aov: tuple[str, ...] = (), bits: int | None = None, look: Look | None = None) -> None:
    """Check before rendering that a file named `path` supports the request. Raises FormatError."""
    suffix = path.suffix.lower()
    if suffix not in LINEAR and suffix not in DEPTHS:
        endings = ", ".join((*LINEAR, *DEPTHS))
        raise FormatError(f"cannot tell the picture format of {path}: its name must end in one of {endings}")
    if suffix in LINEAR and bits is not None:
        raise FormatError(f"{path.name} holds 32-bit floats: --bits is for 8 and 16-bit pictures")
    if suffix in DEPTHS and bits is not None and bits not in DEPTHS[suffix]:
        raise FormatError(f"{suffix} files have {DEPTHS[suffix][0]} bits a channel, not {bits}; .png and .tif have 16")
    if aov and suffix not in LINEAR:
        raise FormatError(f"{path.name} has no room for the channels {', '.join(aov)}: write an .exr")
    _check_look(look or Look())


def _check_look(look: Look) -> None:
    """Raise FormatError for a view, display or look that does not exist."""
    curve = look.view in tone_curves.CURVES
    if curve and (look.display or look.look):
        what = f"the display `{look.display}`" if look.display else f"the look `{look.look}`"
        raise FormatError(f"{what} has no view `{look.view}`, which is sRGB by a closed form: leave one of them out")
    if curve:
        return
    try:
        config = color_config.opened(environment.color_config(look.ocio))
        if not look.display or look.display in config.displays:
            available = views(look.ocio, look.display)
            if look.view not in available:
                raise FormatError(f"no view is called `{look.view}`; there are: {', '.join(available)}")
        config.check(look.display, look.view, look.look)
    except color_config.ConfigError as fault:
        raise FormatError(f"{fault.message}{f'; {fault.hint}' if fault.hint else ''}") from None


def write(picture: Picture, path: Path, look: Look, about: Mapping[str, str | int | float], threads: int = 0) -> None:
    """Write `picture` to `path` atomically, by renaming a temporary file in the same folder.

    EXR: float32, scene-linear, unexposed, associated alpha, all channels. Others: exposed, view-transformed, with unassociated alpha if
    `look.alpha`, else over black. Keys of `about` become `maquette:key` attributes. 0 `threads`: as many as
    drew the picture, or else as there are cores.
    """
    with Strips(path, look, about, picture.height, threads or int(picture.metadata.get("threads", 0))) as file:
        file.add(picture)


def writing_time(path: Path, pixels: int, look: Look, metered: bool = False, aovs: int = 0) -> float:
    """Seconds that a noisy picture of so many pixels takes to write to `path`, as estimated; `metered` before, and with so many AOVs."""
    if path.suffix.lower() in LINEAR:
        return STARTING + WRITING_32 * pixels * (4 + 3 * aovs)
    each = WRITING_16 if look.bits == 16 or look.view not in PLAIN or look.white else WRITING_8
    return STARTING + (each + METERING * metered) * pixels


class Strips:
    """A file written strip by strip from the top, as by `write`.

    As a context manager, it keeps the old file unless all rows have been written.
    """

    def __init__(self, path: Path, look: Look, about: Mapping[str, str | int | float], height: int, threads: int = 0) -> None:
        self.threads = threads or _cores()
        self.path, self.look, self.about, self.height = Path(path), look, about, height
        try:
            self._new = Replacement(self.path)
        except OSError as failure:
            if not failure.strerror:
                raise
            raise OSError(f"cannot write {self.path}: {failure.strerror}") from None
        self._target: Any = None
        self._png: png_stream.PngStream | None = None
        self._top = self._rows = 0
        self._codes: list[NDArray[Any]] = []  # of a JPEG

    def __enter__(self) -> Strips:
        return self

    def add(self, picture: Picture) -> None:
        """Write the next rows."""
        linear = self.path.suffix.lower() in LINEAR
        pixels = _all_channels(picture) if linear else _display(picture.channels["rgba"], self._shown_look(), self.threads)
        if self.path.suffix.lower() in JPEG:
            self._codes.append(pixels)
            self._rows += picture.height
            return
        if self.path.suffix.lower() == ".png":
            self._add_to_png(picture, pixels)
            return
        if self._target is None:
            spec = self._spec(picture, pixels, linear)
            partial = str(self._new.partial)
            self._target, self._top = oiio.ImageOutput.create(partial), spec.y
            if self._target is None or not self._target.open(partial, spec):
                raise self._failure(self._target.geterror() if self._target else oiio.geterror())
        begin = self._top + self._rows
        self._rows += picture.height
        if not self._target.write_scanlines(begin, begin + picture.height, 0, pixels):
            raise self._failure(self._target.geterror())

    def _add_to_png(self, picture: Picture, pixels: NDArray[Any]) -> None:
        try:
            if self._png is None:
                self._png = png_stream.PngStream(self._new.partial, self._template(picture, pixels), self.height, self.threads)
            self._png.add(pixels)
        except OSError as failure:
            raise self._failure(failure.strerror or str(failure)) from None
        self._rows += picture.height

    def _template(self, picture: Picture, pixels: NDArray[Any]) -> bytes:
        """A PNG of the first row with the metadata of the picture."""
        spec, partial = self._spec(picture, pixels, False), str(self._new.partial)
        spec.height = spec.full_height = 1
        target, row = oiio.ImageOutput.create(partial), np.ascontiguousarray(pixels[:1])
        if target is None or not target.open(partial, spec) or not target.write_image(row) or not target.close():
            raise OSError(target.geterror() if target else oiio.geterror())
        return self._new.partial.read_bytes()

    def _spec(self, picture: Picture, pixels: NDArray[Any], linear: bool) -> Any:
        _, width, channels = pixels.shape
        kind = {np.float32: "float", np.uint8: "uint8", np.uint16: "uint16"}[pixels.dtype.type]
        spec = oiio.ImageSpec(width, self.height, channels, kind)
        if linear:
            spec.channelnames = _all_names(picture)
            spec.attribute("compression", "zip")
            for key, value in picture.metadata.get("attributes", {}).items():
                spec.attribute(key, value)
            _place(spec, picture)
        self._add_space(spec, picture, linear)
        spec.attribute("oiio:UnassociatedAlpha", 0 if linear else 1)
        spec.attribute("Software", f"maquette {self.about.get('version', '')}".strip())
        spec.attribute("ImageDescription", as_utf8(str(self.about.get("command", ""))))
        for key, value in self.about.items():
            spec.attribute(f"{ABOUT}{key}", as_utf8(str(value)) if isinstance(value, str) or not linear else value)
        return spec

    def _add_space(self, spec: Any, picture: Picture, linear: bool) -> None:
        """Name the colour space of the file."""
        if linear:
            name, chromaticities = color_channels.file_space(picture.metadata)
            spec.attribute("oiio:ColorSpace", name)
            spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), chromaticities)
            return
        name = "srgb_rec709_scene"
        if self.look.view not in tone_curves.CURVES:
            name = color_config.opened(environment.color_config(self.look.ocio)).encoding(self.look.display, self.look.view)
        if name:
            spec.attribute("oiio:ColorSpace", name)

    def _shown_look(self) -> Look:
        return self.look if self.path.suffix.lower() in WITH_ALPHA else replace(self.look, alpha=False)

    def _write_jpeg(self) -> str:
        """Encode a JPEG in memory, then write it: why that failed, or "". libjpeg's own files end the process on a full disk."""
        from PIL import Image

        out = BytesIO()
        described = as_utf8(str(self.about.get("command", "")))
        exif = Image.Exif()
        exif[EXIF_DESCRIPTION], exif[EXIF_SOFTWARE] = described, f"maquette {self.about.get('version', '')}".strip()
        Image.fromarray(np.concatenate(self._codes)).save(out, "JPEG", quality=95, comment=described, exif=exif)
        try:
            self._new.partial.write_bytes(out.getvalue())
        except OSError as failure:
            return failure.strerror or str(failure)
        return ""

    def __exit__(self, kind: Any, *_: Any) -> None:
        closed = self._close()
        problem = ""
        if kind is None:
            if self._codes:
                problem = self._write_jpeg()
            elif closed or self._rows < self.height:
                problem = closed or "it has no pixels"
            problem = problem or damage(self._new.partial, end=True)
        failure = self._failure(problem) if problem else None
        self._new.place(self.path, kind is None and not problem)
        if failure:
            raise failure

    def _close(self) -> str:
        """Close the file; why that failed, or ""."""
        if self._png is not None:
            try:
                if self._rows == self.height:
                    self._png.close()
                return ""
            except OSError as failure:
                return failure.strerror or str(failure)
            finally:
                self._png.abandon()
        if self._target is None or self._target.close():
            return ""
        return self._target.geterror() or "it cannot be closed"

    def _failure(self, problem: str) -> OSError:
        """The error of a file that cannot be written. Libraries do not say that the disk is full: the free space does."""
        free = math.inf
        with suppress(OSError):
            disk = shutil.disk_usage(self._new.partial.parent)
            free = disk.free if disk.total else math.inf  # file systems such as /proc have no size
        reason = "the disk is full" if free < FULL else _limit_reached(self._new.partial) or " ".join(problem.split())
        return OSError(f"cannot write {self.path}: {reason}")


def _limit_reached(path: Path) -> str:
    """That a file is as large as the shell allows, "" if it is not."""
    if resource is None:
        return ""
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    with suppress(OSError):
        if limit != resource.RLIM_INFINITY and path.stat().st_size + FULL > limit:
            return f"the shell limits files to {limit >> 10} kB: raise it by ulimit -f"
    return ""


@library_messages.left_out()
def damage(path: Path, end: bool = False) -> str:
    """Why a file, or at its `end` the last row, cannot be read; "" where it can. Not every library that writes tells of a full disk."""
    source = oiio.ImageInput.open(str(path))
    if source is None:
        return f"the new file is incomplete; is the disk full? ({oiio.geterror()})"
    try:
        spec = source.spec()
        bottom = spec.y + spec.height
        if source.read_scanlines(bottom - 1 if end else spec.y, bottom, 0, 0, spec.nchannels, oiio.UNKNOWN) is None:
            return f"the new file is incomplete; is the disk full? ({source.geterror()})"
    finally:
        source.close()
    return ""


def auto_exposure(rgba: NDArray[np.floating], threads: int = 0) -> float:
    """Return the metered exposure in stops, see metering.exposure; 0 `threads`: as many as cores."""
    weights = metering.center_weights(rgba.shape[:-1])
    parts = [(rgba[top : top + ROWS], weights[top : top + ROWS]) for top in range(0, len(rgba), ROWS)]
    counts = _on_threads(lambda part: metering.count(*part), parts, threads or _cores())
    if not any(weight.any() for weight in counts):  # nothing covers the background: it alone is seen
        counts = [metering.count(rgba[..., :3], weights)]
    return metering.exposure(counts)


def views(ocio: str = "", display: str = "") -> tuple[str, ...]:
    """Return the names of views: those of tone_curves, and of a display of a configuration. Raises color_config.ConfigError."""
    return (*tone_curves.CURVES, *color_config.opened(environment.color_config(ocio)).views(display))


def _all_names(picture: Picture) -> tuple[str, ...]:
    return tuple(name for channel in _ordered(picture) for name in _names_of(channel))


def _names_of(channel: str) -> tuple[str, ...]:
    """The names of a channel in a file: a light group `light:NAME` is the layer light_NAME."""
    return CHANNEL_NAMES.get(channel) or tuple(f"light_{channel.removeprefix(LIGHT)}.{c}" for c in "RGB")


def _all_channels(picture: Picture) -> NDArray[np.float32]:
    of_file = color_channels.of_file(picture.channels, picture.metadata)
    parts = [np.asarray(of_file[channel], dtype=np.float32) for channel in _ordered(picture)]
    return np.ascontiguousarray(np.concatenate(parts, axis=2))


def _place(spec: Any, picture: Picture) -> None:
    """Set the data window to the crop, and the display window to the whole picture."""
    if "crop" in picture.metadata:
        spec.x, spec.y = picture.metadata["crop"][:2]
        spec.full_x, spec.full_y = 0, 0
        spec.full_width, spec.full_height = picture.metadata["size"]


def _ordered(picture: Picture) -> list[str]:
    channels = [channel for channel in CHANNEL_NAMES if channel in picture.channels]
    return channels + sorted(channel for channel in picture.channels if channel.startswith(LIGHT))


def display(rgba: NDArray[np.float32], look: Look) -> NDArray[Any]:
    """Convert (h, w, 4) linear light to (h, w, 3) codes, or (h, w, 4) with `look.alpha`."""
    keep = look.alpha
    is_plain = look.view in PLAIN and not look.white
    if look.bits == 8 and is_plain:
        return srgb.codes_with_alpha(rgba, look.exposure) if keep else srgb.codes(rgba[..., :3], look.exposure)
    light = np.asarray(rgba, dtype=np.float64)
    rgb, alpha = light[..., :3] * 2.0**look.exposure, np.clip(light[..., 3:4], 0.0, 1.0)
    if keep:
        rgb = rgb / np.where(alpha > 0, alpha, 1.0)
    if look.white:
        rgb = rgb @ tone_curves.white_balance(look.white).T
    shown = _viewed(rgb, look)
    if keep:
        shown = np.concatenate([shown, alpha], axis=2)
    kind, top = (np.uint8, 255) if look.bits == 8 else (np.uint16, 65535)
    return np.ascontiguousarray(np.rint(shown * top).astype(kind))


def _display(rgba: NDArray[np.float32], look: Look, threads: int) -> NDArray[Any]:
    """`display`, on several threads."""
    if look.view not in tone_curves.CURVES or len(rgba) <= ROWS:  # OpenColorIO has threads of its own
        return display(rgba, look)
    out = np.empty((*rgba.shape[:2], 4 if look.alpha else 3), np.uint8 if look.bits == 8 else np.uint16)

    def some(top: int) -> None:
        out[top : top + ROWS] = display(rgba[top : top + ROWS], look)

    _on_threads(some, range(0, len(out), ROWS), threads)
    return out


def _on_threads(function: Callable[[Any], Any], parts: Sequence[Any], threads: int) -> list[Any]:
    """function(part) of each part, in their order."""
    if threads <= 1 or len(parts) <= 1:
        return [function(part) for part in parts]
    with ThreadPoolExecutor(min(threads, len(parts))) as pool:
        return list(pool.map(function, parts))


def _cores() -> int:
    """The cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _viewed(rgb: NDArray[np.float64], look: Look) -> NDArray[np.float64]:
    if look.view in tone_curves.CURVES or rgb.size == 0:
        return tone_curves.CURVES.get(look.view, encode_srgb)(rgb)
    try:
        return color_config.opened(environment.color_config(look.ocio)).show(rgb, look.display, look.view, look.look)
    except color_config.ConfigError as fault:
        raise FormatError(fault.message) from None
