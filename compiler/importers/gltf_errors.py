"""The error of a glTF file that cannot be read."""

from __future__ import annotations


class GltfError(Exception):
    """A glTF file that cannot be read, or an invalid part of one."""
