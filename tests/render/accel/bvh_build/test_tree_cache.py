"""BVH cache: equal results from build, memory and disk; damaged files are rebuilt."""

from __future__ import annotations

import gc
import weakref
from pathlib import Path

import numpy as np
import pytest
from maquette.render.accel import scene_bvh
from maquette.render.accel.bvh_build import tree_cache, wide_bvh
from maquette.render.jit import cache_folder, kernel_cache

from ...tables import scene
from ...tracing import random_rays, same, wavy


@pytest.fixture(autouse=True)
def _apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A temporary cache folder, where small meshes count as large."""
    monkeypatch.setattr(kernel_cache, "CACHE", tmp_path)
    monkeypatch.setattr(tree_cache, "LARGE", 100)
    tree_cache.clear()


def mesh(cells: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    data = wavy(cells, seed)
    return data.positions.astype(np.float32), data.triangles.astype(np.int32)


def files(folder: Path) -> list[Path]:
    return sorted((folder / "trees").iterdir()) if (folder / "trees").exists() else []


def assert_equal(a: wide_bvh.Wide, b: wide_bvh.Wide) -> None:
    for first, second in zip(a, b, strict=True):
        np.testing.assert_array_equal(first, second)
        assert first.dtype == second.dtype


def test_memory_and_disk_return_what_was_built(tmp_path: Path) -> None:
    positions, triangles = mesh(20)
    built = tree_cache.cached_mesh_bvh(positions, triangles)
    assert_equal(built, wide_bvh.build(positions, triangles))
    assert tree_cache.cached_mesh_bvh(positions.copy(), triangles.copy()) is built
    assert len(files(tmp_path)) == 1
    tree_cache.clear()
    read = tree_cache.cached_mesh_bvh(positions, triangles)
    assert read is not built
    assert_equal(read, built)


def test_another_vertex_is_another_bvh(tmp_path: Path) -> None:
    positions, triangles = mesh(20)
    built = tree_cache.cached_mesh_bvh(positions, triangles)
    moved = positions.copy()
    moved[7, 1] = np.nextafter(moved[7, 1], np.float32(9))
    assert tree_cache.cached_mesh_bvh(moved, triangles) is not built
    assert tree_cache.cached_mesh_bvh(positions, triangles[::-1]) is not built
    assert len(files(tmp_path)) == 2  # the first was refitted, which is done as fast as it would be read


def test_small_meshes_are_not_written(tmp_path: Path) -> None:
    tree_cache.cached_mesh_bvh(*mesh(5))
    assert files(tmp_path) == []


@pytest.mark.parametrize("damage", ["empty", "short", "long", "foreign", "a folder"])
def test_damaged_files_are_rebuilt(tmp_path: Path, damage: str) -> None:
    positions, triangles = mesh(20)
    built = tree_cache.cached_mesh_bvh(positions, triangles)
    (file,) = files(tmp_path)
    content = file.read_bytes()
    file.unlink()
    if damage == "a folder":
        file.mkdir()
    else:
        file.write_bytes({"empty": b"", "short": content[:-4], "long": content + b"0000", "foreign": b"x" * len(content)}[damage])
    tree_cache.clear()
    assert_equal(tree_cache.cached_mesh_bvh(positions, triangles), built)
    if damage != "a folder":
        assert file.read_bytes() == content


def test_an_unwritable_folder_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "trees").write_text("in the way")
    positions, triangles = mesh(20)
    assert_equal(tree_cache.cached_mesh_bvh(positions, triangles), wide_bvh.build(positions, triangles))


@pytest.mark.long
def test_folder_and_memory_are_limited(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sizes = [tree_cache.cached_mesh_bvh(*mesh(20, seed)).nbytes for seed in range(3)]
    tree_cache.clear()
    monkeypatch.setattr(cache_folder, "root", lambda: tmp_path)
    monkeypatch.setenv("MAQUETTE_CACHE_SIZE", str(3 * max(sizes) + 16 * 3))
    monkeypatch.setattr(tree_cache, "IN_MEMORY", 2 * max(sizes))
    parts: list[weakref.ref[np.ndarray]] = []
    for seed in range(3, 9):
        parts += map(weakref.ref, tree_cache.cached_mesh_bvh(*mesh(20, seed)))
        assert sum(file.stat().st_size for file in files(tmp_path)) <= 3 * max(sizes) + 16 * 3
    newest = tree_cache.cached_mesh_bvh(*mesh(20, 8))
    assert tree_cache.cached_mesh_bvh(*mesh(20, 8)) is newest
    gc.collect()
    alive = [part for reference in parts if (part := reference()) is not None]
    assert sum(part.nbytes for part in alive) <= 3 * max(sizes)  # two BVHs, and the one that is refitted


@pytest.mark.long
def test_scenes_share_bvhs_with_their_own_triangle_numbers() -> None:
    first, second = wavy(20, 1), wavy(20, 2)
    for meshes in ([first], [second, first], [first, second, first]):
        tables = scene(meshes=[(each, np.eye(4), 0) for each in meshes])
        assert sorted(row for row in scene_bvh.build(tables).wide.rows.ravel() if row >= 0) == list(range(800 * min(len(meshes), 2)))
        same(tables, random_rays(500, 3))
