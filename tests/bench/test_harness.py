"""The harness of the benchmarks, on contenders and a clock that are made up: turns, medians, ratios, refusals, peers that are missing."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Mapping
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from maquette.bench import harness
from maquette.bench.harness import Case, Contender, Disagreement, Effort, Missing, Peers, Seconds, Spread


class FakeTime:
    """A clock that moves only when a fake contender works; a log of who worked when."""

    def __init__(self) -> None:
        self.cpu = self.wall = 0.0
        self.log: list[str] = []

    def now(self) -> Seconds:
        return Seconds(self.cpu, self.wall)

    def contender(self, name: str, cpu: list[float], answer: Callable[[int], Any] = lambda run: 1) -> Contender:
        """Takes cpu[k] seconds at its run k (the last for further ones), and twice that by the wall."""
        runs = iter(range(1000))

        def run() -> Any:
            k = next(runs)
            spent = cpu[min(k, len(cpu) - 1)]
            self.cpu += spent
            self.wall += 2.0 * spent
            self.log.append(name)
            return answer(k)

        return Contender(name, run)


def same(answers: Mapping[str, Any]) -> str:
    if len(set(answers.values())) > 1:
        raise Disagreement(f"{dict(answers)}")
    return "equal"


def test_contenders_take_turns_and_change_who_begins() -> None:
    time = FakeTime()
    case = Case("case", [time.contender(name, [1.0]) for name in ("maquette", "b", "c")], same)
    harness.measure(case, Effort(rounds=4, fewest=4), time.now)
    assert " ".join(time.log) == "maquette b c  maquette b c  b c maquette  c maquette b  maquette b c".replace("  ", " ")


def test_the_first_run_is_compile_and_not_in_the_median() -> None:
    time = FakeTime()
    case = Case("case", [time.contender("maquette", [9.0, 1.0, 5.0, 2.0])], same)
    (times,) = harness.measure(case, Effort(rounds=3), time.now).times
    assert times.first == Seconds(9.0, 18.0)
    assert times.spread() == Spread(2.0, 1.5, 3.5)
    assert times.spread("wall").median == 4.0
    assert times.compile() == 7.0


def test_ratios_are_taken_round_by_round() -> None:
    """The machine becomes three times as slow: medians of each side alone would say 3."""
    time = FakeTime()
    ours = time.contender("maquette", [1.0, 1.0, 1.0, 3.0])
    peer = time.contender("peer", [2.0, 2.0, 6.0, 6.0])
    result = harness.measure(Case("case", [ours, peer], same), Effort(rounds=3), time.now)
    assert result.times_of("peer").spread().median / result.times_of("maquette").spread().median == 6.0
    assert result.ratio("peer") == 2.0
    assert result.ratio("maquette") == 1.0


@pytest.mark.parametrize("wrong_at", [0, 3])
def test_answers_that_differ_leave_no_times(wrong_at: int) -> None:
    """Before the first round, and after the last."""
    time = FakeTime()
    peer = time.contender("peer", [1.0], lambda run: 2 if run == wrong_at else 1)
    result = harness.measure(Case("case", [time.contender("maquette", [1.0]), peer], same), Effort(rounds=3), time.now)
    assert result.times == ()
    assert result.refused == "{'maquette': 1, 'peer': 2}"
    assert time.log.count("peer") == (1 if wrong_at == 0 else 4)


def test_answers_are_read_outside_of_the_clock() -> None:
    time = FakeTime()

    def slow_read(value: int) -> int:
        time.cpu += 100.0
        return value

    ours = time.contender("maquette", [1.0])
    case = Case("case", [Contender("maquette", ours.run, slow_read)], same)
    assert harness.measure(case, Effort(rounds=2), time.now).times_of("maquette").spread("cpu") == Spread(1.0, 1.0, 1.0)


def test_seconds_end_a_case_but_not_before_the_fewest_rounds() -> None:
    time = FakeTime()
    long = Case("case", [time.contender("maquette", [10.0])], same)
    assert len(harness.measure(long, Effort(rounds=7, fewest=3, seconds=1.0), time.now).times[0].runs) == 3
    assert len(harness.measure(long, Effort(rounds=7, fewest=3, seconds=90.0), time.now).times[0].runs) == 5
    assert len(harness.measure(long, Effort(rounds=7, fewest=3, seconds=1e9), time.now).times[0].runs) == 7


@pytest.mark.long
@given(st.lists(st.floats(0.001, 1000.0), min_size=1, max_size=12))
def test_quartiles_lie_about_the_median(values: list[float]) -> None:
    spread = Spread.from_values(values)
    assert min(values) <= spread.low <= spread.median <= spread.high <= max(values)
    assert sum(v <= spread.median for v in values) * 2 >= len(values)


@pytest.mark.long
def test_the_clock_counts_children() -> None:
    work = "import time\nend = time.process_time() + 0.2\nwhile time.process_time() < end: pass"
    spent = harness.timed(lambda: subprocess.run([sys.executable, "-c", work], check=True))[1]
    assert spent.cpu >= 0.2
    assert spent.wall >= 0.2


def test_peers_that_are_missing_are_left_out_and_named_once() -> None:
    peers = Peers()

    def absent() -> Contender:
        harness.need("no_such_package.inner", "pip install no-such-package")
        raise AssertionError

    for _ in range(2):
        there = peers.gather(lambda: Contender("maquette", lambda: 1), absent)
        assert [c.name for c in there] == ["maquette"]
    assert peers.missing == ["no_such_package is not installed (pip install no-such-package)"]


def test_a_peer_that_is_there_is_given() -> None:
    assert harness.need("json", "").loads("1") == 1
    with pytest.raises(Missing):
        harness.need("no_such_package", "nowhere")
