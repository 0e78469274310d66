"""Decoder of pictures in KTX 2 with Basis Universal's codecs, ETC1S and UASTC, as glTF's KHR_texture_basisu has them.

The package opengl_basisu (extra `basisu`) contains Binomial's transcoder; only this module loads it. Format: KTX 2.0 (Khronos).
"""

from __future__ import annotations

import importlib.util
import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....lang.distribution import install_command
from ....lang.input_error import InputError

IDENTIFIER = b"\xabKTX 20\xbb\r\n\x1a\n"
_VALUES_AT = 56  # of the header: offset and length of the key/value data
_ORIENTATION = b"KTXorientation\0"


class Pixels(NamedTuple):
    """A decoded picture."""

    texels: NDArray[np.uint8]
    """(h, w, 4) red, green, blue and unassociated alpha, from the top."""
    is_srgb: bool
    """Whether the file says that its colours are encoded as sRGB."""
    others: int
    """Number of further layers and faces."""


def missing() -> str:
    """How to install what reads such pictures; "" if it is there."""
    if importlib.util.find_spec("opengl_basisu") is None:
        return f"the package opengl_basisu reads pictures in KTX 2 ({install_command('basisu')})"
    return ""


def decode(data: bytes, name: str, limit: int) -> Pixels:
    """The largest level of the first picture of a file, of at most `limit` pixels. Raises InputError."""
    if reason := missing():
        raise InputError(f"the picture `{name}` is left out: {reason}")
    import opengl_basisu  # pyright: ignore[reportMissingImports]

    try:
        texture = opengl_basisu.open(data)
    except opengl_basisu.UnsupportedError as failure:
        raise InputError(f"the picture `{name}` has no codec of Basis Universal: {str(failure)[:100]}", "write it as PNG") from None
    except ValueError as failure:
        raise InputError(f"the picture `{name}` is damaged", str(failure)[:100]) from None
    if texture.width * texture.height > limit:
        raise InputError(f"the picture `{name}` is too big: {texture.width} by {texture.height} pixels", f"at most {limit:,}")
    try:
        texels = np.asarray(texture.transcode("rgba8").data)
    except opengl_basisu.UnsupportedError:
        raise InputError(f"the picture `{name}` has a high dynamic range in KTX 2, which is not read", "write it as EXR") from None
    except (ValueError, IndexError) as failure:
        raise InputError(f"the picture `{name}` is damaged", str(failure)[:100]) from None
    right, down = _orientation(data)
    texels = texels[:: 1 if down else -1, :: 1 if right else -1]
    return Pixels(np.ascontiguousarray(texels, np.uint8), bool(texture.srgb), texture.faces * texture.layers - 1)


def _orientation(data: bytes) -> tuple[bool, bool]:
    """Whether columns go to the right and rows down: KTXorientation, `rd` by default."""
    first, length = struct.unpack_from("<II", data, _VALUES_AT)
    values = data[first : first + length]
    at = values.find(_ORIENTATION)
    written = values[at + len(_ORIENTATION) :][:2] if at >= 0 else b"rd"
    return written[:1] != b"l", written[1:2] != b"u"
