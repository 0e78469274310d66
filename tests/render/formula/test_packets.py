"""Ray packets against implicit surfaces: the hits of a packet are those of its rays one by one."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from maquette.render.accel import ray_queries
from maquette.render.accel.formula_packets import packet_memory
from maquette.render.formula import packet_state, packets, tape_jit
from maquette.render.jit.packed_struct import Handle

from .test_surfaces import SURFACES, scene_of

NASTY = {
    "reciprocal": "implicit(|x, y, z| y <= 0.05 / x and y >= -0.8, within: 1)",
    "steps": "implicit(|x, y, z| y <= 0.2 * floor(4 * x) - 0.1, within: 1)",
    "tangent sheet": "implicit(|x, y, z| (x^2 + y^2 + z^2 - 0.64)^2 <= 1e-9)",
    "shell": "implicit(|x, y, z| abs(x^2 + y^2 + z^2 - 0.5) <= 1e-4)",
    "rows": "implicit(|x, y, z| hypot(mod(x, 0.5) - 0.25, mod(z, 0.5) - 0.25) <= 0.15 and abs(y) <= 0.6, within: 1)",
    "cut": "implicit(|x, y, z| y <= 0.2 * atan2(z, x), within: 1)",
    "balls": "union {{ {} }}".format("\n".join(f"sphere(0.12, center: [{x}, {y}, {z}])" for x, y, z in np.round(
        np.random.default_rng(5).uniform(-0.8, 0.8, (60, 3)), 3).tolist())),
}  # fmt: skip


def picture(eye: tuple[float, float, float], size: int = 64, half: float = 0.45) -> tuple[np.ndarray, np.ndarray]:
    """Rays of a pinhole camera that looks at the origin, in vectors of 4 × 4 pixels and groups of 16 × 16."""
    order = np.arange(size * size).reshape(size // 16, 4, 4, size // 16, 4, 4).transpose(0, 3, 1, 4, 2, 5).ravel()
    toward = -np.array(eye) / np.linalg.norm(eye)
    right = np.cross(toward, [0.1, 1.0, 0.2])
    right /= np.linalg.norm(right)
    up = np.cross(right, toward)
    x, y = (2 * (order % size + 0.5) / size - 1) * half, (1 - 2 * (order // size + 0.5) / size) * half
    direction = toward + x[:, None] * right + y[:, None] * up
    return np.tile(np.array(eye), (len(order), 1)), direction


def packet_hits(trees: Handle, o: np.ndarray, d: np.ndarray, t_max: float = np.inf) -> tuple[np.ndarray, ...]:
    """(t, spacing, u, v) of a packet of rays with the first implicit surface."""
    out = no_hits(len(o))
    assert trace(trees, o, d, t_max, out)
    return out.t, out.spacing, out.u, out.v


def no_hits(n: int) -> packets.HitColumns:
    return packets.HitColumns(np.full(n, np.inf), np.full(n, -1), np.zeros(n, np.int64), np.zeros(n), np.zeros(n), 0)


def trace(trees: Handle, o: np.ndarray, d: np.ndarray, t_max: float, out: packets.HitColumns) -> bool:
    packet = Handle(packet_memory.allocate(trees.tables.forms, 0))
    return packets.trace(packet, packet_state.ray_columns(o, d, 0.0, t_max), 0, len(o), np.eye(4)[:3], out) == len(o)


@pytest.mark.parametrize("eye", [(2.0, 1.2, 2.4), (-0.1, 2.6, 0.3), (0.25, 0.1, 0.3)], ids=["outside", "above", "within"])
@pytest.mark.parametrize("name", [*SURFACES, *NASTY])
def test_packets_hit_what_single_rays_hit(tmp_path, name, eye):
    tables = scene_of(tmp_path, {**SURFACES, **NASTY}[name]).tables
    trees = ray_queries.build(tables, closed=False)
    tape_jit.finish()
    o, d = picture(eye)
    alone = ray_queries.closest(trees, o, d)
    before = trees.tables.forms.unproved.copy()
    t, _, u, v = packet_hits(trees, o, d)
    sure = before[0] == 0 and trees.tables.forms.unproved[0] == 0
    differ = np.isfinite(t) != np.isfinite(alone.t)
    both = np.isfinite(t) & np.isfinite(alone.t)
    apart = np.abs(t[both] - alone.t[both]) > 1e-9 * (1 + alone.t[both])
    assert int(differ.sum() + apart.sum()) <= (0 if sure else 4)
    # the median ignores jumps, where the formula has no normal
    assert np.median(np.hypot(u - alone.u, v - alone.v)[both]) < 1e-5


def test_more_rays_than_a_packet_holds_are_traced_packet_by_packet(tmp_path):
    """Columns before the first one asked for stay unchanged."""
    tables = scene_of(tmp_path, SURFACES["torus"]).tables
    trees = ray_queries.build(tables, closed=False)
    o, d = picture((2.0, 1.2, 2.4), size=96)
    hits = packet_hits(trees, o, d)
    first = packet_state.RAYS
    assert len(o) > 2 * first
    behind = packet_hits(trees, o[first:].copy(), d[first:].copy())
    for column, behind_column in zip(hits, behind, strict=True):
        assert np.array_equal(column[first:], behind_column)
    later_hits, packet = no_hits(len(o)), Handle(packet_memory.allocate(trees.tables.forms, 0))
    assert packets.trace(packet, packet_state.ray_columns(o, d, 0.0, np.inf), first, len(o), np.eye(4)[:3], later_hits) == len(o)
    assert np.isinf(later_hits.t[:first]).all()
    assert np.array_equal(later_hits.t[first:], behind[0])


def test_packets_stop_at_t_max(tmp_path):
    tables = scene_of(tmp_path, SURFACES["torus"]).tables
    trees = ray_queries.build(tables, closed=False)
    o, d = picture((0.0, 0.0, 3.0))
    everything = packet_hits(trees, o, d)[0]
    near = np.quantile(everything[np.isfinite(everything)], 0.5)
    t = packet_hits(trees, o, d, near)[0]
    assert np.array_equal(np.isfinite(t), everything < near)


@pytest.mark.long
def test_a_part_of_a_packet_has_the_same_hits(tmp_path):
    """The number of rays in a packet changes only rounding."""
    tables = scene_of(tmp_path, SURFACES["blend"]).tables
    trees = ray_queries.build(tables, closed=False)
    o, d = picture((2.0, 1.2, 2.4))
    distances = packet_hits(trees, o, d)[0]
    for count in (1, 7, 100, 300, 1031):
        part = packet_hits(trees, o[500 : 500 + count].copy(), d[500 : 500 + count].copy())[0]
        hit = np.isfinite(part)
        assert np.array_equal(hit, np.isfinite(distances[500 : 500 + count]))
        assert np.abs(part[hit] - distances[500 : 500 + count][hit]).max(initial=0.0) < 1e-10


STEPPED = {
    "steps and balls": "hypot(mod(x + 0.25, 0.5) - 0.25, y - 0.2, mod(z + 0.25, 0.5) - 0.25) <= 0.2 or floor(5 * y) <= floor(5 * x) - 2",
    "rings": "y <= floor(5 * hypot(x, z)) / 8 - 0.6",
    "slanting steps": "hypot(x, y - 0.25 * floor(2 * x), z) <= 0.15 or y <= floor(2 * x + 0.1 * z) / 4 - 0.3",
}


@pytest.mark.long
@pytest.mark.parametrize("name", STEPPED)
def test_roots_at_jumps_are_the_same_in_every_packet(tmp_path, name):
    tables = scene_of(tmp_path, f"implicit(|x, y, z| {STEPPED[name]}, within: 1)").tables
    trees = ray_queries.build(tables, closed=False)
    o, d = picture((1.6, 1.5, 2.6))
    hits = packet_hits(trees, o, d)
    for count in (16, 256, 1024):
        parts = [packet_hits(trees, o[first : first + count].copy(), d[first : first + count].copy()) for first in range(0, len(o), count)]
        t, _, u, v = (np.concatenate(column) for column in zip(*parts, strict=True))
        hit = np.isfinite(t)
        assert np.array_equal(hit, np.isfinite(hits[0]))
        assert np.abs(t[hit] - hits[0][hit]).max() < 1e-14
        assert np.hypot(u - hits[2], v - hits[3])[hit].max() < 1e-4  # normals of balls, at roots found in single precision
    assert int(trees.tables.forms.unproved[0]) == 0


def test_risers_between_steps_have_their_own_normals(tmp_path):
    """The normals of treads point up and those of risers along −x, for any slope of the formula beside them."""
    tables = scene_of(tmp_path, "implicit(|x, y, z| y <= 0.2 * floor(4 * x), within: 1)").tables
    trees = ray_queries.build(tables, closed=False)
    o, d = picture((-1.6, 1.5, 2.6))
    alone = ray_queries.closest(trees, o, d)
    for t, _, u, v in (packet_hits(trees, o, d), (alone.t, alone.primitive, alone.u, alone.v)):
        hit = np.isfinite(t)
        x, y, z = (o + np.where(hit, t, 0.0)[:, None] * d).T
        riser = hit & (np.abs(4 * x - np.rint(4 * x)) < 1e-9) & (np.abs(x) < 0.99) & (np.abs(z) < 0.99)
        riser &= np.abs(y - 0.2 * np.rint(4 * x)) > 1e-3
        riser &= np.abs(y - 0.2 * np.rint(4 * x) + 0.2) > 1e-3
        assert riser.sum() > 50
        assert np.abs(u[riser] + 1.0).max() < 1e-4
        assert np.abs(v[riser]).max() < 1e-4


def test_incoherent_rays_are_no_packet(tmp_path):
    tables = scene_of(tmp_path, SURFACES["torus"]).tables
    trees = ray_queries.build(tables, closed=False)
    o = np.array([[0.0, 0.0, 1000.0], [3.0, 0.0, 0.0]])
    d = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    assert not trace(trees, o, d, np.inf, no_hits(2))


@pytest.mark.long
@pytest.mark.parametrize("isa", ["avx2", "sse", "scalar"])
def test_packets_on_narrower_machines(isa):
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", __file__]
    done = subprocess.run(command, env={**os.environ, "MAQUETTE_SIMD": isa}, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout


@pytest.mark.long
@pytest.mark.parametrize("name", ["heart", "teeth", "blend"])
def test_a_packet_does_not_depend_on_the_packet_before(tmp_path, name):
    """A thread's memory is used again; packets of an adaptive picture have any number of rays."""
    trees = ray_queries.build(scene_of(tmp_path, SURFACES[name]).tables, closed=False)
    tape_jit.finish()
    rng = np.random.default_rng(4)

    def hits_of(packet: Handle, o: np.ndarray, d: np.ndarray) -> packets.HitColumns:
        out = no_hits(len(o))
        packets.trace(packet, packet_state.ray_columns(o, d, 0.0, np.inf), 0, len(o), np.eye(4)[:3], out)
        return out

    used = Handle(packet_memory.allocate(trees.tables.forms, 0))
    for turn in range(24):
        o, d = picture(tuple(2.5 * rng.normal(size=3)), half=0.02 + 0.3 * rng.random())
        if turn % 2:
            some = np.sort(rng.choice(len(o), rng.integers(20, 3000), replace=False))
            o, d = o[some], d[some] + 0.1 * rng.normal(size=3)
        fresh = hits_of(Handle(packet_memory.allocate(trees.tables.forms, 0)), o, d)
        for column, fresh_column in zip(hits_of(used, o, d)[:5], fresh[:5], strict=True):
            assert np.array_equal(column, fresh_column)


def test_surfaces_share_the_memory_of_a_thread(tmp_path):
    """Packets on one surface leave nothing behind that a packet on another reads."""
    trees = ray_queries.build(scene_of(tmp_path, "\n".join(SURFACES[name] for name in ("heart", "teeth", "blend"))).tables, closed=False)
    tape_jit.finish()
    rng, forms = np.random.default_rng(5), trees.tables.forms
    shared = [Handle(state) for state in packet_memory.allocate_shared(forms, [0, 1, 2])]
    for turn in range(24):
        o, d = picture(tuple(2.5 * rng.normal(size=3)), half=0.02 + 0.3 * rng.random())
        results = []
        for packet in (shared[turn % 3], Handle(packet_memory.allocate(forms, turn % 3))):
            out = no_hits(len(o))
            packets.trace(packet, packet_state.ray_columns(o, d, 0.0, np.inf), 0, len(o), np.eye(4)[:3], out)
            results.append(out[:5])
        for column, fresh_column in zip(*results, strict=True):
            assert np.array_equal(column, fresh_column)
