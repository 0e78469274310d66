"""Encodings of text files."""

from __future__ import annotations

import codecs

import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.lang import text_encoding

WIDE = ["utf-16-le", "utf-16-be", "utf-32-le", "utf-32-be"]
MARKS = dict(zip(["utf-8", *WIDE], [codecs.BOM_UTF8, codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE, codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE],
                 strict=True))  # fmt: skip


@given(st.text(st.characters(codec="utf-8", exclude_characters="\ufeff\0")), st.sampled_from(sorted(MARKS)))
def test_marked_text_is_read(text: str, encoding: str) -> None:
    data = MARKS[encoding] + text.encode(encoding)
    assert text_encoding.decode(data) == text
    assert text_encoding.decode_any(data) == text
    assert text_encoding.as_utf8(data) == text.encode()
    assert text_encoding.is_wide(data) == (encoding != "utf-8")


@pytest.mark.parametrize("encoding", ["utf-8", *WIDE])
def test_text_without_a_mark_that_begins_with_ascii_is_read(encoding: str) -> None:
    assert text_encoding.decode("v 1 2 3 # größe 大".encode(encoding)) == "v 1 2 3 # größe 大"


def test_names_in_windows_1252_are_read() -> None:
    assert text_encoding.decode_any(b"newmtl Gr\xfcn \x80") == "newmtl Grün €"
    assert text_encoding.decode_any(b"newmtl \x81\xfc") == "newmtl \x81ü"
    with pytest.raises(UnicodeDecodeError):
        text_encoding.decode(b"newmtl Gr\xfcn")


@given(st.binary())
def test_any_bytes_have_some_text(data: bytes) -> None:
    assert text_encoding.as_utf8(data).decode() is not None


@pytest.mark.parametrize("data", [b"", b"\0" * 40, b"a\0", b"\x80\0\0\0\x10\0\0\0\x20\0\0\0", b"glTF\2\0\0\0\x10\1\0\0JSON"])
def test_data_that_are_no_wide_text(data: bytes) -> None:
    assert not text_encoding.is_wide(data)
