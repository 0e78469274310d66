"""Decodes KHR_draco_mesh_compression: meshes of glTF files compressed by Draco.

The package DracoPy (extra `draco`) contains Google's library; only this module loads it.
"""

from __future__ import annotations

import importlib.util
from typing import Any

import numpy as np

from ...lang.distribution import install_command
from .gltf_container import Container
from .gltf_errors import GltfError

EXTENSION = "KHR_draco_mesh_compression"


def missing() -> str:
    """Why compressed meshes cannot be read; "" if they can."""
    if importlib.util.find_spec("DracoPy") is None:
        return f"meshes compressed by Draco are left out: the package DracoPy reads them ({install_command('draco')})"
    return ""


def decode(container: Container, primitive: dict[str, Any]) -> None:
    """Decode a compressed primitive; its accessors have the decoded values from then on. Raises GltfError.

    The identifiers of the extension's attributes are Draco's unique ones. An accessor without a buffer view describes the type and
    whether integers are normalized.
    """
    import DracoPy  # pyright: ignore[reportMissingImports]

    extension = primitive["extensions"][EXTENSION]
    try:
        decoded = DracoPy.decode(container.view_bytes(extension["bufferView"]))
    except Exception as failure:  # the library raises its own classes, and RuntimeError for damaged data
        raise GltfError(f"a mesh compressed by Draco is damaged ({str(failure)[:100] or type(failure).__name__})") from None
    values = {int(each["unique_id"]): each["data"] for each in decoded.attributes}
    for name, identifier in extension["attributes"].items():
        if int(identifier) in values and name in primitive["attributes"]:
            data = np.asarray(values[int(identifier)])
            container.decoded[int(primitive["attributes"][name])] = data.reshape(len(data), -1)
    faces = getattr(decoded, "faces", None)
    if faces is not None and "indices" in primitive:
        container.decoded[int(primitive["indices"])] = np.asarray(faces).reshape(-1, 1)
