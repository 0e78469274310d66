"""Film: renders a picture tile by tile on all threads, with progress, cancellation and adaptive rounds.

A tile's samples depend on the tile alone, and decisions are made between rounds, without running threads. So the picture is bit-identical
for any number of threads, except with a budget of seconds.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...compiler.plan import decision
from ...compiler.plan.plan import Plan
from ..image import image
from ..image.cryptomatte import Mattes
from ..jit import thread_pool
from ..simd import target
from ..types import Film, FirstHits, Tile, View
from .canvas import Canvas
from .checkpoint import Keeper
from .deadline import Deadline
from .progress import Progress, Report
from .refinement import Refinement
from .remote import Remote
from .tile_calls import TILE as TILE
from .tile_calls import draw_auxiliary
from .tile_calls import tiles as tiles
from .tile_queue import TileKernel

Counts = NDArray[np.int64]


class Renderer(Protocol):
    """The interface of a backend to the film."""

    by_tile: bool
    """Whether all pixels of a tile take the same number of samples."""

    cell: int
    """Side in pixels of the square cells whose pixels take the same number of samples; 1: each pixel its own."""

    side: int
    """Side of a tile in pixels."""

    @property
    def whole(self) -> Whole | None:
        """The picture, if the backend renders it by itself with fixed samples; None: tile by tile."""
        ...

    @property
    def round(self) -> int | None:
        """Most samples a pixel between two calls of `refresh`; None: samples share nothing, and `refresh` is not called."""
        ...

    @property
    def tile_kernel(self) -> TileKernel | None:
        """A kernel that does the work of `sample` for a round, with the same result; None: `sample` is called for each tile."""
        ...

    def limit_time(self, deadline: Deadline) -> None:
        """Let the data that samples share take a part of the time until a deadline."""
        ...

    def resize(self, width: int, height: int) -> bool:
        """Draw pictures of another size from now on, as quick previews; False if it cannot. No thread may be drawing."""
        ...

    def refresh(self, samples: int) -> None:
        """Recompute the data shared by the samples of a round; `samples` counts those of all pixels."""
        ...

    def shared(self) -> tuple[int, ...]:
        """The state from which the next `refresh` makes its data, where `round` is not None."""
        ...

    def share(self, state: tuple[int, ...]) -> None:
        """Set the state that `shared` returned."""
        ...

    def sample(self, tile: Tile, first: Counts, count: Counts, total: int, film: Film) -> None:
        """Add samples first … first + count - 1, (h, w) each, of `total` of every pixel of the tile; a single one lies at the center."""
        ...

    def channels(self, tile: Tile, names: tuple[str, ...], out: dict[str, NDArray[np.float32]]) -> None:
        """Write the named channels, (h, w, k) each, at the pixels' centers."""
        ...

    def first(self, tile: Tile, samples: range, total: int) -> Iterator[FirstHits]:
        """The first hits of some of `total` samples of each pixel of a tile, in their order; in numpy lanes (k · h · w,) of k of them."""
        ...


class Unshared:
    """Base of renderers whose samples share nothing."""

    round: int | None = None
    tile_kernel: TileKernel | None = None

    def limit_time(self, deadline: Deadline) -> None:
        """Do nothing."""

    def resize(self, width: int, height: int) -> bool:
        """It cannot."""
        return False

    def refresh(self, samples: int) -> None:
        """Do nothing."""

    def shared(self) -> tuple[int, ...]:
        """Nothing."""
        return ()

    def share(self, state: tuple[int, ...]) -> None:
        """Do nothing."""


class Whole(Protocol):
    """A picture that a backend renders by itself, in pieces."""

    rgba: NDArray[np.float32]

    half_difference: NDArray[np.float32] | None
    """(h, w, 3) error estimate of `rgba` from halves of the samples; None if there is none."""

    @property
    def jobs(self) -> Sequence[int]:
        """The pieces."""
        ...

    @property
    def error(self) -> float | None:
        """√relMSE from `half_difference`."""
        ...

    def draw(self, job: int) -> int:
        """Render one piece into `rgba`; return how many samples were left out because they were not finite."""
        ...

    def finish(self) -> None:
        """Set `rgba` to 0 where no piece was rendered."""
        ...


def run(
    renderer: Renderer | Remote, plan: Plan, view: View, report: Report | None = None, cancel: threading.Event | None = None,
    mattes: Mattes | None = None, keeper: Keeper | None = None, progressive: bool = False, deadline: Deadline | None = None,
    grants: bool = False,
) -> image.Image:  # fmt: skip
    """Render plan["crop"] of a picture to plan["samples"], or until plan["error"] or the deadline ends it.

    `report` is called from this thread; `mattes` are for the channels crypto_…; `keeper` writes checkpoints;
    `progressive` is that of Canvas. The `deadline` is by default plan["budget"] from now; `grants` is that
    of Refinement.
    Setting `cancel` ends the work; the partial picture is returned, with metadata["partial"]. An exception in a worker is raised here.
    """
    if not isinstance(renderer, Remote) and renderer.whole is not None:
        return _in_pieces(renderer, renderer.whole, plan, view, report, cancel or threading.Event(), mattes)
    canvas = Canvas(renderer, plan, cancel or threading.Event(), report, mattes, keeper, progressive)
    if decision.adaptive(plan):
        Refinement(canvas, plan["error"], deadline or Deadline(plan["budget"]), grants).run()
    else:
        canvas.fixed()
    if canvas.cancel.is_set():
        canvas.keep()
    return canvas.finish(view)


def run_channels(
    renderer: Renderer | Remote, plan: Plan, cancel: threading.Event, mattes: Mattes | None, deadline: Deadline
) -> image.Image:  # fmt: skip
    """Render the channels of plan["aov"] alone, tile by tile until the deadline; the colors are 0."""
    canvas = Canvas(renderer, plan, cancel, None, mattes)
    Refinement(canvas, 0.0, deadline).draw_channels()
    return canvas.finish(View(plan["camera"], *plan["size"]))


def _in_pieces(
    renderer: Renderer, picture: Whole, plan: Plan, view: View, report: Report | None, cancel: threading.Event, mattes: Mattes | None
) -> image.Image:  # fmt: skip
    """Render a `Whole` picture; other channels are rendered by tiles."""
    x0, y0, x1, y1 = crop = tuple(plan["crop"])
    names = tuple(plan["aov"])
    channels = {"rgba": picture.rgba, **image.blank(x1 - x0, y1 - y0, names)}
    threads = int(plan["threads"]) or target.cores()
    done = issues = 0
    extra = tiles(crop) if names else []
    total = len(picture.jobs) + len(extra)

    samples = int(plan["samples"])

    def count(_: Any, issue_count: int) -> None:
        nonlocal done, issues
        done, issues = done + 1, issues + issue_count
        if report is not None:
            report(Progress("rendering", done / total, samples * done / total, samples))

    def beside(tile: Tile) -> int:
        window = slice(tile.y0 - y0, tile.y1 - y0), slice(tile.x0 - x0, tile.x1 - x0)
        draw_auxiliary(renderer, tile, {name: channels[name][window] for name in names}, int(plan["samples"]), mattes)
        return 0

    parts: Any = ((picture.draw, picture.jobs), (beside, extra))
    for draw, jobs in parts:
        thread_pool.parallel_for(draw, jobs, threads, cancel, count)
    picture.finish()
    if "samples" in channels:
        channels["samples"][...] = samples
    about: dict[str, Any] = {
        "size": (view.width, view.height), "crop": crop, "samples": samples, "samples_mean": float(samples),
        "error": picture.error if done == total else None, "partial": done < total, "error_in_few": 0.0,
        "variance": None if picture.half_difference is None else np.square(picture.half_difference),
        "half_difference": picture.half_difference, "variance_share": 1.0,
        "rays": samples * (x1 - x0) * (y1 - y0), "issues": issues, "threads": threads,
    }  # fmt: skip
    return image.Image(x1 - x0, y1 - y0, channels, about)
