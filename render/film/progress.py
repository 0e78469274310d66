"""Progress of the rendering of a picture, as callers receive it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Picture(NamedTuple):
    """The picture so far, in the arrays that other threads write."""

    rgba: NDArray[np.float32]
    """(height, width, 4), as in the channel `rgba`."""

    samples: NDArray[np.integer]
    """(height, width); where 0, `rgba` is not rendered yet."""


class Progress(NamedTuple):
    """The current stage of a picture, and its samples and error so far."""

    stage: str
    """"building", "rendering", "denoising" or "finishing"."""

    share: float = 0.0
    """Of the samples that the stage will take, 0 to 1; 0 while it is unknown; where an error is asked for an estimate, which may fall."""

    samples: float = 0.0
    """Mean samples a pixel so far."""

    most: int = 0
    """Samples a pixel if their number is fixed; 0: an error or a time ends the rendering."""

    error: float | None = None
    """√relMSE so far; None while it is unknown."""

    picture: Picture | None = None
    """The picture so far while it is rendered in tiles; None in other stages, and for backends that render whole pictures."""

    limit: int = 0
    """Samples a pixel that end a rendering which an error may end before; 0 for none."""

    denoiser: Callable[[], Callable[[NDArray[np.float32]], NDArray[np.float32]] | None] | None = None
    """Makes a filter of the picture so far, None if it was cancelled; for viewers, of pictures whose noise may be removed at the end."""


Report = Callable[[Progress], None]
