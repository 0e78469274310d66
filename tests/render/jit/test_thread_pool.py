"""Thread pool: each job runs once, the first failure stops the others, threads are reused, and stay off the caller's core."""

from __future__ import annotations

import os
import threading

import pytest
from maquette.render.jit import thread_pool


def test_each_job_runs_once_and_is_reported_here():
    reports = []

    def tell(job: int, result: tuple[int, int]) -> None:
        reports.append((job, result[0], threading.get_ident()))

    thread_pool.parallel_for(lambda job: (job * job, threading.get_ident()), range(200), 3, None, tell)
    assert sorted(reports) == [(job, job * job, threading.get_ident()) for job in range(200)]


def test_two_threads_work_at_the_same_time():
    meeting = threading.Barrier(2, timeout=20)
    thread_pool.parallel_for(lambda job: meeting.wait(), range(2), 2)


def test_the_first_exception_stops_the_jobs():
    def fail(job: int) -> None:
        raise ArithmeticError(str(job))

    with pytest.raises(ArithmeticError):
        thread_pool.parallel_for(fail, range(4), 2)


def test_cancelled_jobs_stop():
    cancel, done = threading.Event(), []

    def draw(job: int) -> None:
        done.append(job)
        if len(done) == 5:
            cancel.set()

    thread_pool.parallel_for(draw, range(1000), 2, cancel)
    assert 5 <= len(done) <= 6


def test_threads_are_reused():
    def names() -> set[int]:
        seen, meeting = set(), threading.Barrier(2, timeout=20)

        def draw(job: int) -> None:
            seen.add(threading.get_ident())
            meeting.wait()

        thread_pool.parallel_for(draw, range(2), 2)
        return seen

    first = names()
    assert all(names() == first for _ in range(20))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_child_process_has_its_own_threads():
    thread_pool.parallel_for(lambda job: None, range(4), 2)
    child = os.fork()
    if child == 0:
        meeting = threading.Barrier(2, timeout=20)
        try:
            thread_pool.parallel_for(lambda job: meeting.wait(), range(2), 2)
        except BaseException:
            os._exit(1)
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity") or len(os.sched_getaffinity(0)) < 2, reason="no second core to be on")
def test_workers_stay_off_the_callers_core():
    cores, meeting = {}, threading.Barrier(2, timeout=20)

    def draw(job: int) -> None:
        cores[threading.get_ident()] = os.sched_getaffinity(0)
        meeting.wait()

    thread_pool.parallel_for(draw, range(2), 2)
    mine = cores.pop(threading.get_ident())
    (other,) = cores.values()
    assert other < mine
    assert len(mine - other) == 1


def test_a_caller_that_waits_runs_no_job():
    caller, ran, reported = threading.get_ident(), [], []
    thread_pool.parallel_for(lambda k: ran.append(threading.get_ident()), range(20), 3, None, lambda k, _: reported.append(k), waits=True)
    assert sorted(reported) == list(range(20))
    assert caller not in ran
    assert 1 <= len(set(ran)) <= 3
    thread_pool.parallel_for(lambda k: ran.append(k), [], 3, waits=True)
    assert len(ran) == 20
