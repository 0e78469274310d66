"""Reads `.npz` files: arrays by name, without pickles, and no larger than the file."""

from __future__ import annotations

import os
import tokenize
import zipfile
import zlib
from pathlib import Path

import numpy as np

from .regular_files import ANY_SIZE, open_regular, size

_DAMAGE = (
    OSError, EOFError, ValueError, KeyError, TypeError, AttributeError, IndexError, RuntimeError, MemoryError, SyntaxError,
    zipfile.BadZipFile, zlib.error, tokenize.TokenError,
)  # fmt: skip


class ArrayFileError(Exception):
    """A file that cannot be read. The text is the reason."""


def read(path: Path | str) -> dict[str, np.ndarray]:
    """The arrays of a file that numpy.savez wrote. Raises ArrayFileError."""
    try:
        with open_regular(path, ANY_SIZE) as file:
            length = os.fstat(file.fileno()).st_size
            with zipfile.ZipFile(file) as archive:
                total = sum(entry.file_size for entry in archive.infolist())
            if total > length:  # compressed, or the same bytes several times
                raise ArrayFileError(f"its arrays take {size(total)}, and the file has {size(length)}")
            file.seek(0)
            with np.load(file, allow_pickle=False) as arrays:
                return {name: arrays[name] for name in arrays.files}
    except _DAMAGE as fault:
        reason = fault.strerror if isinstance(fault, OSError) else None
        raise ArrayFileError(reason or "it is damaged, or something else") from None
