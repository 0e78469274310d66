"""Opens paths none of whose parts is a link: what a stranger's folder holds cannot lead elsewhere, also while it is changed."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path


class LinkError(OSError):
    """A path leads over a link. The text is a full sentence."""


def open_path(path: Path | str) -> int:
    """A descriptor (O_PATH) of a file or folder. Each part of the path is opened in the folder before it, and is not a link.

    Raises LinkError for a link, and OSError for what is missing.
    """
    text = os.fspath(path)
    descriptor = os.open("/" if text.startswith("/") else ".", os.O_PATH | os.O_DIRECTORY | os.O_CLOEXEC)
    parts = [part for part in text.split("/") if part not in ("", ".")]
    for count, part in enumerate(parts, 1):
        try:
            inner = os.open(part, os.O_PATH | os.O_NOFOLLOW | os.O_CLOEXEC, dir_fd=descriptor)
        except OSError as fault:
            raise OSError(fault.errno, fault.strerror, text) from None
        finally:
            os.close(descriptor)
        descriptor = inner
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISLNK(mode) or (count < len(parts) and not stat.S_ISDIR(mode)):
            os.close(descriptor)
            if not stat.S_ISLNK(mode):
                raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), text)
            link = "/" * text.startswith("/") + "/".join(parts[:count])
            raise LinkError(f"{link if link == text else f'{link}, in {text},'} is a link: give the name of its target")
    return descriptor
