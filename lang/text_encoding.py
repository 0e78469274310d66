"""The encodings of text files: UTF-8, UTF-16 and UTF-32, with and without a byte order mark, and Windows-1252 in their place."""

from __future__ import annotations

import codecs

_MARKS = (  # that of UTF-32 LE begins with that of UTF-16 LE
    (codecs.BOM_UTF8, "utf-8"), (codecs.BOM_UTF32_LE, "utf-32-le"), (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"), (codecs.BOM_UTF16_BE, "utf-16-be"),
)  # fmt: skip
_UNMARKED = {(True, False, False, False): "utf-32-le", (False, False, False, True): "utf-32-be",
             (True, False, True, False): "utf-16-le", (False, True, False, True): "utf-16-be"}  # fmt: skip
_ASCII = frozenset((9, 10, 13, *range(32, 127)))
_SAMPLE = 16  # bytes at the beginning of an unmarked file that show its encoding


def encoding_of(data: bytes) -> tuple[str, int]:
    """The encoding of text, and the length of its byte order mark: of UTF-8 where the data show no other.

    A file without a mark is of UTF-16 or UTF-32 if its first characters are ASCII in that encoding.
    """
    mark, marked = next(((mark, name) for mark, name in _MARKS if data.startswith(mark)), (b"", "utf-8"))
    if mark or len(data) < 8:
        return marked, len(mark)
    sample = data[: min(len(data) // 4 * 4, _SAMPLE)]
    filled = tuple(any(sample[k::4]) for k in range(4))
    is_ascii = all(_ASCII.issuperset(sample[k::4]) for k in range(4) if filled[k])
    return (_UNMARKED.get(filled, "utf-8") if is_ascii else "utf-8"), 0  # type: ignore[arg-type]


def decode(data: bytes) -> str:
    """Text without its byte order mark. Line ends stay. Raises UnicodeDecodeError."""
    encoding, mark = encoding_of(data)
    return data[mark:].decode(encoding)


def decode_any(data: bytes) -> str:
    """As `decode`; data that are not text of Unicode are read as Windows-1252, in which older programs write names."""
    encoding, mark = encoding_of(data)
    try:
        return data[mark:].decode(encoding)
    except UnicodeDecodeError:
        pass
    if encoding != "utf-8":
        return data[mark:].decode(encoding, errors="replace")
    try:
        return data[mark:].decode("cp1252")
    except UnicodeDecodeError:  # five of its bytes are not characters
        return data[mark:].decode("latin-1")


def as_utf8(data: bytes) -> bytes:
    """The bytes of text in UTF-8, without a byte order mark; see `decode_any`. Text of ASCII is returned as it is."""
    if data.isascii() and b"\0" not in data:
        return data
    return decode_any(data).encode("utf-8", errors="replace")


def is_wide(data: bytes) -> bool:
    """Whether data begin as text in UTF-16 or UTF-32."""
    return encoding_of(data)[0] != "utf-8"
