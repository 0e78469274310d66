"""The simulation of a cluster gives the closed forms of its limits."""

from __future__ import annotations

import numpy as np
import pytest
from maquette.bench import cluster
from maquette.bench.cluster import Model, simulate

EQUAL = np.full(2000, 0.1)


@pytest.mark.parametrize("workers", [1, 4, 20])
def test_without_costs_all_workers_are_busy(workers: int) -> None:
    assert simulate(Model(workers, 0.0, 0.0, 0.0), EQUAL) == pytest.approx(200.0 / workers)


@pytest.mark.parametrize("aim", [0.0, 0.5])
def test_one_worker_waits_for_the_first_message_and_the_last_answer(aim: float) -> None:
    """A message more than it draws hides the others: half of the cost at client and scheduler, and the network, each twice."""
    assert simulate(Model(1, 0.01, aim, 0.002), EQUAL) == pytest.approx(200.0 + 2.0 * 0.01 + 4.0 * 0.002)


def test_many_workers_wait_for_the_client() -> None:
    """It takes `cost` seconds for each message."""
    assert simulate(Model(1000, 0.01, 0.0, 0.0), EQUAL) == pytest.approx(2000 * 0.01, rel=0.02)


def test_messages_of_several_requests_cost_less() -> None:
    single, together = (simulate(Model(50, 0.01, aim, 0.001), EQUAL) for aim in (0.0, 0.5))
    assert together < 0.5 * single


def test_the_table_has_a_row_for_each_number_of_workers() -> None:
    about, table = cluster.simulation(500, 0.002)
    assert "500 requests" in about
    assert len(table.splitlines()) == 2 + len(cluster.WORKERS)
