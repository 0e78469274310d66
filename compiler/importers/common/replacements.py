"""Materials of a scene in place of those of a file that it places, by the names that the file gives them."""

from __future__ import annotations

from dataclasses import dataclass, field
from fnmatch import fnmatchcase

from ....lang.diagnostics import suggest

NONE = -1
_MOST = 12  # names that a message lists


@dataclass(slots=True)
class Replacements:
    """Rows of materials by names, in which * and ? match any text and any character."""

    named: tuple[tuple[str, int], ...] = ()
    every: int = NONE  # in place of the file's other materials
    _met: dict[str, None] = field(default_factory=dict)  # names of the file
    _used: set[str] = field(default_factory=set)

    def row(self, *names: str) -> int:
        """The row in place of a material that has these names, the first being shown in messages; NONE to keep it.

        Without a name it is that of all others.
        """
        if names:
            self._met.setdefault(names[0])
        chosen = [(pattern, row) for pattern, row in self.named if any(name == pattern or fnmatchcase(name, pattern) for name in names)]
        self._used.update(pattern for pattern, _ in chosen)
        exact = [row for pattern, row in chosen if pattern in names]
        return (exact or [row for _, row in chosen] or [self.every])[0]

    def unused(self) -> list[tuple[str, str]]:
        """(message, hint) for each name that the file does not have."""
        met = [name for name in self._met if name]
        more = f" and {len(met) - _MOST} more" if len(met) > _MOST else ""
        listed = f"it has {', '.join(f'`{name}`' for name in met[:_MOST])}{more}" if met else "it names none: write material: for all of it"
        return [
            (f"the file has no material `{pattern}`", suggest(pattern, met) or listed)
            for pattern, _ in self.named
            if pattern not in self._used
        ]
