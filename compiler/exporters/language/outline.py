"""The objects of a scene as nested groups by their names, and copies as loops."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

from . import words
from .places import Place

DEEPEST = 12  # groups in each other
FEWEST = 4  # copies that are a loop
_ROUND = ("translate", "rotate", "scale")


_COPY = re.compile(r"\[\d+\]$")
_LONGEST = 200  # characters of a name


def written_name(name: str) -> tuple[str, bool]:
    """The name that an instance has in the written scene, and whether it is a copy, whose number is left out."""
    plain = _COPY.sub("", name.strip("/"))
    return "/".join(part for part in plain[:_LONGEST].split("/") if part), plain != name.strip("/")


class Item(NamedTuple):
    """One object: the path of its name, the call of its shape, its place, its material and medium; or a text of its own."""

    path: tuple[str, ...]
    call: str
    place: Place
    material: str | None = None
    medium: str | None = None
    text: str = ""
    copy: bool = False  # whether its name has a number that is of no account

    @property
    def kind(self) -> tuple[object, ...]:
        """Equal for items that differ by their place alone."""
        return self.call, self.material, self.medium, self.text, tuple(self.place.arguments), bool(self.place.matrix)


def statements(items: Sequence[Item]) -> Iterator[str]:
    """The statements of objects, in their order."""
    yield from _level(items, 0)


def _level(items: Sequence[Item], depth: int) -> Iterator[str]:
    for head, run in groupby(items, lambda item: item.path[0] if len(item.path) > 1 and depth < DEEPEST else None):
        members = list(run)
        if head is None:
            yield from _loops(members)
            continue
        names, inner = [head], [item._replace(path=item.path[1:]) for item in members]
        while len({item.path[0] for item in inner}) == 1 and all(len(item.path) > 1 for item in inner):
            names.append(inner[0].path[0])
            inner = [item._replace(path=item.path[1:]) for item in inner]
        if len(inner) == 1:
            yield _single(inner[0]._replace(path=("/".join((*names, *inner[0].path)),)))
            continue
        yield _block(words.call("group", name=words.string("/".join(names))), _level(inner, depth + 1))


def _block(head: str, inner: Iterator[str]) -> str:
    return "\n".join([f"{head} {{", *inner, "}"])


def _loops(items: Sequence[Item]) -> Iterator[str]:
    for (_, is_copy, _), run in groupby(items, lambda item: (item.kind, item.copy, _stem(item))):
        members = list(run)
        if is_copy and len(members) >= FEWEST and not members[0].text:
            yield _loop(members)
        else:
            yield from map(_single, members)


def _stem(item: Item) -> str:
    return "/".join(item.path) if item.copy else ""


def _loop(members: Sequence[Item]) -> str:
    """A loop over the places of copies; arguments that all share stand in it."""
    first = members[0]
    if first.place.matrix:
        rows = ",\n".join(member.place.matrix for member in members)
        return f"for (frame in [\n{rows},\n]) {{\n{_placed(first, matrix='frame')}\n}}"
    varying = [name for name in _ROUND if len({member.place.arguments.get(name) for member in members}) > 1]
    if not varying:
        return "\n".join(map(_single, members))
    if len(varying) == 1:
        rows = ",\n".join(member.place.arguments[varying[0]] for member in members)
        shared = first._replace(place=Place({**first.place.arguments, varying[0]: "at"}))
    else:
        rows = ",\n".join(f"[{', '.join(member.place.arguments[name] for name in varying)}]" for member in members)
        shared = first._replace(place=Place({**first.place.arguments, **{name: f"at[{k}]" for k, name in enumerate(varying)}}))
    return f"for (at in [\n{rows},\n]) {{\n{_placed(shared)}\n}}"


def _single(item: Item) -> str:
    return item.text or _placed(item)


def _placed(item: Item, matrix: str = "") -> str:
    """The call of an item with its name, place, material and medium."""
    name = "/".join(item.path)
    arguments = {"name": words.string(name)} if name not in ("", item.call.partition("(")[0]) else {}
    arguments |= item.place.arguments
    arguments |= {"material": item.material} if item.material else {}
    arguments |= {"medium": item.medium} if item.medium else {}
    matrix = matrix or item.place.matrix
    if matrix:
        named = {name: text for name, text in arguments.items() if name == "name"}
        inner = {name: text for name, text in arguments.items() if name != "name"}
        return f"{words.call('transform', matrix, **named)} {{\n{_with(item.call, inner)}\n}}"
    return _with(item.call, arguments)


def _with(call: str, arguments: dict[str, str]) -> str:
    """A call with more arguments."""
    if not arguments:
        return call
    added = ", ".join(f"{name}: {text}" for name, text in arguments.items())
    if call.endswith("\n)"):
        return f"{call[:-2]}\n{added},\n)"
    inside = call[:-1]
    return f"{inside}{added})" if inside.endswith("(") else f"{inside}, {added})"
