"""Parallel BVH builds and their collapse: optimal cost, complete parts, no thread waits forever."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from maquette.render.accel.bvh_build import binned_sah, parallel_build, wide_bvh, wide_collapse
from maquette.render.accel.bvh_build.parallel_build import Mesh
from maquette.render.jit import arena

from ...tracing import wavy


def mesh_of(corners: np.ndarray) -> Mesh:
    return Mesh(corners.reshape(-1, 3).astype(np.float32), np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3))


def grown(mesh: Mesh, threads: int = 1):
    with arena.arena(parallel_build.bytes_of(len(mesh.triangles))) as memory:
        growth = parallel_build.build_over_triangles(mesh, threads, memory).tables
        tree = binned_sah.BinaryBvh(*(part.copy() for part in growth.tree))
        return growth._replace(tree=tree, share=growth.share.copy())


def area(box: np.ndarray) -> float:
    x, y, z = -(box[:3] + box[4:7]).astype(float)
    return x * y + y * z + z * x


@pytest.mark.parametrize("n", [1, 5, 40, 300])
def test_no_collapse_of_the_same_binary_bvh_costs_less(n: int) -> None:
    """Against all slot distributions, by definition."""
    corners = np.random.default_rng(n).uniform(-1, 1, (n, 1, 3)) + np.random.default_rng(n + 1).uniform(-0.1, 0.1, (n, 3, 3))
    mesh = mesh_of(corners)
    tree = grown(mesh).tree
    costs: dict[tuple[int, int], float] = {}

    def least(node: int, children: int) -> float:
        """Cost of a node with up to a number of slots."""
        if (node, children) not in costs:
            alone, second = wide_collapse.TEST * area(tree.boxes[node]), tree.second[node]
            if children > 1:
                ways = [least(node, children - 1), *(shared(node, p, children - p) for p in range(1, children) if second)]
            else:
                ways = [area(tree.boxes[node]) + own(node)] if second else [alone]
                ways += [alone] if tree.count[node] <= wide_collapse.WIDTH and node else []
            costs[node, children] = min(ways)
        return costs[node, children]

    def shared(node: int, first: int, second: int) -> float:
        half = tree.second[node]
        return least(half - 1, first) + least(half, second)

    def own(node: int) -> float:
        return min(shared(node, p, wide_collapse.WIDTH - p) for p in range(1, wide_collapse.WIDTH))

    wide = wide_bvh.build(*mesh)
    planes = wide.nodes.reshape(-1, 3, 2, wide_collapse.WIDTH).astype(float)
    x, y, z = np.moveaxis(planes[:, :, 1] - planes[:, :, 0], 1, 0)
    areas = np.where(wide.links > wide_bvh.EMPTY, x * y + y * z + z * x, 0.0)
    cost = areas[wide.links >= 0].sum() + wide_collapse.TEST * areas[wide.links < 0].sum()
    np.testing.assert_allclose(cost, own(0) if tree.second[0] else least(0, 1), rtol=1e-4)


def test_parts_are_complete_and_contiguous() -> None:
    sheet = wavy(150)
    growth = grown(Mesh(sheet.positions.astype(np.float32), sheet.triangles.astype(np.int32)), 3)
    count, nodes, leaves = growth.sizes
    parts, tasks = growth.parts[:count], growth.tasks[: growth.counters[parallel_build.MADE]]
    leaf_tasks = tasks[tasks[:, parallel_build.BELOW] == 0]
    assert count == len(leaf_tasks) + 1  # and what is above them
    assert growth.tree.count[leaf_tasks[:, parallel_build.NODE]].max() <= parallel_build.PART
    assert growth.tree.count[leaf_tasks[:, parallel_build.NODE]].sum() == len(sheet.triangles)
    assert np.all(np.diff(parts[:, 0]) > 0)
    leaf_tasks = leaf_tasks[np.argsort(leaf_tasks[:, parallel_build.NODE])]
    np.testing.assert_array_equal(np.diff([*parts[1:, 1], nodes]), leaf_tasks[:, parallel_build.NODES])
    np.testing.assert_array_equal(np.diff([*parts[1:, 2], leaves]), leaf_tasks[:, parallel_build.LEAVES])
    numbers = growth.tree.items.view(np.int32)[:, binned_sah.NUMBER] & ~binned_sah.TAG
    np.testing.assert_array_equal(np.sort(numbers), np.arange(len(sheet.triangles)))


def test_endlessly_shrinking_boxes_split_at_the_median() -> None:
    """Each plane separates one item of sixteen: without median splits the depth would exceed the task list."""
    n = 60_000
    corners = np.exp2(-np.linspace(0, 120, n))[:, None, None] * np.eye(3)
    growth = grown(mesh_of(corners), 2)
    assert growth.counters[parallel_build.MADE] < len(growth.tasks)
    assert growth.tasks[: growth.counters[parallel_build.MADE], parallel_build.LEVEL].max() <= binned_sah.DEEPEST + n.bit_length()


def test_a_failing_thread_ends_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    sheet, real, failed = wavy(150), parallel_build.build_worker, threading.Event()

    def take_part(growth, mine):
        if not failed.is_set():
            failed.set()
            growth.tables.counters[parallel_build.TAKEN] = 1  # with the root in its hands: nothing will ever be ready
            raise ArithmeticError("of one thread")
        return real(growth, mine)

    monkeypatch.setattr(parallel_build, "build_worker", take_part)
    with pytest.raises(ArithmeticError, match="of one thread"):
        wide_bvh.build(sheet.positions.astype(np.float32), sheet.triangles.astype(np.int32), 2)


def test_a_waiting_thread_yields_and_resumes_its_task() -> None:
    """A single worker without a ready task returns False; once the task is ready, the next call finishes."""
    items = np.zeros((9, 8), np.float32)
    items[:, binned_sah.COUNT], items[:, 0], items[:, 4] = 1.0, np.arange(9), -np.arange(9)
    items.view(np.int32)[:, binned_sah.NUMBER] = np.arange(9) | binned_sah.TAG
    with arena.arena(parallel_build.bytes_of(9)) as memory:
        growth = parallel_build.allocate_state(Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32)), 9, memory)
        growth.tree.items[:], growth.tree.boxes[:2] = items, binned_sah.bounds_of(items)
        shared, mine = parallel_build.Handle(growth), np.full(1, -1)
        assert not parallel_build.build_worker(shared, mine)
        assert mine[0] == 0
        growth.ready[0] = 1
        assert parallel_build.build_worker(shared, mine)
        assert growth.sizes[2] == 9
