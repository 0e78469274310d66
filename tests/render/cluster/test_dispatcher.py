"""The dispatcher finishes all requests while workers join, end, stall, err and are slow; on a wire that the tests answer."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from maquette.render import packing
from maquette.render.cluster import dispatcher, identity, messages
from maquette.render.cluster.dispatcher import Dispatcher, Lost, Unreadable
from maquette.render.cluster.requests import ClusterError, Request, Work

PARCEL = messages.Parcel("key", [["a", "h", "<f8", [2]]], {"h": np.array([1.0, 2.0])})
WORK = Work(PARCEL, [])


class Wire:
    """Messages to workers, which a test answers."""

    address = "tcp://here:8786"

    def __init__(self) -> None:
        self.sent: list[tuple[str, dict[str, Any], Callable[[Any], None]]] = []
        self.drawn: list[tuple[str, list[int]]] = []  # worker and the numbers of requests that it answered
        self.kept: dict[str, dict[str, bytes]] = {}
        self.identities: dict[str, dict[str, str]] = {}
        self.dropped = 0
        self.seconds = 0.01

    def send(self, worker: str, message: bytes, then: Callable[[Any], None]) -> int:
        about, arrays = packing.unpack(message)
        self.sent.append((worker, {**about, "arrays": arrays}, then))
        return len(self.sent)

    def drop(self, handle: Any) -> None:
        self.dropped += handle is not None

    def answer(self, where: Callable[[str, dict[str, Any]], bool] = lambda worker, about: True, fault: Any = None) -> int:
        """Answer the messages that `where` selects as a worker does, or by a fault. Returns their number."""
        selected = [each for each in self.sent if where(each[0], each[1])]
        self.sent = [each for each in self.sent if not where(each[0], each[1])]
        for worker, about, then in selected:
            then(fault if fault is not None else packing.pack(*self.reply(worker, about)))
        return len(selected)

    def reply(self, worker: str, about: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        parts = self.kept.setdefault(worker, {})
        if about["do"] == "identify":
            return dict(self.identities.get(worker, identity.identity())), {}
        if about["do"] == "offer":
            return {"missing": [digest for _, digest, _, _ in about["rows"] if digest not in parts]}, {}
        if about["do"] == "keep":
            parts[about["hash"]] = about["arrays"]["part"].tobytes()
            return {}, {}
        if "h" not in parts:
            return {"missing": True}, {}
        self.drawn.append((worker, [request["number"] for request in about["requests"]]))
        replies = [{"number": request["number"]} for request in about["requests"]]
        arrays = {f"{k}.double": 2.0 * about["arrays"][f"{k}.value"] for k in range(len(replies))}
        return {"replies": replies, "seconds": self.seconds * len(replies)}, arrays


def draws(worker: str, about: dict[str, Any]) -> bool:
    return about["do"] == "draw"


def requests(count: int, kind: str = "batch", cancel: threading.Event | None = None) -> list[Request]:
    return [Request(WORK, {"do": kind, "number": k}, {"value": np.array([float(k)])}, 1.0, cancel) for k in range(count)]


def started(workers: dict[str, int], count: int, **more: Any) -> tuple[Wire, Dispatcher, list[Request]]:
    """A dispatcher with workers of so many threads, and requests."""
    wire = Wire()
    dispatch = Dispatcher(wire)
    queued = requests(count, **more)
    for request in queued:
        dispatch.ask(request)
    dispatch.update({name: (threads, 0.0, False) for name, threads in workers.items()})
    wire.answer()
    dispatch.tick()
    return wire, dispatch, queued


def run(wire: Wire, dispatch: Dispatcher, rounds: int = 200) -> None:
    for _ in range(rounds):
        wire.answer()
        dispatch.tick()


def check(queued: list[Request]) -> None:
    for k, request in enumerate(queued):
        assert request.done
        answer = request.wait()
        assert answer is not None
        assert answer[0] == {"number": k}
        assert answer[1]["double"].tolist() == [2.0 * k]


def test_all_workers_draw_and_the_scene_goes_to_each_once() -> None:
    wire, dispatch, queued = started({"a": 1, "b": 2}, 200)
    sent: list[str] = []
    for _ in range(200):
        sent += [worker for worker, about, _ in wire.sent if about["do"] == "keep"]
        wire.answer()
        dispatch.tick()
    check(queued)
    assert sorted(sent) == ["a", "b"]
    assert {worker for worker, _ in wire.drawn} == {"a", "b"}
    assert wire.kept["a"]["h"] == PARCEL.arrays["h"].tobytes()
    assert sorted(number for _, numbers in wire.drawn for number in numbers) == list(range(200))  # each once


def test_small_requests_go_together_and_large_ones_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatcher, "COALESCE", 0.0)
    messages = {}
    for seconds in (0.001, 10.0):
        wire, dispatch, queued = started({"a": 1, "b": 1}, 60)
        wire.seconds = seconds
        run(wire, dispatch)
        check(queued)
        messages[seconds] = len(wire.drawn)
    assert messages[10.0] == 60
    assert messages[0.001] < 20


def test_a_worker_has_at_most_two_messages_a_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatcher, "COALESCE", 0.0)
    wire, dispatch, _ = started({"a": 3}, 50)
    for _ in range(4):
        wire.answer(lambda worker, about: about["do"] != "draw")
        dispatch.tick()
    assert sum(about["do"] == "draw" for _, about, _ in wire.sent) == 6


def test_a_picture_takes_a_worker_alone() -> None:
    wire, dispatch, queued = started({"a": 4, "b": 1}, 8, kind="picture")
    for _ in range(4):
        wire.answer(lambda worker, about: about["do"] != "draw")
        dispatch.tick()
    assert sorted(worker for worker, about, _ in wire.sent) == ["a", "b", "b"]
    run(wire, dispatch)
    check(queued)


def test_requests_of_a_worker_that_ends_go_to_others() -> None:
    wire, dispatch, queued = started({"a": 1, "b": 1}, 20)
    run(wire, dispatch, 3)
    dispatch.tick()
    dispatch.update({"b": (1, 0.0, False)})
    assert wire.dropped
    wire.answer(lambda worker, about: worker == "a", Lost())
    run(wire, dispatch)
    check(queued)


def test_an_answer_that_was_lost_is_asked_for_again() -> None:
    wire, dispatch, queued = started({"a": 1}, 5)
    run(wire, dispatch, 2)
    assert wire.answer(draws, Lost())
    run(wire, dispatch)
    check(queued)


def test_a_scene_that_a_worker_forgot_is_sent_again() -> None:
    wire, dispatch, queued = started({"a": 1}, 5)
    run(wire, dispatch, 2)
    wire.kept.clear()
    run(wire, dispatch)
    check(queued)


def test_a_stalled_worker_gets_nothing_until_it_is_heard_again(monkeypatch: pytest.MonkeyPatch) -> None:
    wire, dispatch, queued = started({"a": 1, "b": 1}, 40)
    run(wire, dispatch, 3)
    dispatch.tick()
    monkeypatch.setattr(dispatcher, "SILENCE", 0.05)
    time.sleep(0.15)
    dispatch.update({"a": (1, 0.0, False), "b": (1, 1.0, False)})
    wire.drawn.clear()
    for _ in range(100):
        wire.answer(lambda worker, about: worker == "b")
        dispatch.tick()
    check(queued)
    assert {worker for worker, _ in wire.drawn} == {"b"}
    stale = len(wire.sent)
    dispatch.update({"a": (1, 2.0, False), "b": (1, 2.0, False)})
    assert wire.answer() == stale  # late answers change nothing
    check(queued)
    more = requests(40)
    for request in more:
        dispatch.ask(request)
    run(wire, dispatch)
    check(more)
    assert {worker for worker, _ in wire.drawn} == {"a", "b"}


@pytest.mark.long
def test_an_idle_worker_does_the_last_requests_of_a_slow_one_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatcher, "LEAST", 0.05)
    wire, dispatch, queued = started({"a": 1, "b": 1}, 30)
    for _ in range(100):
        wire.answer(lambda worker, about: worker == "b" or about["do"] != "draw")
        dispatch.tick()
        time.sleep(0.005)
    check(queued)
    assert {worker for worker, _ in wire.drawn} == {"b"}


def test_a_worker_that_joins_draws() -> None:
    wire, dispatch, queued = started({"a": 1}, 60)
    run(wire, dispatch, 2)
    dispatch.update({"a": (1, 0.0, False), "b": (1, 0.0, False)})
    run(wire, dispatch)
    check(queued)
    assert {worker for worker, _ in wire.drawn} == {"a", "b"}


def test_another_version_is_refused_and_the_rest_draws() -> None:
    wire = Wire()
    wire.identities["b"] = {**identity.identity(), "maquette": "0.0.1"}
    dispatch = Dispatcher(wire)
    queued = requests(10)
    for request in queued:
        dispatch.ask(request)
    dispatch.update({"a": (1, 0.0, False), "b": (1, 0.0, False)})
    run(wire, dispatch)
    check(queued)
    (note,) = dispatch.notes.values()
    assert note.message == f"worker b has maquette 0.0.1, and this client {identity.identity()['maquette']}: it draws nothing"
    assert note.hint == "install the same version on all"
    assert {worker for worker, _ in wire.drawn} == {"a"}


def test_without_a_worker_that_fits_the_error_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatcher, "PATIENCE", 0.02)
    wire = Wire()
    dispatch = Dispatcher(wire)
    (request,) = requests(1)
    dispatch.ask(request)
    dispatch.update({"a": (1, 0.0, False)})
    wire.answer(fault=Unreadable("ModuleNotFoundError: No module named 'maquette'"))
    time.sleep(0.04)
    dispatch.update({"a": (1, 0.0, False)})
    dispatch.tick()
    with pytest.raises(ClusterError) as caught:
        request.wait()
    assert str(caught.value) == (
        "tcp://here:8786 has no worker that can draw this picture: worker a cannot draw"
        " (ModuleNotFoundError: No module named 'maquette'): it draws nothing"
    )


ENDS = {
    "none came": ([], "tcp://here:8786 has no workers: start some with `dask worker tcp://here:8786`"),
    "all left": ([{"a": (1, 0.0, False)}, {}], "no worker of tcp://here:8786 is left: start some with `dask worker tcp://here:8786`"),
    "all are paused": (
        [{"a": (1, 0.0, False)}, {"a": (1, 0.0, True)}],
        "no worker of tcp://here:8786 answers: start others with `dask worker tcp://here:8786`",
    ),
}


@pytest.mark.parametrize("case", ENDS)
def test_without_a_worker_the_render_ends(monkeypatch: pytest.MonkeyPatch, case: str) -> None:
    updates, message = ENDS[case]
    wire = Wire()
    dispatch = Dispatcher(wire)
    (request,) = requests(1)
    dispatch.ask(request)
    for update in updates:
        dispatch.update(update)  # type: ignore[arg-type]
        wire.answer(lambda worker, about: about["do"] == "identify")
        dispatch.tick()
    assert not request.done
    monkeypatch.setattr(dispatcher, "PATIENCE", 0.02)
    time.sleep(0.04)
    dispatch.update(updates[-1] if updates else {})  # type: ignore[arg-type]
    dispatch.tick()
    with pytest.raises(ClusterError) as caught:
        request.wait()
    assert str(caught.value) == message
    (late,) = requests(1)
    dispatch.ask(late)
    assert late.fault is request.fault


def test_a_silent_scheduler_ends_the_render(monkeypatch: pytest.MonkeyPatch) -> None:
    _, dispatch, queued = started({"a": 1}, 1)
    monkeypatch.setattr(dispatcher, "PATIENCE", 0.02)
    time.sleep(0.04)
    dispatch.tick()
    with pytest.raises(ClusterError, match=r"^the scheduler tcp://here:8786 does not answer any more$"):
        queued[0].wait()


def test_an_error_is_tried_again_and_then_told() -> None:
    wire, dispatch, queued = started({"a": 1}, 1)
    run(wire, dispatch, 2)
    for k in range(dispatcher.TRIES):
        assert not queued[0].done
        wire.answer(draws, packing.pack({"error": f"ValueError: number {k}"}))
        dispatch.tick()
    with pytest.raises(ClusterError, match=r"^worker a: ValueError: number 2$"):
        queued[0].wait()


def test_a_request_that_ends_its_workers_ends_the_render() -> None:
    wire, dispatch, queued = started({"w0": 1}, 1)
    for k in range(1, dispatcher.LOSSES + 1):
        assert not queued[0].done
        for _ in range(4):
            wire.answer(lambda worker, about: about["do"] != "draw")
            dispatch.tick()
        dispatch.update({f"w{k}": (1, 0.0, False)})
        wire.answer(draws, Lost())
    with pytest.raises(ClusterError, match=r"^10 workers ended while they drew the same part"):
        queued[0].wait()


def test_cancelled_requests_end_without_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dispatcher, "CHECK", -1.0)
    cancel = threading.Event()
    _, dispatch, queued = started({}, 5, cancel=cancel)
    cancel.set()
    dispatch.tick()
    assert [request.wait() for request in queued] == [None] * 5


@pytest.mark.parametrize("seed", range(30))
def test_all_is_done_whatever_happens(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Random deaths, joins, stalls, lost answers and errors; from time to time a worker answers."""
    monkeypatch.setattr(dispatcher, "COALESCE", 0.0)
    monkeypatch.setattr(dispatcher, "LEAST", 0.0)
    monkeypatch.setattr(dispatcher, "TRIES", 1000)
    monkeypatch.setattr(dispatcher, "LOSSES", 1000)
    rng = random.Random(seed)
    wire, dispatch, queued = started({"w0": 1, "w1": 2}, 120)
    workers, clock, stalled = {"w0": 1, "w1": 2}, 1.0, set[str]()
    for step in range(3000):
        event = rng.random()
        if event < 0.03 and len(workers) > 1:
            ended = rng.choice(list(workers))
            del workers[ended]
            wire.kept.pop(ended, None)
        elif event < 0.06:
            workers[f"w{step}"] = rng.randint(1, 3)
        elif event < 0.09:
            stalled = {name for name in workers if rng.random() < 0.3}
        clock += 1.0
        if event < 0.2:
            monkeypatch.setattr(dispatcher, "SILENCE", -1.0 if stalled else 1e9)
            dispatch.update({name: (n, 0.0 if name in stalled else clock, False) for name, n in workers.items()})
            monkeypatch.setattr(dispatcher, "SILENCE", 1e9)
        fault: Any = Lost() if event > 0.9 else packing.pack({"error": "x"}) if event > 0.85 else None
        chosen = rng.choice([*workers, "gone"])
        answering = ({chosen} - stalled) | ({message[0] for message in wire.sent} - workers.keys())
        wire.answer(lambda worker, about, answering=answering: worker in answering, fault)
        dispatch.tick()
        if all(request.done for request in queued):
            break
    check(queued)
