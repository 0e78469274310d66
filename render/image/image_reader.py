"""Reads pictures of any format that OpenImageIO reads as scene-linear Images."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from ...compiler.io import library_messages, picture_contents
from ...compiler.io.regular_files import is_regular
from ...lang.schema.picture_channels import LIGHT
from . import color_channels
from . import image as images
from .image_files import ABOUT, CHANNEL_NAMES, FormatError
from .srgb import decode_srgb


@library_messages.left_out()
def read(path: Path) -> images.Image:
    """Read a picture in any format of OpenImageIO, as scene-linear rgba with associated alpha (1 without an alpha channel).

    Integer files are sRGB with unassociated alpha, float files are linear, of their chromaticities. Other channels that maquette writes
    are read, too. metadata: "size" of the whole picture and "crop" in it, "bits" a channel (0 for floats), "alpha": whether it has alpha,
    "about": the texts that `write` got, and "faults": (message, hint) of all that is missing, not read, or read by a guess. Raises
    FormatError if the file is missing or not a picture.
    """
    configuration = oiio.ImageSpec()
    configuration.attribute("oiio:UnassociatedAlpha", 1)
    if not is_regular(path):
        raise FormatError(f"{path} is not an ordinary file" if os.path.exists(path) else f"there is no file {path}")
    source = oiio.ImageInput.open(str(path), configuration)
    if source is None:
        raise FormatError(f"{path} is not a picture: {picture_contents.message_of(oiio)}")
    try:
        spec = source.spec()
        pixels = source.read_image(oiio.FLOAT)
        if pixels is None:
            raise FormatError(f"{path} cannot be read: {picture_contents.message_of(source)}")
        names = picture_contents.channel_names(spec)
        channels = picture_contents.choose_channels(names, spec.alpha_channel, source.format_name())
        if all(name in names for name in "RGB"):
            channels = channels._replace(stand_in=None)
        faults = tuple(picture_contents.faults(source, channels.stand_in, [], str(path), str(path), picture_contents.READ))
    finally:
        source.close()
    return _as_image(np.asarray(pixels, dtype=np.float32).reshape(spec.height, spec.width, -1), spec, channels, faults)


def _as_image(
    pixels: NDArray[np.float32], spec: Any, chosen: picture_contents.Channels, faults: tuple[tuple[str, str], ...]
) -> images.Image:  # fmt: skip
    names = picture_contents.channel_names(spec)
    alpha_at = chosen.alpha
    if all(name in names for name in "RGB"):
        alpha_at = spec.alpha_channel if spec.alpha_channel < len(names) else alpha_at
        rgb = pixels[..., [names.index(name) for name in "RGB"]].astype(np.float64)
    else:
        inks = [pixels[..., k] for k in chosen.colors] or [np.ones(pixels.shape[:2])]
        inks = inks * 3 if len(inks) == 1 else [*inks, np.zeros(pixels.shape[:2])][:3]
        rgb = np.stack(inks, axis=2).astype(np.float64)
    alpha = pixels[..., [alpha_at]].astype(np.float64) if alpha_at >= 0 else np.ones_like(rgb[..., :1])
    integers = spec.format.basetype in (oiio.UINT8, oiio.UINT16)
    if integers:
        rgb = decode_srgb(rgb) * alpha
    channels = {"rgba": np.concatenate([rgb, alpha], axis=2).astype(np.float32)}
    for channel, parts in CHANNEL_NAMES.items():
        if channel not in channels and all(part in names for part in parts):
            channels[channel] = pixels[..., [names.index(part) for part in parts]]
    for part in names:
        if part.startswith("light_") and part.endswith(".R"):
            layer = part.removesuffix(".R")
            channels[LIGHT + layer.removeprefix("light_")] = pixels[..., [names.index(f"{layer}.{c}") for c in "RGB"]]
    if odd := color_channels.from_file(channels, None if integers else picture_contents.chromaticities(spec)):
        faults = (*faults, (f"the chromaticities of the picture {odd}", "write x and y of red, green, blue and white"))
    return images.Image(spec.width, spec.height, channels, {**_read_about(spec), "alpha": alpha_at >= 0, "faults": faults})


def _read_about(spec: Any) -> dict[str, Any]:
    x, y = spec.x - spec.full_x, spec.y - spec.full_y
    return {
        "size": (spec.full_width, spec.full_height),
        "crop": (x, y, x + spec.width, y + spec.height),
        "bits": {oiio.UINT8: 8, oiio.UINT16: 16}.get(spec.format.basetype, 0),
        "about": _texts(spec),
    }


def about(path: Path) -> dict[str, str]:
    """The texts that `write` got, of a picture whose pixels are not read; empty without some, as in a JPEG."""
    source = oiio.ImageInput.open(str(path))
    if source is None:
        return {}
    try:
        return _texts(source.spec())
    finally:
        source.close()


def _texts(spec: Any) -> dict[str, str]:
    layers = {}
    for attribute in spec.extra_attribs:
        with suppress(UnicodeDecodeError):  # of another program
            if attribute.name.startswith(ABOUT):
                layers[attribute.name.removeprefix(ABOUT)] = str(attribute.value)
    return layers
