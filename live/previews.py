"""Denoised previews of a picture that is not finished, made in a thread of their own."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..render.film.progress import Progress

NOISY = 0.05  # √relMSE above which the picture so far is denoised
RESTED = 0.5  # seconds without an edit before that
MORE = 1.5  # times the samples of the last preview for the next


class Previews:
    """The denoised previews of one picture. An edit does not wait for the denoiser: its result is taken when it is there."""

    def __init__(self) -> None:
        self._clean: Callable[[Any], Any] | None = None
        self._thread: threading.Thread | None = None
        self._made: list[NDArray[np.float32]] = []
        self._of = -1.0  # samples a pixel of the last preview
        self._taken = False
        self._wanted = False

    def offer(self, progress: Progress, seconds: float) -> None:
        """Denoise the picture so far if it is noisy, has new samples and `seconds` have passed since its start."""
        denoiser, picture = progress.denoiser, progress.picture
        self._wanted = denoiser is not None and progress.error is not None and progress.error > NOISY
        busy = self._thread is not None and self._thread.is_alive()
        if not self._wanted or denoiser is None or picture is None or busy or seconds < RESTED or progress.samples < MORE * self._of:
            return
        self._clean = self._clean or denoiser()
        if self._clean is None or not (picture.samples > 0).all():
            return
        self._of = progress.samples
        self._thread = threading.Thread(target=self._denoise, args=(self._clean, picture.rgba.copy()), name="previews", daemon=True)
        self._thread.start()

    def _denoise(self, clean: Callable[[Any], Any], rgba: NDArray[np.float32]) -> None:
        try:
            self._made.append(clean(rgba))
        except RuntimeError:  # the finished picture tells the denoiser's error
            self._of = math.inf

    def take(self) -> NDArray[np.float32] | None:
        """The newest preview (h, w, 4), once; None where there is no new one, or little noise is left."""
        preview = self._made[-1] if self._made and self._wanted else None
        self._made.clear()
        self._taken = self._taken or preview is not None
        return preview

    @property
    def shown(self) -> bool:
        """Whether a preview has been taken and noise is still there."""
        return self._taken and self._wanted
