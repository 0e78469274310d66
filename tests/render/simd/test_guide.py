"""The example of docs/simd.md against numpy."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import numpy as np

GUIDE = Path(__file__).resolve().parents[3] / "docs" / "simd.md"


def example(folder: Path):
    """The longest block of Python in the guide, as a module."""
    blocks = re.findall(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.S)
    path = folder / "nearest_sphere.py"
    path.write_text(max(blocks, key=len), encoding="utf-8")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_nearest_spheres_of_a_wave(tmp_path):
    random, n = np.random.default_rng(0), 64 * 16
    origins = random.normal(size=(n, 3)) + [0, 0, 20]
    spheres = np.concatenate([random.normal(size=(9, 3)) * 3, random.uniform(0.2, 1.5, (9, 1))], axis=1).astype(np.float32)
    directions = random.normal(size=(n, 3)) * 4 - origins
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rays = np.concatenate([origins, directions], axis=1).T.astype(np.float32).copy()
    t, which, hitting = np.zeros(n, np.float32), np.zeros(n, np.int32), np.zeros(n, np.int32)
    total = example(tmp_path).nearest(rays, spheres, t, which, hitting)

    o, d, c, r = rays[:3].T[:, None].astype(float), rays[3:].T[:, None].astype(float), spheres[None, :, :3].astype(float), spheres[:, 3]
    along = ((c - o) * d).sum(-1)
    inside = r.astype(float) ** 2 - ((c - o - along[..., None] * d) ** 2).sum(-1)
    distances = np.where(inside >= 0, along - np.sqrt(np.maximum(inside, 0)), np.inf)
    clear = np.abs(inside).min(axis=1) > 1e-4  # rays that graze a sphere may go either way
    hit = np.isfinite(distances.min(axis=1))
    assert clear.sum() > 0.98 * n
    assert 0.1 < hit.mean() < 0.9
    assert np.array_equal(which[clear], np.where(hit, distances.argmin(axis=1), -1)[clear])
    assert np.allclose(t[clear & hit], distances.min(axis=1)[clear & hit], rtol=1e-5)
    assert np.all(np.isinf(t[clear & ~hit]))
    assert total == (which >= 0).sum()
    assert np.array_equal(hitting[:total], np.flatnonzero(which >= 0))
