"""Queue of tiles: threads draw tiles after tiles in a kernel, and return to Python a few times a second.

Python's lock lets one thread at a time run Python. A millisecond of Python in each tile limits sixteen threads to the speed of six.
The order of samples, batches and sums is that of tile_calls.draw_batch, so pictures are equal bit for bit.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import compile_process, thread_pool
from ..jit.function_pointer import DeclaredPointer, compiled_address
from ..jit.kernel import Kernel, helper, kernel
from ..jit.packed_struct import Handle
from ..jit.value_types import INT64, NONE, ValueType, array_type, tuple_type
from ..simd.atomics import fetch_add
from ..types import Film, Tile
from .accumulate import PixelSums, Window, add_batch, clear, put_first
from .adaptive_sampling import Decline
from .deadline import UNLIMITED, Pace

CALL = 64  # samples a pixel of a tile between checks for cancellation and deadline
SHORTEST, LONGEST = 0.03, 0.2  # seconds of a kernel call, after which a thread looks for cancellation, unless a batch takes longer
SHARE = 0.02  # of the time since the queue began, that a call takes between these limits
ROW, START, END, STEP, LAST, QUOTA, ENDS = range(7)  # of TileMemory.state
NONE_LEFT = -1  # in state[ROW]

_call = DeclaredPointer(NONE).call
COUNTS = array_type(np.int64, 2)
FILM = tuple_type(Film, (array_type(np.float64, 3), array_type(np.float64, 2), COUNTS))
TILE = tuple_type(Tile, (INT64,) * 4)


class TileKernel(NamedTuple):
    """A kernel that adds samples to a film: f(*inputs, tile, first, count, total, film, memory); see film.Renderer.sample."""

    address: int
    inputs: tuple[int, ...]  # addresses of the handles of its first arguments
    owners: Any  # of these handles
    memory: Callable[..., Handle]  # allocates the memory of a thread; memory(n): for calls of at most n samples

    @classmethod
    def link(cls, function: Kernel, inputs: Sequence[Handle], memory: Callable[..., Handle], kind: ValueType) -> TileKernel:
        """Load or compile a kernel; `kind` is the type of `memory`."""
        address = compiled_address(function, *(each.type for each in inputs), TILE, COUNTS, COUNTS, INT64, FILM, kind)
        return cls(address, tuple(each.address for each in inputs), inputs, memory)


class Batches(NamedTuple):
    """The batches of samples that a tile takes, one after the other."""

    steps: tuple[int, ...] = ()  # samples of all pixels after each batch
    goals: NDArray[np.int64] = np.zeros((0, 0), np.int64)  # (h, w) without steps: samples of pixels in the end; batches double them
    extras: bool = False  # draw the channels of tiles after their samples


class Target(NamedTuple):
    """A picture that threads draw. Arrays are those of its crop, which begins at `left`, `top`."""

    next_tile: NDArray[np.int64]  # (1,) counter that all threads share
    order: NDArray[np.int64]  # (n,) rows of `boxes` to draw
    boxes: NDArray[np.int64]  # (tiles, 4) x0, y0, x1, y1
    steps: NDArray[np.int64]
    goals: NDArray[np.int64]
    sums: PixelSums  # of the whole picture; empty where a tile's sums end with its batches
    rgba: NDArray[np.float32]
    differences: NDArray[np.float32]
    samples: NDArray[np.int64]  # (h, w); empty for pictures of one sample
    sampled: NDArray[np.int8]  # (h, w) of pictures of one sample, otherwise empty
    drawn: NDArray[np.int64]  # (tiles,) samples of all pixels
    issues: NDArray[np.int64]  # (tiles,)
    shown: NDArray[np.float64]  # see adaptive_sampling.Decline
    least: float
    first_column: int
    first_row: int
    total: int  # samples of a pixel in the end


class TileMemory(NamedTuple):
    """A thread's tile in work."""

    state: NDArray[np.int64]  # (7,) of the tile in work its row, samples drawn of the batch, samples of the batch, number of its step,
    # samples of the last call; and samples until the return, whether to end the batch
    first: NDArray[np.int64]  # (side, side) samples before a call
    part: NDArray[np.int64]  # of a call
    count: NDArray[np.int64]  # of the batch
    film: Film
    sums: PixelSums

    @classmethod
    def allocate(cls, side: int) -> TileMemory:
        """Memory for tiles of `side` × `side` pixels."""
        first, part, count = np.zeros((3, side, side), np.int64)
        film = Film(np.zeros((side, side, 3)), np.zeros((side, side)), np.zeros((side, side), np.int64))
        return cls(np.array([NONE_LEFT, 0, 0, 0, 0, 0, 0]), first, part, count, film, PixelSums.zeros(side, side))


class _Worker:
    """A thread's memory, and the lock that it holds in kernels."""

    def __init__(self, side: int, memory: Handle) -> None:
        self.tile, self.memory, self.lock = Handle(TileMemory.allocate(side)), memory, threading.Lock()
        self.state = self.tile.tables.state

    @property
    def row(self) -> int:
        """The row of the tile in work, or NONE_LEFT."""
        return int(self.state[ROW])


class TileQueue:
    """Draws tiles of a picture on several threads."""

    clock: Callable[[], float] = staticmethod(time.perf_counter)

    def __init__(self, side: int, threads: int, pace: Pace) -> None:
        self.side, self.threads, self.pace = side, threads, pace
        self.workers: dict[int, _Worker] = {}

    def run(
        self, drawing: TileKernel, target: Target, is_stopped: Callable[[int], bool], keeps: Callable[[], bool], report: Callable[[], None]
    ) -> None:  # fmt: skip
        """Draw the tiles of target.order.

        `is_stopped(row)` says whether a thread stops that has this tile in work; after all threads the batch that it has is added, as far
        as it was drawn, if `keeps()`. `report` is called by this thread, after each of its calls.
        """
        caller, failed, began = threading.get_ident(), threading.Event(), self.clock()
        limit = self.pace.samples() if self.pace.limits else UNLIMITED

        def bound(worker: _Worker) -> Callable[[], tuple[int, bool]]:
            return draw_tiles.bind(drawing.address, drawing.inputs, worker.memory.address, target, worker.tile, limit)

        def draw(k: int) -> None:
            try:
                worker, more = self._worker(k, drawing), True
                run = bound(worker)
                while more and not failed.is_set() and not is_stopped(worker.row):
                    more = self._call(worker, run, began)
                    if threading.get_ident() == caller:
                        report()
            except BaseException:
                failed.set()
                raise

        try:
            thread_pool.parallel_for(draw, range(min(self.threads, len(target.order))), self.threads, None, lambda *_: report())
        finally:
            for worker in self.workers.values():
                if worker.row != NONE_LEFT and not failed.is_set() and keeps():
                    worker.state[ENDS] = 1
                    bound(worker)()
                worker.state[ROW], worker.state[ENDS] = NONE_LEFT, 0

    def _worker(self, k: int, drawing: TileKernel) -> _Worker:
        if k not in self.workers:
            self.workers[k] = _Worker(self.side, drawing.memory())
        return self.workers[k]

    def _call(self, worker: _Worker, run: Callable[[], tuple[int, bool]], queue_began: float) -> bool:
        """Draw for some time, as far as the pace is known; False where nothing is left to do."""
        each = self.pace.seconds
        with worker.lock:
            began = self.clock()
            seconds = min(max(SHARE * (began - queue_began), SHORTEST), LONGEST)
            worker.state[QUOTA] = int(seconds / each) if each > 0.0 else 1
            used, more = run()
            self.pace.add(used, self.clock() - began)
        return more


def load(drawing: TileKernel, side: int) -> None:
    """Load or compile the kernel that draws tiles."""
    draw_tiles(*_nothing(drawing.address, len(drawing.inputs), side))


def compile_in_background(threads: int, inputs: int, side: int) -> None:
    """Compile the kernel that draws tiles by a TileKernel with so many inputs, beside other kernels."""
    compile_process.compile_in_background(threads, draw_tiles, *_nothing(0, inputs, side))


def _nothing(draw: int, inputs: int, side: int) -> tuple[Any, ...]:
    """Arguments of `draw_tiles` for a picture without tiles."""
    none, empty, sums = np.zeros(0, np.int64), np.zeros((0, 0), np.int64), PixelSums.zeros(0, 0)
    picture = np.zeros((0, 0, 4), np.float32), np.zeros((0, 0, 3), np.float32), empty, np.zeros((0, 0), np.int8)
    tiles = none, none, Decline(()).shown
    target = Target(np.zeros(1, np.int64), none, np.zeros((0, 4), np.int64), none, empty, sums, *picture, *tiles, 0.0, 0, 0, 0)
    return draw, (0,) * inputs, 0, target, Handle(TileMemory.allocate(side)), 0


@kernel
def draw_tiles(draw, inputs, memory, target, work, limit):
    """Draw tiles until state[QUOTA] samples are drawn or none is left; returns (samples, whether there is more to do).

    `draw`, `inputs` and `memory` are those of TileKernel. A call of it takes at most `limit` samples, and one of each pixel at least.
    The tile in work remains for the next call. With state[ENDS], it adds the samples of the batch in work that were drawn, and no others.
    """
    state, used = work.state, 0
    quota, ends = state[QUOTA], state[ENDS] != 0
    while True:
        if state[ROW] < 0:
            if used >= quota or ends:
                return used, True
            k = fetch_add(target.next_tile, 0, 1)
            if k >= len(target.order):
                return used, False
            _begin_tile(target, work, target.order[k])
            if not _begin_batch(target, work):
                state[ROW] = NONE_LEFT
                continue
        tile = _box(target, state[ROW])
        film = Film(work.film.color, work.film.alpha, work.film.issues)
        while state[START] < state[END] and not ends:
            if used >= quota:
                return used, True
            used += _set_part(work, tile, limit)
            _call(draw, inputs + (tile, work.first, work.part, target.total, film, memory))
        _end_batch(target, work, film, tile)
        if ends or not _begin_batch(target, work):
            state[ROW] = NONE_LEFT


@helper
def _box(target: Any, row: int) -> Tile:
    return Tile(target.boxes[row, 0], target.boxes[row, 1], target.boxes[row, 2], target.boxes[row, 3])


@helper
def _begin_tile(target: Any, work: Any, row: int) -> None:
    """Take a tile into work."""
    work.state[ROW], work.state[STEP] = row, 0
    tile = _box(target, row)
    rows, columns = tile.y1 - tile.y0, tile.x1 - tile.x0
    clear(work.film, rows, columns)
    if len(target.sums.samples) == 0:
        clear(work.sums, rows, columns)
        for y in range(rows):
            for x in range(columns):
                work.sums.samples[y, x] = 0


@helper
def _begin_batch(target: Any, work: Any) -> bool:
    """Set the counts of the next batch of the tile in work; False if there is none."""
    state, row = work.state, work.state[ROW]
    tile = _box(target, row)
    pixels = (tile.y1 - tile.y0) * (tile.x1 - tile.x0)
    doubles, goal = len(target.steps) == 0, 0
    if not doubles:
        while state[STEP] < len(target.steps) and target.drawn[row] >= target.steps[state[STEP]] * pixels:
            state[STEP] += 1
        if state[STEP] == len(target.steps):
            return False
        goal = target.steps[state[STEP]]
        state[STEP] += 1
    most = 0
    for y in range(tile.y1 - tile.y0):
        for x in range(tile.x1 - tile.x0):
            v, u = tile.y0 - target.first_row + y, tile.x0 - target.first_column + x
            before = target.sums.samples[v, u] if len(target.sums.samples) > 0 else work.sums.samples[y, x]
            if doubles:
                goal = min(target.goals[v, u], 2 * before)
            work.first[y, x], work.count[y, x] = before, max(goal - before, 0)
            most = max(most, work.count[y, x])
    state[START], state[END], state[LAST] = 0, most, 0
    return most > 0


@helper
def _set_part(work: Any, tile: Tile, limit: int) -> int:
    """Set the samples of the next call, and move `state[START]` behind them; returns their number."""
    start, rows, columns, active = work.state[START], tile.y1 - tile.y0, tile.x1 - tile.x0, 0
    for y in range(rows):
        for x in range(columns):
            active += 1 if work.count[y, x] > start else 0
    call = min(CALL * max(1, rows * columns // active), max(limit // active, 1))
    return _set_counts(work, rows, columns, start, call)


@helper
def _set_counts(work: Any, rows: int, columns: int, start: int, call: int) -> int:
    used, last = 0, work.state[LAST]
    for y in range(rows):
        for x in range(columns):
            work.first[y, x] += last
            part = min(max(work.count[y, x] - start, 0), call)
            work.part[y, x] = part
            used += part
    work.state[START], work.state[LAST] = start + call, call
    return used


@helper
def _end_batch(target: Any, work: Any, film: Film, tile: Tile) -> None:
    """Add the batch of the tile in work to sums and picture, as far as it was drawn."""
    state, first_row, first_column = work.state, tile.y0 - target.first_row, tile.x0 - target.first_column
    window = Window(tile.y1 - tile.y0, tile.x1 - tile.x0, first_row, first_column, first_row, first_column)
    if state[START] < state[END]:
        for y in range(window.rows):
            for x in range(window.columns):
                work.count[y, x] = min(work.count[y, x], state[START])
    if target.total == 1:
        if state[START] > 0:
            _end_single(target, state[ROW], film, window)
    elif len(target.sums.samples) > 0:
        _add(target, work, film, target.sums, window)
    else:
        _add(target, work, film, work.sums, Window(window.rows, window.columns, 0, 0, first_row, first_column))


@helper
def _end_single(target: Any, row: int, film: Film, window: Window) -> None:
    """Set the picture of a tile of one sample a pixel."""
    target.issues[row], target.drawn[row] = put_first(film, window, target.rgba), window.rows * window.columns
    for y in range(window.rows):
        for x in range(window.columns):
            target.sampled[window.row + y, window.column + x] = 1


@helper
def _add(target: Any, work: Any, film: Film, sums: Any, window: Window) -> None:
    """Add the batch of the tile in work to its sums."""
    row, drawn, issues = work.state[ROW], 0, 0
    add_batch(film, work.count, window, sums, target.differences, target.rgba, target.least, target.shown, row)
    for y in range(window.rows):
        for x in range(window.columns):
            samples = sums.samples[window.sums_row + y, window.sums_column + x]
            target.samples[window.row + y, window.column + x] = samples
            drawn += samples
            issues += sums.issues[window.sums_row + y, window.sums_column + x]
    target.drawn[row], target.issues[row] = drawn, issues
    clear(film, window.rows, window.columns)
