"""A computation in Python is interrupted where it runs, and nothing is after its block."""

from __future__ import annotations

import threading
import time

import pytest
from maquette.live.interrupts import Interrupted, Interruptible

from . import windows


@pytest.mark.long
def test_a_loop_is_interrupted_and_what_follows_is_not() -> None:
    block, states = Interruptible(), []

    def run() -> None:
        for _ in range(20):
            try:
                with block.running():
                    states.append("in")
                    while True:
                        try:
                            sum(range(1000))
                        except Exception:  # as code that guards itself
                            states.append("swallowed")
            except Interrupted:
                states.append("out")
        sum(range(1_000_000))
        states.append("end")

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    for k in range(20):
        windows.until(lambda k=k: states.count("in") == k + 1)
        block.interrupt(0.0)
        block.interrupt(0.0)
        windows.until(lambda k=k: states.count("out") == k + 1)
    thread.join(timeout=10)
    assert states == ["in", "out"] * 20 + ["end"]


def test_a_young_or_ended_block_is_not_interrupted() -> None:
    block = Interruptible()
    with block.running():
        block.interrupt(60.0)
    block.interrupt(0.0)
    time.sleep(0.01)


def test_an_interrupt_replaces_an_error_of_the_block() -> None:
    block = Interruptible()

    def fail() -> None:
        with block.running():
            try:
                block.interrupt(0.0)
                for _ in range(100):
                    time.sleep(0.001)
            except Interrupted:
                raise ValueError from None

    with pytest.raises(Interrupted):
        fail()
