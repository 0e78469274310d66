"""What kernels.timed counts as compiling, and what as the work itself."""

from __future__ import annotations

import time

import pytest
from maquette.render import kernels
from numba import njit


def test_compiling_is_counted_apart_from_work() -> None:
    double = njit(lambda x: 2 * x)
    seconds: dict[str, float] = {}
    started = time.perf_counter()
    with kernels.timed(seconds, "render"):
        assert double(2) == 4
        time.sleep(0.02)
    whole = time.perf_counter() - started
    assert seconds["compile_kernels"] > 0.001
    assert seconds["render"] >= 0.02
    assert seconds["compile_kernels"] + seconds["render"] == pytest.approx(whole, abs=0.01)
    compiled = seconds["compile_kernels"]
    with kernels.timed(seconds, "render"):
        assert double(3) == 6
    assert seconds["compile_kernels"] == compiled  # nothing new was compiled


def test_time_is_counted_when_the_work_fails() -> None:
    seconds: dict[str, float] = {}
    with pytest.raises(ArithmeticError), kernels.timed(seconds, "build"):
        raise ArithmeticError
    assert seconds["build"] > 0
    assert seconds["compile_kernels"] == 0
