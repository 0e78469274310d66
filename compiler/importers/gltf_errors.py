"""The error of a glTF file that cannot be read."""

from __future__ import annotations

from .common.mesh_parts import MeshFileError


class GltfError(MeshFileError):
    """A glTF file that cannot be read, or an invalid part of one."""
