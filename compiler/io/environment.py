"""Environment variables that choose how maquette works; docs/environment.md lists them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

BUILT_IN = "ocio://"  # configurations of OpenColorIO inside of the library
DEFAULT = "ocio://default"


class SettingError(ValueError):
    """An environment variable has a value that it cannot have."""


def color_config(name: str | None = None) -> str:
    """The configuration of OpenColorIO that a setting names; without one that of the variable OCIO, or the library's default."""
    return name or os.environ.get("OCIO") or DEFAULT


def has_color_config() -> bool:
    """Whether the variable OCIO names a configuration."""
    return bool(os.environ.get("OCIO"))


def color_config_folder(name: str | None) -> Path | None:
    """The folder whose files a configuration reads; None for those of the library, which read none."""
    config = color_config(name)
    return None if config.startswith(BUILT_IN) else Path(config).absolute().parent


def read_choice(name: str, choices: Sequence[str]) -> str:
    """The value of a variable, by default the first of `choices`. Raises SettingError for other values."""
    value = os.environ.get(name) or choices[0]
    if value not in choices:
        raise SettingError(f"{name} is {value}; it can be {', '.join(choices)}")
    return value
