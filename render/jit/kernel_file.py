"""Files of compiled code: a digest, a header in JSON, and object code. A file that does not fit its digest counts as missing."""

from __future__ import annotations

import hashlib
import json
import struct
from typing import NamedTuple

from . import value_types
from .value_types import ValueType

_MAGIC = b"maquette kernel 2\n"
_DIGEST = 16  # bytes
_SIZE = struct.Struct("<I")


class Code(NamedTuple):
    """Object code of a kernel, or of a helper that kernels call."""

    entry: str  # symbol of the function that Python calls; "" of a helper
    function: str  # symbol of the function that other kernels call
    result: ValueType
    needs: tuple[str, ...]  # symbols that other code defines
    code: bytes
    helpers: tuple[str, ...] = ()  # names of the files of separate helpers that it calls


def packed(name: str, code: Code) -> bytes:
    """The content of the file of a name."""
    header = {
        "name": name, "entry": code.entry, "function": code.function, "result": code.result.plain, "needs": code.needs,
        "helpers": code.helpers,
    }  # fmt: skip
    text = json.dumps(header, separators=(",", ":")).encode()
    body = _SIZE.pack(len(text)) + text + code.code
    return _MAGIC + _digest(body) + body


def unpacked(name: str, data: bytes) -> Code | None:
    """The code in the content of a file; None where it is damaged, of another format, or another file's."""
    start = len(_MAGIC) + _DIGEST
    if not data.startswith(_MAGIC) or _digest(data[start:]) != data[len(_MAGIC) : start]:
        return None
    try:
        (size,) = _SIZE.unpack_from(data, start)
        start += _SIZE.size
        header = json.loads(data[start : start + size])
        if header["name"] != name:
            return None
        result = value_types.from_plain(header["result"])
        return Code(header["entry"], header["function"], result, tuple(header["needs"]), data[start + size :], tuple(header["helpers"]))
    except (ValueError, LookupError, TypeError, AttributeError, ImportError, struct.error):
        return None


def _digest(data: bytes) -> bytes:
    return hashlib.blake2b(data, digest_size=_DIGEST).digest()
