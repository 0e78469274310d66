"""Tests of the light tree: probabilities sum to one, match `choose`, and are nonzero for contributing lights."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from maquette.render.light import light_tree


def lamps(count, rng, around=False):
    place = rng.uniform(-2.0, 2.0, (count, 3))
    size = rng.uniform(0.0, 0.2, (count, 3))
    axis = rng.normal(size=(count, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    spread = np.where(rng.random(count) < 0.3, math.pi, 0.0) if not around else np.full(count, math.pi)
    edge = rng.uniform(0.2, 0.5 * math.pi, count)
    return light_tree.Bounds(place - size, place + size, axis, spread, edge, rng.uniform(0.1, 5.0, count))


def directions(rng, n):
    vectors = rng.normal(size=(3, n))
    return tuple(vectors / np.linalg.norm(vectors, axis=0))


def points(rng, n):
    return tuple(rng.uniform(-4.0, 4.0, (3, n)))


@pytest.mark.long
@settings(max_examples=40, deadline=None)
@given(count=st.integers(0, 70), far=st.integers(0, 3), seed=st.integers(0, 1000))
def test_chances_add_up_to_one(count, far, seed):
    """Over all lamps, at any place that anything shines to; less where a node's bounds promise more than its lamps hold."""
    rng = np.random.default_rng(seed)
    tree = light_tree.build(rng.uniform(0.1, 1.0, far), lamps(count, rng))
    position = points(rng, 50)
    chances = [light_tree.chance(tree, np.full(50, row), position, None) for row in range(far + count)]
    total = np.sum(chances, axis=0) if chances else np.zeros(50)
    reached = light_tree.choose(tree, position, None, np.full(50, 0.5))[1] > 0.0
    assert np.all(total <= 1.0 + 1e-9)
    if count & (count - 1) == 0:  # no leaf stands for nothing
        assert total[reached] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.long
@settings(max_examples=30, deadline=None)
@given(count=st.integers(1, 300), far=st.integers(0, 3), seed=st.integers(0, 1000), facing=st.booleans())
def test_what_is_chosen_has_the_chance_that_is_told(count, far, seed, facing):
    rng = np.random.default_rng(seed)
    tree = light_tree.build(rng.uniform(0.1, 1.0, far), lamps(count, rng))
    position = points(rng, 200)
    normal = tuple(np.where(rng.random(200) < 0.1, 0.0, c) for c in directions(rng, 200)) if facing else None
    row, chance = light_tree.choose(tree, position, normal, rng.random(200))
    assert ((row >= 0) & (row < far + count)).all()
    assert count < 20 or (chance > 0).mean() > (0.3 if facing else 0.5)
    assert chance == pytest.approx(np.where(chance > 0, light_tree.chance(tree, row, position, normal), 0.0), rel=1e-9)


@pytest.mark.long
def test_lamps_are_chosen_as_often_as_is_told():
    """20 lamps, even steps of the number that chooses: each share to 1 in 100,000."""
    rng = np.random.default_rng(5)
    tree = light_tree.build(np.array([0.2]), lamps(20, rng, around=True))
    n = 200_000
    position = tuple(np.full(n, c) for c in (0.3, -1.0, 0.7))
    row, _ = light_tree.choose(tree, position, None, (np.arange(n) + 0.5) / n)
    share = np.bincount(row, minlength=21) / n
    expected = [light_tree.chance(tree, np.array([k]), tuple(c[:1] for c in position), None)[0] for k in range(21)]
    assert share == pytest.approx(expected, abs=2e-5)


@pytest.mark.long
@settings(max_examples=40, deadline=None)
@given(count=st.integers(1, 100), seed=st.integers(0, 1000))
def test_what_gives_light_can_be_chosen(count, seed):
    """A place within a lamp's spread, seen from any point of its box, has a chance above nothing."""
    rng = np.random.default_rng(seed)
    near = lamps(count, rng)
    tree = light_tree.build(np.zeros(0), near)
    for k in range(count):
        inside = near.low[k] + rng.random((20, 3)) * (near.high[k] - near.low[k])
        away = rng.normal(size=(20, 3))
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        lit = (near.spread[k] >= math.pi) | (away @ near.axis[k] > math.cos(near.edge[k]))
        position = tuple((inside + away * rng.uniform(0.01, 3.0, (20, 1))).T)
        assert np.all(light_tree.chance(tree, np.full(20, k), position, None)[lit] > 0.0)
        normal = directions(rng, 20)
        lit &= -np.sum(away * np.transpose(normal), axis=1) > 0.0
        assert np.all(light_tree.chance(tree, np.full(20, k), position, normal)[lit] > 0.0)


def test_lamps_behind_a_place_are_not_asked():
    """Half of 64 lamps around it: what is chosen is before it, but for where a node's bounds promised more than its lamps hold."""
    rng = np.random.default_rng(8)
    away = np.stack(directions(rng, 64), axis=1)
    away[:, 1] = np.where(np.arange(64) % 2 == 0, 1.0, -1.0) * (0.2 + np.abs(away[:, 1]))
    small = light_tree.Bounds(away, away, -away, np.full(64, math.pi), np.full(64, 0.5 * math.pi), np.ones(64))
    tree = light_tree.build(np.zeros(0), small)
    n = 10_000
    position, up = tuple(np.zeros((3, n))), tuple(np.array([[0.0], [1.0], [0.0]]) * np.ones(n))
    row, chance = light_tree.choose(tree, position, up, rng.random(n))
    before = (chance > 0.0) & (away[row, 1] > 0.0)
    blind = light_tree.choose(tree, position, None, rng.random(n))
    assert before.mean() > 0.9
    assert np.mean(away[blind[0], 1] > 0.0) < 0.6


def test_near_bright_lamps_are_preferred():
    """Of two equal lamps the one at half the distance is taken four times as often."""
    place = np.array([[0.0, 1.0, 0.0], [0.0, -2.0, 0.0]])
    near = light_tree.Bounds(place, place, np.tile([0.0, 1.0, 0.0], (2, 1)), np.full(2, math.pi), np.full(2, math.pi / 2), np.ones(2))
    tree = light_tree.build(np.zeros(0), near)
    origin = (np.zeros(1), np.zeros(1), np.zeros(1))
    chances = [light_tree.chance(tree, np.array([k]), origin, None)[0] for k in range(2)]
    assert chances == pytest.approx([0.8, 0.2])
