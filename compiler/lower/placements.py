"""Frames of placed elements, and shapes that wait for their transforms, which are computed together."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...lang.diagnostics import Span
from ...lang.elements import Element
from ..scene import transforms
from ..scene.builder import SceneBuilder

Frame = tuple[float, float, float] | np.ndarray
"""A translation, or a (4, 4) matrix. Translations compose by sums, with the bits that products of their matrices have."""
ORIGIN: Frame = (0.0, 0.0, 0.0)


def own_frame(element: Element) -> Frame:
    """The frame of the arguments `translate`, `rotate` and `scale`."""
    args = element.args
    if args["rotate"] is None and args["scale"] is None:
        return args["translate"] or ORIGIN
    return transforms.place(args["translate"], args["rotate"], args["scale"])


def rotation_of(element: Element) -> np.ndarray | None:
    """The (4, 4) matrix of the argument `rotate`; None without it."""
    return None if element.args["rotate"] is None else transforms.rotation(element.args["rotate"])


def compose(outer: Frame, inner: Frame) -> Frame:
    """The frame `inner` within `outer`."""
    if inner is ORIGIN:
        return outer
    if type(outer) is tuple and type(inner) is tuple:
        return (outer[0] + inner[0], outer[1] + inner[1], outer[2] + inner[2])
    return matrix(outer) @ matrix(inner)


def matrix(frame: Frame) -> np.ndarray:
    """The (4, 4) matrix of a frame."""
    return transforms.translation(frame) if type(frame) is tuple else frame  # type: ignore[return-value]


class Placements:
    """Instances of geometries in the order placed. `flush` adds them to the builder."""

    def __init__(self, builder: SceneBuilder) -> None:
        self._builder = builder
        self._waiting: list[tuple[Frame, Frame, int, int, str, Span, Span]] = []

    def add(self, outer: Frame, inner: Frame, geometry: int, material: int, name: str, span: Span, call: Span) -> None:
        """Add an instance of a geometry with the frame `inner` within `outer`; `call` is the outermost call that makes it."""
        self._waiting.append((outer, inner, geometry, material, name, span, call))

    def flush(self) -> None:
        """Add the waiting instances to the builder. Call it before anything else adds transforms or instances."""
        if self._waiting:
            outer, inner, geometries, materials, names, spans, calls = zip(*self._waiting, strict=True)
            self._waiting = []
            rows = self._builder.transforms(products(outer, inner), spans)
            self._builder.instances(geometries, rows, materials, names, spans, calls)


def products(outer: Sequence[Frame], inner: Sequence[Frame]) -> np.ndarray:
    """(n, 3, 4) products of frames."""
    turned = [k for k, (a, b) in enumerate(zip(outer, inner, strict=True)) if type(a) is not tuple or type(b) is not tuple]
    products = _stacked([outer[k] for k in turned]) @ _stacked([inner[k] for k in turned])
    if len(turned) == len(outer):
        return products[:, :3]
    moved = sorted(set(range(len(outer))).difference(turned))
    composed = np.zeros((len(outer), 3, 4))
    composed[:, (0, 1, 2), (0, 1, 2)] = 1.0
    composed[moved, :, 3] = np.array([outer[k] for k in moved]) + np.array([inner[k] for k in moved])
    composed[turned] = products[:, :3]
    return composed


def _stacked(frames: Sequence[Frame]) -> np.ndarray:
    """(n, 4, 4) matrices of frames."""
    matrices = np.zeros((len(frames), 4, 4))
    matrices[:] = np.eye(4)
    moved = [k for k, frame in enumerate(frames) if type(frame) is tuple]
    if moved:
        matrices[moved, :3, 3] = np.array([frames[k] for k in moved])
    for k, frame in enumerate(frames):
        if type(frame) is not tuple:
            matrices[k] = frame
    return matrices
