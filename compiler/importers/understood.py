"""Name tables of file formats: each name is drawn, has no effect on a picture, or is not drawn.

A reader looks up every name that it meets. `docs/usd.md`, `docs/gltf.md` and `docs/meshes.md` are generated from these tables.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from enum import Enum


class State(Enum):
    DRAWN = "drawn"
    NO_EFFECT = "no effect"
    NOT_DRAWN = "not drawn"


class Table:
    """Names and what becomes of each. The keys of the mappings are names separated by blanks; `*` in a name matches any text."""

    def __init__(
        self, title: str, drawn: Mapping[str, str], no_effect: Mapping[str, str] | None = None, not_drawn: Mapping[str, str] | None = None,
    ) -> None:  # fmt: skip
        self.title = title
        self._rows = [
            (State(state), names, note)
            for state, rows in (("drawn", drawn), ("no effect", no_effect or {}), ("not drawn", not_drawn or {}))
            for names, note in rows.items()
        ]
        self._exact: dict[str, tuple[State, str]] = {}
        self._patterns: list[tuple[re.Pattern[str], tuple[State, str]]] = []
        for state, names, note in self._rows:
            for name in names.split():
                if "*" in name:
                    self._patterns.append((re.compile(re.escape(name).replace(r"\*", ".*")), (state, note)))
                elif name in self._exact:
                    raise ValueError(f"{title}: {name} has two rows")
                else:
                    self._exact[name] = (state, note)

    def __iter__(self) -> Iterator[tuple[State, str, str]]:
        """(state, names, note) of each row."""
        return iter(self._rows)

    def find(self, *names: str) -> tuple[State, str] | None:
        """(state, note) of the first of `names` that is in the table; None for unknown ones. Exact names precede patterns."""
        for name in names:
            if name in self._exact:
                return self._exact[name]
        return next((entry for name in names for pattern, entry in self._patterns if pattern.fullmatch(name)), None)

    def report(self, shown: str, *names: str) -> str:
        """The warning for a name, given in the order of `find`; "" if it is drawn or has no effect. `shown` is its form in the message."""
        entry = self.find(*names)
        if entry is None:
            return f"{shown} is not known: it is not drawn"
        state, note = entry
        return "" if state != State.NOT_DRAWN else f"{shown} is not drawn{f': {note}' if note else ''}"

    def names(self, state: State | None = None) -> set[str]:
        """The exact names of the table, of one state or all."""
        return {name for name, (entry_state, _) in self._exact.items() if state in (None, entry_state)}
