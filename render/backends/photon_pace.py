"""Plans the photons of a picture with a budget: so many that tracing them takes a part of the seconds that are left."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ..film.deadline import Deadline
from ..integrator.photons import tracer as photon_tracer
from ..integrator.photons.tracer import Tracer
from ..jit.packed_struct import Handle

SHARE = 0.12  # of the seconds left, for the photons of a round
PILOTS = 5.0  # times the seconds of a pilot map, that measuring the effort takes
LEAST = 2.0  # seconds left, from which a pilot map measures the pace
FEWEST = photon_tracer.FEWEST / photon_tracer.LEAST  # effort


class PhotonPace:
    """Seconds that a photon takes, and the effort that a deadline allows."""

    def __init__(self) -> None:
        self.deadline = Deadline()
        self._seconds: float | None = None  # of a photon

    def allows_measuring(self, tracer: Tracer, frame: Handle) -> bool:
        """Whether there is time to measure how many photons the picture needs; traces a pilot map to tell."""
        if not self.deadline.is_finite:
            return True
        if self.deadline.left() < LEAST:
            return False
        began = self.deadline.clock()
        tracer.make_pilot_maps(2, frame)
        took = self.deadline.clock() - began
        self._seconds = took / photon_tracer.PILOT
        return PILOTS * took < SHARE * self.deadline.left()

    @contextmanager
    def limited(self, tracer: Tracer, samples: int) -> Iterator[None]:
        """In the block, the tracer's effort for a round of `samples` is at most what the deadline allows."""
        effort, before, began = tracer.effort, tracer.photon_count, self.deadline.clock()
        if self.deadline.is_finite:
            tracer.effort = min(effort, max(self._affordable(samples), FEWEST))
        try:
            yield
        finally:
            tracer.effort = effort
            if traced := tracer.photon_count - before:
                self._seconds = (self.deadline.clock() - began) / traced

    def _affordable(self, samples: int) -> float:
        """The effort whose photons take SHARE of the seconds that are left."""
        if self._seconds is None:
            return FEWEST
        photons = SHARE * max(self.deadline.left(), 0.0) / max(self._seconds, 1e-9)
        effort = photons / max(photon_tracer.PER_SAMPLE * samples, 1.0)
        return effort if photons >= photon_tracer.LEAST else min(effort, photons / photon_tracer.LEAST)
