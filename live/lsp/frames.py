"""Reader of message headers of the Language Server Protocol: it logs a malformed header and continues with the next message."""

from __future__ import annotations

import logging
import re
from typing import BinaryIO

MAX_LENGTH = 1 << 28  # bytes of a message
_LENGTH = re.compile(rb"Content-Length:[ \t]*(\d{1,12})[ \t]*\r?\n\Z", re.IGNORECASE)
_ANY_LENGTH = re.compile(rb"Content-Length:", re.IGNORECASE)
_TYPE = re.compile(rb"Content-Type:[^\r\n]*\r?\n\Z", re.IGNORECASE)
_logger = logging.getLogger(__name__)


class Frames:
    """The input stream of pygls, which takes header lines by `readline` and messages by `read`; `stream` comes from the editor.

    JSON needs no line break at its end. So a message whose header is malformed ends in the line of the next header, and `readline`
    returns that header alone. Malformed headers are logged to stderr.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream

    def readline(self) -> bytes:
        """The next line of a header, written as pygls reads it; b"" at the end."""
        line = self._stream.readline()
        match = _LENGTH.search(line)
        if match is not None and int(match[1]) <= MAX_LENGTH:
            if match.start():
                _logger.error("%d bytes without a header are skipped", match.start())
            return b"Content-Length: %d\r\n" % int(match[1])
        if not line.strip() or _TYPE.match(line):
            return line if not line or line.strip() else b"\r\n"
        if _ANY_LENGTH.match(line):
            _logger.error("a length is a whole number up to %d: %r is skipped with its message", MAX_LENGTH, line[:80])
        else:
            _logger.error("%r is not a header: it is skipped", line[:80])
        return b"Skipped:\r\n"  # which pygls passes over

    def read(self, size: int) -> bytes:
        """The bytes of a message."""
        return self._stream.read(size)
