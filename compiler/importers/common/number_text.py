"""Commas between and in the numbers of text formats, whose numbers have points and blanks.

A program that formats numbers by the language of its user writes `1,5` for 1.5, as in German and French. Others write `1.5, 2.0`.
"""

from __future__ import annotations

import re
from typing import NamedTuple

DECIMAL = "the numbers have decimal commas: they are read as points"
SEPARATORS = "commas or semicolons separate the numbers: they are read as blanks"
_AT_WORD_END = re.compile(rb"(?:(?<=\s)|^)[,;]+|[,;]+(?=\s|$)")
_DECIMAL = rb"[+-]?\d+,\d+(?:[eE][+-]?\d+)?"
_SEPARATED = re.compile(rb"(?<!\S)(?!" + _DECIMAL + rb"(?!\S))[^\s,;]*[,;]\S*")
_BLANKS = bytes.maketrans(b",;", b"  ")


class Numbers(NamedTuple):
    """Text of numbers with points and blanks alone; offsets are those of the text that was read."""

    text: bytes
    warning: str = ""  # DECIMAL, SEPARATORS or none
    first: int = -1  # the offset of the first comma or semicolon


def has_commas(text: bytes) -> bool:
    """Whether text has commas or semicolons."""
    return b"," in text or b";" in text


def plain(text: bytes, decimal: bool = True) -> Numbers:
    """The text with its commas read: all as decimal marks where each word has one of them between digits, else as separators.

    Those at the end of a word are separators. Without `decimal` all are.
    """
    if not has_commas(text):
        return Numbers(text)
    first = min(place for place in (text.find(b","), text.find(b";")) if place >= 0)
    inner = _AT_WORD_END.sub(lambda match: b" " * len(match[0]), text)
    if not has_commas(inner) or not decimal or _SEPARATED.search(inner):
        return Numbers(text.translate(_BLANKS), SEPARATORS, first)
    return Numbers(inner.replace(b",", b"."), DECIMAL, first)
