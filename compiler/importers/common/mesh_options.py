"""Options for mesh files and generated meshes."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class MeshOptions:
    """How mesh files are read, and how fine generated meshes are. None: as the file says, else the default."""

    unit: str | None = None  # key of file_types.UNITS: what 1 is in a file
    up: str | None = None  # one of file_types.AXES: the axis of a file that points up
    animation: str | None = None  # name or number of an animation of a file
    repair: bool | None = None  # merge vertices, wind faces one way and outwards, fill holes
    deviation: float | None = None  # metres: greatest distance of generated triangles from the true surface

    def option_names(self) -> list[str]:
        """Names on the command line of the options about files that are not at their default."""
        return [name for name in ("unit", "up", "animation", "repair") if getattr(self, name) is not None]

    def words(self) -> list[str]:
        """The same options as words of a command line."""
        values = {name: getattr(self, name) for name in self.option_names()}
        return [word for name, value in values.items() for word in ((f"--{name}",) if value is True else (f"--{name}", str(value)))]
