"""XML of strangers as events: without document types, entities and deep nesting, of which nothing is fetched."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Mapping
from xml.parsers import expat

from .assembly import AssemblyError

DEEPEST = 64  # elements inside each other
Start = Callable[[str, Mapping[str, str]], None]  # of an element: {namespace}name, its attributes
End = Callable[[str], None]


def parse(data: bytes, what: str, start: Start, end: End, text: Callable[[str], None] | None = None) -> None:
    """Call `start` and `end` for each element, and `text` for what stands between.

    Raises AssemblyError, with the line, for what is not XML, has a document type or nests too deeply, and for errors of the callbacks.
    """
    parser = expat.ParserCreate(namespace_separator="}")
    depth = 0

    def opened(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            raise AssemblyError(f"its elements stand more than {DEEPEST} deep in each other")
        start(name, attributes)

    def closed(name: str) -> None:
        nonlocal depth
        depth -= 1
        end(name)

    def refuse(*_: object) -> None:
        raise AssemblyError("it has a document type, which may hold entities: these are not read")

    parser.StartElementHandler, parser.EndElementHandler = opened, closed
    parser.StartDoctypeDeclHandler = refuse
    if text is not None:
        parser.buffer_text = True
        parser.CharacterDataHandler = text
    with contextlib.suppress(AttributeError):  # of another build of expat
        parser.SetReparseDeferralEnabled(False)
    try:
        parser.Parse(data, True)
    except AssemblyError as failure:
        raise AssemblyError(f"line {parser.CurrentLineNumber} of {what}: {failure}") from None
    except expat.ExpatError as failure:
        reason = expat.errors.messages.get(failure.code, "wrong syntax")
        raise AssemblyError(f"line {failure.lineno} of {what} is not XML: {reason}") from None
    except (ValueError, LookupError, TypeError) as failure:  # of an encoding
        raise AssemblyError(f"line {parser.CurrentLineNumber} of {what} cannot be read ({type(failure).__name__})") from None


def local(name: str) -> tuple[str, str]:
    """(namespace, local name) of the name of an element or attribute."""
    space, _, tag = name.rpartition("}")
    return space, tag
