"""glTF at a time: animations of nodes (§3.11), skins (§3.7.3) and morph targets (§3.7.2.2)."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..mesh import skinning
from ..mesh.polygon_mesh import PolyMesh
from .gltf_container import Container, Rows, Warn
from .gltf_errors import GltfError

_PATHS = ("translation", "rotation", "scale", "weights")


def names(container: Container) -> list[str]:
    """The names of the animations; those without one, or with that of an earlier one, have their number, from 0."""
    labels: list[str] = []
    for number, animation in enumerate(container.document.get("animations") or ()):
        name = animation.get("name")
        labels.append(name if isinstance(name, str) and name and name not in labels else str(number))
    return labels


def chosen(container: Container, name: str | None) -> dict[str, Any] | None:
    """The animation of a name or number, by default the first; None without any. Raises GltfError for one that is not there."""
    animations, labels = container.document.get("animations") or [], names(container)
    if name is None:
        return animations[0] if animations else None
    if name in labels:
        return animations[labels.index(name)]
    if name.isascii() and name.isdecimal() and len(name) < 10 and int(name) < len(animations):
        return animations[int(name)]
    if not animations:
        raise GltfError(f"there is no animation `{name}`: the glTF file has none")
    near = difflib.get_close_matches(name, labels, 1)
    listed = ", ".join(f"`{label}`" for label in labels[:20]) + (", …" if len(labels) > 20 else "")
    raise GltfError(f"there is no animation `{name}`: the glTF file has {listed}" + (f"; did you mean `{near[0]}`?" if near else ""))


def unused(container: Container, length: float, as_scene: bool) -> str:
    """The message of a picture without a time of a file with animations, whose first has a `length` in seconds."""
    labels = names(container)
    if not as_scene:
        return f"the file has {len(labels)} animation{'s' * (len(labels) > 1)}: a mesh in a scene stands as its file places it"
    if len(labels) == 1:
        return f"the file has an animation of {length:.4g} s: --time 0s draws its first moment, --frames all its pictures"
    listed = ", ".join(f"`{name}`" for name in labels[:6]) + (", …" if len(labels) > 6 else "")
    first = f"--time draws a moment of the first, of {length:.4g} s, --frames all its pictures"
    return f"the file has {len(labels)} animations ({listed}): {first}, and --animation takes another"


def animated(container: Container, animation: dict[str, Any], time: float, warn: Warn) -> list[dict[str, Any]]:
    """The document's nodes with the values of an animation at `time` seconds."""
    nodes = Rows(dict(node) for node in container.document.get("nodes", ()))
    for channel in animation.get("channels", ()):
        target, path = channel["target"], channel["target"].get("path")
        if "node" not in target:
            continue
        if path not in _PATHS:
            warn(f"the animation of `{str(path)[:40]}` is not drawn")
            continue
        value = _sampled(container, animation["samplers"][channel["sampler"]], time, path)
        if value is not None:
            node = nodes[target["node"]]
            node[path] = value.reshape(-1).tolist()
            if path != "weights":
                node.pop("matrix", None)
    return nodes


def duration(container: Container, animation: dict[str, Any]) -> float:
    """Seconds until the last key of an animation."""
    keys = [container.accessor(sampler["input"]) for sampler in animation.get("samplers", ())]
    return max((float(times[-1, 0]) for times in keys if len(times)), default=0.0)


def _sampled(container: Container, sampler: dict[str, Any], time: float, path: str) -> np.ndarray | None:
    """The value of a sampler at a time, clamped to its first and last key: STEP, LINEAR or CUBICSPLINE (appendix C)."""
    times = container.accessor(sampler["input"])[:, 0].astype(np.float64)
    values = container.accessor(sampler["output"]).astype(np.float64)
    if not len(times):
        return None
    mode = sampler.get("interpolation", "LINEAR")
    cubic = mode == "CUBICSPLINE"
    each = len(values) // (len(times) * (3 if cubic else 1))
    if each == 0:
        raise GltfError("an animation of the glTF file has fewer values than times")
    values = values[: len(times) * each * (3 if cubic else 1)].reshape(len(times), 3 if cubic else 1, each, -1)
    keys = values[:, 1 if cubic else 0]
    k = int(np.clip(np.searchsorted(times, time, side="right") - 1, 0, len(times) - 1))
    if time <= times[0] or k == len(times) - 1 or mode == "STEP":
        return keys[k]
    step = times[k + 1] - times[k]
    t = (time - times[k]) / step
    if cubic:
        out, arriving = values[k, 2] * step, values[k + 1, 0] * step
        value = (
            (2 * t**3 - 3 * t**2 + 1) * keys[k] + (t**3 - 2 * t**2 + t) * out
            + (3 * t**2 - 2 * t**3) * keys[k + 1] + (t**3 - t**2) * arriving
        )  # fmt: skip
        return value / np.linalg.norm(value) if path == "rotation" else value
    return _slerp(keys[k], keys[k + 1], t) if path == "rotation" else (1 - t) * keys[k] + t * keys[k + 1]


def _slerp(a: np.ndarray, b: np.ndarray, t: float) -> np.ndarray:
    cosine = float((a * b).sum())
    if cosine < 0:
        b, cosine = -b, -cosine
    angle = float(np.arccos(min(cosine, 1.0)))
    if angle < 1e-6:
        return (1 - t) * a + t * b
    return (np.sin((1 - t) * angle) * a + np.sin(t * angle) * b) / np.sin(angle)


def morphed(container: Container, primitive: dict[str, Any], name: str, weights: tuple[float, ...]) -> np.ndarray:
    """An attribute of a primitive with its morph targets added at their weights."""
    values = container.accessor(primitive["attributes"][name])
    for target, weight in zip(primitive.get("targets", ()), weights, strict=False):
        if weight and name in target:
            moved = container.accessor(target[name])
            if moved.shape != values.shape:
                raise GltfError(f"a morph target of the glTF file has {len(moved)} values where {len(values)} belong")
            values = values + weight * moved.astype(np.float64)
    return values


@dataclass(frozen=True, slots=True, eq=False)
class Skin:
    """The matrices (j, 4, 4) of a skin's joints, from the bound mesh to world."""

    joints: np.ndarray

    @staticmethod
    def from_node(container: Container, node: Mapping[str, Any], nodes: Mapping[int, np.ndarray]) -> Skin:
        """The skin of a node; `nodes` are the world matrices of the scene's nodes."""
        skin = container.document["skins"][node["skin"]]
        world = np.array([nodes.get(joint, np.eye(4)) for joint in skin["joints"]])
        if "inverseBindMatrices" not in skin:
            return Skin(world)
        bound = container.accessor(skin["inverseBindMatrices"]).astype(np.float64).reshape(-1, 4, 4).transpose(0, 2, 1)
        if len(bound) < len(world):
            raise GltfError(f"a skin of the glTF file has {len(world)} joints and {len(bound)} inverse bind matrices")
        return Skin(world @ bound[: len(world)])

    def deform(self, mesh: PolyMesh, container: Container, attributes: Mapping[str, int], warn: Warn) -> PolyMesh:
        """The mesh in world, its points and normals moved by up to eight joints each."""
        pairs = [(f"JOINTS_{k}", f"WEIGHTS_{k}") for k in range(2) if f"JOINTS_{k}" in attributes and f"WEIGHTS_{k}" in attributes]
        if not pairs:
            warn("a mesh with a skin has no joints and weights: it is drawn undeformed")
            return mesh
        joints = np.concatenate([container.accessor(attributes[a]) for a, _ in pairs], axis=1).astype(np.int64)
        weights = np.concatenate([container.accessor(attributes[b]) for _, b in pairs], axis=1).astype(np.float64)
        if len(joints) != len(mesh.points) or len(weights) != len(mesh.points) or joints.max(initial=0) >= len(self.joints):
            raise GltfError("the joints of the glTF file's skin do not fit its mesh")
        total = weights.sum(axis=1, keepdims=True)
        weights = weights / np.where(total > 0, total, 1.0)
        moved = skinning.deformed_normals(mesh, self.joints, joints, weights)
        return replace(moved, points=skinning.deformed_points(np.asarray(mesh.points), self.joints, joints, weights))
