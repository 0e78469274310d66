"""The first estimate of a chart: its answer, and a chart that ends at once where the budget is too small."""

from __future__ import annotations

from typing import Any

import pytest
from maquette.compiler import ir
from maquette.measure.chart import contestant, engine, estimate, reference
from maquette.measure.records import NothingMeasured, Wanted

ROOM = estimate.Estimate("paths", 480 * 320, error=0.5, wrong=1.2, start=2.0, each=2e-6)


def test_noise_falls_with_the_root_of_the_samples_and_time_grows_with_them() -> None:
    count, low, high = ROOM.samples(0.02)
    assert count == pytest.approx(625)
    assert (low, high) == (pytest.approx(625 / 1.56), pytest.approx(625 * 1.56))
    assert ROOM.samples(0.01)[0] == pytest.approx(4 * count)
    assert ROOM.seconds(count) == pytest.approx(2.0 + 2e-6 * 480 * 320 * 625)
    assert ROOM.samples(0.9) == (1.0, 1.0, pytest.approx(1.56))


def test_the_answer_names_samples_and_time_with_their_bounds() -> None:
    assert ROOM.answer(0.02) == (
        "2 %: ray with paths, about 620 samples (400 to 980), about 3.2 min (2.1 min to 5.0 min), estimated from small pictures"
    )


def test_a_budget_that_is_too_small_is_told_at_once(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene) -> None:
    def refuse(*given: Any) -> None:
        raise AssertionError("something is measured")

    monkeypatch.setattr(estimate, "make", lambda *given: ROOM)
    monkeypatch.setattr(reference, "known_samples", lambda *given: 0)
    monkeypatch.setattr(reference, "make", refuse)
    monkeypatch.setattr(contestant, "backend_contestant", refuse)
    with pytest.raises(NothingMeasured) as raised:
        engine.measure(scene, Wanted("a.scene", ir.Settings(size=(480, 320)), budget=10.0))
    assert raised.value.answer == ROOM.answer(0.02)
    assert str(raised.value) == (
        "the least chart takes about 30 s, and one that measures 2 % about 1.7 h, of the 10 s there are: "
        "give a longer --budget or a smaller --size"
    )


def test_a_reference_on_disk_makes_a_chart_cheaper(monkeypatch: pytest.MonkeyPatch, scene: ir.Scene) -> None:
    monkeypatch.setattr(estimate, "make", lambda *given: ROOM)
    monkeypatch.setattr(reference, "known_samples", lambda *given: 1 << 20)
    with pytest.raises(NothingMeasured, match=r"the least chart takes about 1[12] s, and one that measures 2 % about 16 min"):
        engine.measure(scene, Wanted("a.scene", ir.Settings(size=(480, 320)), budget=5.0))


@pytest.fixture
def scene(tmp_path: Any) -> ir.Scene:
    from maquette import load

    path = tmp_path / "a.scene"
    path.write_text("sphere(1, material: lambert(0.5))\nsun()\ncamera(position: [0, 1, 5], look_at: [0, 0, 0])\n", encoding="utf-8")
    return load(path)
