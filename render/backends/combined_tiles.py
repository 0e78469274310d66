"""Draws tiles by several renderers in one kernel: the light of each group, or the moments of motion and points of a lens in turn.

The kernels of the parts are called by address.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..film.accumulate import clear
from ..film.tile_queue import TileKernel
from ..jit.function_pointer import DeclaredPointer
from ..jit.kernel import Kernel, helper, kernel
from ..jit.packed_struct import Handle
from ..jit.value_types import NONE, TYPE_OF
from ..types import Film, Tile

_call = DeclaredPointer(NONE).call
MOST_INPUTS = 4


class Parts(NamedTuple):
    """The kernels of the parts."""

    kernels: NDArray[np.int64]  # (parts,) addresses
    inputs: NDArray[np.int64]  # (parts, MOST_INPUTS) addresses of the handles of their first arguments
    count: int  # of these


class GroupScene(NamedTuple):
    """Inputs of `draw_groups`: the parts draw the light of each group. Arrays are those of light_groups.Sums."""

    parts: Parts
    begin: NDArray[np.int64]  # (parts,) first row of each part in `light`
    light: NDArray[np.float64]  # (groups · pixels, 3)
    samples: NDArray[np.int64]  # (pixels,)
    width: int  # pixels of the crop, and its first column and row
    first_column: int
    first_row: int


class MomentScene(NamedTuple):
    """Inputs of `draw_moments`: sample s is drawn by part turns[s]."""

    parts: Parts
    turns: NDArray[np.int64]  # (n,); s counts modulo n


class PartMemory(NamedTuple):
    """Memory of a thread."""

    parts: NDArray[np.int64]  # (parts,) addresses of their memories
    film: Film  # of a part
    first: NDArray[np.int64]  # (side, side)
    ones: NDArray[np.int64]  # (side, side) of 1


class ThreadMemory(Handle):
    """The packed PartMemory of a thread, with the memories of the parts."""

    __slots__ = ("owners",)


TYPE_OF[ThreadMemory] = TYPE_OF[Handle]


def parts_of(drawings: Sequence[TileKernel]) -> Parts:
    """The parts of a scene for these kernels, which have equally many inputs."""
    inputs = np.zeros((len(drawings), MOST_INPUTS), np.int64)
    for row, drawing in zip(inputs, drawings, strict=True):
        row[: len(drawing.inputs)] = drawing.inputs
    return Parts(np.array([each.address for each in drawings], np.int64), inputs, len(drawings[0].inputs))


def link(
    function: Kernel, scene: Any, drawings: Sequence[TileKernel], side: int, samples: int | None = None, shares: bool = False
) -> TileKernel:  # fmt: skip
    """A TileKernel that draws by `drawings`, each in calls of at most `samples` samples; `scene` has their Parts.

    `shares`: their memory does not depend on the scene, so that all use the same.
    """

    def memory(*_: Any) -> Handle:
        memories = [_memory(drawing.memory, samples) for drawing in (drawings[:1] if shares else drawings)]
        memories *= len(drawings) // len(memories)
        film = Film(np.zeros((side, side, 3)), np.zeros((side, side)), np.zeros((side, side), np.int64))
        addresses = np.array([each.address for each in memories], np.int64)
        thread_memory = ThreadMemory(PartMemory(addresses, film, np.zeros((side, side), np.int64), np.ones((side, side), np.int64)))
        thread_memory.owners = memories
        return thread_memory

    kernel = TileKernel.link(function, [Handle(scene)], memory, memory().type)
    return kernel._replace(owners=(kernel.owners, drawings))


def _memory(allocate: Callable[..., Handle], samples: int | None) -> Handle:
    return allocate() if samples is None else allocate(samples)


@kernel
def draw_groups(scene, tile, first, count, total, film, memory):
    """Add samples to the film of a tile, and the light of each group to its sums; see light_groups.Renderer.sample."""
    rows, columns = tile.y1 - tile.y0, tile.x1 - tile.x0
    part_film = Film(memory.film.color, memory.film.alpha, memory.film.issues)
    for k in range(len(scene.parts.kernels)):
        clear(part_film, rows, columns)
        _draw_part(scene.parts, memory, k, (tile, first, count, total, part_film))
        for y in range(rows):
            for x in range(columns):
                pixel = (tile.y0 - scene.first_row + y) * scene.width + tile.x0 - scene.first_column + x
                for c in range(3):
                    scene.light[scene.begin[k] + pixel, c] += part_film.color[y, x, c]
                    film.color[y, x, c] += part_film.color[y, x, c]
                film.issues[y, x] += part_film.issues[y, x]
                if k == 0:
                    film.alpha[y, x] += part_film.alpha[y, x]
                    scene.samples[pixel] += count[y, x]


@kernel
def draw_moments(scene, tile, first, count, total, film, memory):
    """Add samples to the film of a tile, each by the renderer of its moment; all pixels take the same. See accumulation.Renderer."""
    for s in range(first[0, 0], first[0, 0] + count[0, 0]):
        for y in range(tile.y1 - tile.y0):
            for x in range(tile.x1 - tile.x0):
                memory.first[y, x] = s
        _draw_part(scene.parts, memory, scene.turns[s % len(scene.turns)], (tile, memory.first, memory.ones, total, film))


@helper
def _draw_part(parts: Any, memory: Any, k: int, arguments: tuple[Tile, Any, Any, int, Film]) -> None:
    """Call the kernel of part k with its inputs, (tile, first, count, total, film) and its memory."""
    a, b, c, d = parts.inputs[k, 0], parts.inputs[k, 1], parts.inputs[k, 2], parts.inputs[k, 3]
    last = memory.parts[k]
    if parts.count == 1:
        _call(parts.kernels[k], (a,) + arguments + (last,))
    elif parts.count == 3:
        _call(parts.kernels[k], (a, b, c) + arguments + (last,))
    else:
        _call(parts.kernels[k], (a, b, c, d) + arguments + (last,))
