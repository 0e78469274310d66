"""The simulation of a cluster gives the closed forms of its limits."""

from __future__ import annotations

from unittest import mock

import numpy as np
import pytest
from maquette.bench import cluster
from maquette.bench.cluster import simulate
from maquette.render.cluster import dispatcher

EQUAL = np.full(2000, 0.1)


@pytest.mark.parametrize("workers", [1, 4, 20])
def test_without_costs_all_workers_are_busy(workers: int) -> None:
    found = simulate(workers, 0.0, EQUAL)
    assert 200.0 / workers < found.seconds < 1.1 * 200.0 / workers + dispatcher.AIM


@pytest.mark.long
def test_many_workers_wait_for_the_client() -> None:
    """It takes `cost` seconds for each message, and the scheduler as long beside it."""
    found = simulate(500, 0.02, EQUAL)
    assert found.seconds == pytest.approx(0.02 * found.messages, rel=0.1)
    assert found.seconds > 10 * 200.0 / 500


@pytest.mark.long
def test_messages_of_several_requests_cost_less() -> None:
    together = simulate(20, 0.02, EQUAL)
    with mock.patch.object(dispatcher, "AIM", 0.0):
        single = simulate(20, 0.02, EQUAL)
    assert together.messages < 0.6 * single.messages
    assert single.messages >= 2000
    assert together.seconds < 0.5 * single.seconds


@pytest.mark.long
def test_the_table_has_a_row_for_each_number_of_workers() -> None:
    about, table = cluster.simulation(500, 0.002)
    assert "500 requests" in about
    assert len(table.splitlines()) == 2 + len(cluster.WORKERS)
