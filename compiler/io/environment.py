"""Environment variables that choose how maquette works; docs/environment.md lists them."""

from __future__ import annotations

import os
from collections.abc import Sequence


class SettingError(ValueError):
    """An environment variable has a value that it cannot have."""


def read_choice(name: str, choices: Sequence[str]) -> str:
    """The value of a variable, by default the first of `choices`. Raises SettingError for other values."""
    value = os.environ.get(name) or choices[0]
    if value not in choices:
        raise SettingError(f"{name} is {value}; it can be {', '.join(choices)}")
    return value
