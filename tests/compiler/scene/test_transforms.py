"""Transforms: rotations of every kind agree, inverses invert, and what is flat is told from what is small."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from maquette.compiler.scene import transforms
from maquette.lang.elements import AxisAngle, Euler, Quaternion

angles = st.floats(-10, 10)
coordinates = st.floats(-100, 100)
vectors = st.tuples(coordinates, coordinates, coordinates)
axes = vectors.filter(lambda v: math.hypot(*v) > 1e-3)


def turn(angle: float, *axis: float) -> np.ndarray:
    return transforms.rotation(AxisAngle((axis[0], axis[1], axis[2]), angle))[:3, :3]


@given(st.one_of(st.builds(Euler, st.tuples(angles, angles, angles)), st.builds(AxisAngle, axes, angles)))
def test_a_rotation_is_orthogonal_with_determinant_one(rotation: Euler | AxisAngle) -> None:
    r = transforms.rotation(rotation)[:3, :3]
    assert np.abs(r @ r.T - np.eye(3)).max() < 1e-14
    assert np.linalg.det(r) == pytest.approx(1, abs=1e-14)


@given(axes, angles)
def test_quaternion_and_axis_agree(axis: tuple[float, float, float], angle: float) -> None:
    s = math.sin(angle / 2) / math.hypot(*axis)
    quaternion = Quaternion(axis[0] * s * 3, axis[1] * s * 3, axis[2] * s * 3, math.cos(angle / 2) * 3)  # 3: it is normalised
    assert np.abs(transforms.rotation(quaternion) - transforms.rotation(AxisAngle(axis, angle))).max() < 1e-13


@given(angles, angles, angles)
def test_euler_turns_about_fixed_x_then_y_then_z(x: float, y: float, z: float) -> None:
    one_by_one = turn(z, 0, 0, 1) @ turn(y, 0, 1, 0) @ turn(x, 1, 0, 0)
    assert np.abs(transforms.rotation(Euler((x, y, z)))[:3, :3] - one_by_one).max() < 1e-14


def test_a_quarter_turn_about_y_takes_z_to_x() -> None:
    assert transforms.rotation(Euler((0.0, math.pi / 2, 0.0)))[:3, :3] @ [0, 0, 1] == pytest.approx([1, 0, 0], abs=1e-15)


def test_rotations_do_not_commute() -> None:
    x, y = turn(math.pi / 2, 1, 0, 0), turn(math.pi / 2, 0, 1, 0)
    assert (x @ y) @ [1, 0, 0] == pytest.approx([0, 1, 0], abs=1e-15)
    assert (y @ x) @ [1, 0, 0] == pytest.approx([0, 0, -1], abs=1e-15)


@pytest.mark.parametrize("roll", [0.3, -1.2, 2.9])
@pytest.mark.parametrize("yaw", [0.7, -2.1])
def test_gimbal_lock_leaves_one_turn(roll: float, yaw: float) -> None:
    """With the middle angle at 90° Euler angles turn by roll − yaw only; the quaternion of the same turn gives the same matrix."""
    locked = transforms.rotation(Euler((roll, math.pi / 2, yaw)))
    assert np.abs(locked - transforms.rotation(Euler((roll - yaw, math.pi / 2, 0.0)))).max() < 1e-12
    half_x, half_y, half_z = (roll / 2, math.pi / 4, yaw / 2)
    (sx, cx), (sy, cy), (sz, cz) = ((math.sin(h), math.cos(h)) for h in (half_x, half_y, half_z))
    quaternion = Quaternion(  # q_z q_y q_x
        sx * cy * cz - cx * sy * sz, cx * sy * cz + sx * cy * sz, cx * cy * sz - sx * sy * cz, cx * cy * cz + sx * sy * sz
    )
    assert np.abs(locked - transforms.rotation(quaternion)).max() < 1e-12


def test_ten_thousand_rotations_keep_volume() -> None:
    made = transforms.identity()
    step = transforms.rotation(AxisAngle((1.0, 2.0, 3.0), 0.1))
    for _ in range(10_000):
        made = made @ step
    assert np.linalg.det(made) == pytest.approx(1, abs=1e-12)
    assert np.abs(made - transforms.rotation(AxisAngle((1.0, 2.0, 3.0), 1000.0))).max() < 1e-11


@pytest.mark.long
@given(vectors, axes, angles, st.tuples(*[st.floats(1e-6, 1e6)] * 3))
def test_an_inverse_inverts(move: tuple, axis: tuple, angle: float, scale: tuple) -> None:
    matrix = transforms.place(move, AxisAngle(axis, angle), scale)
    inverse = transforms.inverse(matrix)
    assert inverse is not None
    assert np.abs(matrix[:3, :3] @ inverse[:, :3] - np.eye(3)).max() < 1e-12


def test_place_scales_then_rotates_then_translates() -> None:
    placed = transforms.place((10, 0, 0), Euler((0.0, 0.0, math.pi / 2)), (2, 1, 1))
    assert placed @ [1, 0, 0, 1] == pytest.approx([10, 2, 0, 1], abs=1e-15)


@pytest.mark.parametrize("scale", [(1, 1, 0), (0, 0, 0), (1, math.inf, 1), (1, math.nan, 1)])
def test_what_is_flat_has_no_inverse(scale: tuple[float, float, float]) -> None:
    with np.errstate(invalid="ignore"):
        assert transforms.inverse(transforms.scaling(scale)) is None


def test_a_skew_onto_a_plane_has_no_inverse() -> None:
    assert transforms.inverse(transforms.from_rows([[1, 2, 3, 0], [2, 4, 6, 0], [0, 0, 1, 0]])) is None


@pytest.mark.parametrize("scale", [(1e-9, 1e-9, 1e-9), (1, 1, 1e-12), (1e9, 1, 1), (-1, 1, 1)])
def test_what_is_small_or_stretched_or_mirrored_has_one(scale: tuple[float, float, float]) -> None:
    inverse = transforms.inverse(transforms.scaling(scale))
    assert inverse is not None
    assert np.diag(inverse) == pytest.approx([1 / s for s in scale])


def test_from_rows_refuses_a_projection() -> None:
    with pytest.raises(ValueError, match="the last row of a matrix is 0, 0, 0, 1"):
        transforms.from_rows([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 1, 0]])


def test_a_rotation_needs_an_axis() -> None:
    with pytest.raises(ValueError, match="an axis of rotation cannot be 0"):
        transforms.rotation(AxisAngle((0.0, 0.0, 0.0), 1.0))
    with pytest.raises(ValueError, match="a quaternion cannot be 0"):
        transforms.rotation(Quaternion(0.0, 0.0, 0.0, 0.0))


def test_a_tiny_axis_is_an_axis() -> None:
    assert turn(math.pi, 0, 1e-200, 0) @ [1, 0, 0] == pytest.approx([-1, 0, 0], abs=1e-15)


@pytest.mark.long
@given(vectors, vectors, axes)
def test_looking_is_a_frame_with_minus_z_to_the_target(position: tuple, target: tuple, up: tuple) -> None:
    made = transforms.looking(position, target, up)
    towards = np.subtract(target, position)
    if made is None:
        assert not towards.any()
        return
    r = made[:3, :3]
    assert np.abs(r.T @ r - np.eye(3)).max() < 1e-12
    assert np.linalg.det(r) == pytest.approx(1, abs=1e-12)
    assert -r[:, 2] @ towards == pytest.approx(math.hypot(*towards), rel=1e-12)
    assert r[:, 1] @ up >= -1e-9 * math.hypot(*up)


def test_looking_straight_down_has_minus_z_up() -> None:
    made = transforms.looking((0, 5, 0), (0, 0, 0), (0, 1, 0))
    assert made is not None
    assert made[:3, 1] == pytest.approx([0, 0, -1])
    assert made[:3, 0] == pytest.approx([1, 0, 0])


@given(axes)
@example((3e-157, -1.0, 0.0))
@example((5e-324, -1.0, 5e-324))
@example((1e-9, -1.0, -2e-9))
def test_facing_takes_y_to_the_direction_by_the_smallest_turn(direction: tuple) -> None:
    made = transforms.facing((1, 2, 3), direction)
    assert made is not None
    r = made[:3, :3]
    assert np.abs(r.T @ r - np.eye(3)).max() < 1e-14
    assert r[:, 1] == pytest.approx(np.array(direction) / math.hypot(*direction), abs=1e-14)
    cosine = direction[1] / math.hypot(*direction)
    assert np.trace(r) == pytest.approx(1 + 2 * cosine, abs=1e-6)  # trace = 1 + 2 cos of the angle
    assert made[:3, 3].tolist() == [1, 2, 3]


def test_facing_up_turns_nothing() -> None:
    made = transforms.facing((0, 0, 0), (0, 2, 0))
    assert made is not None
    assert np.array_equal(made, np.eye(4))


def test_inverses_together_have_the_bits_of_each() -> None:
    rng = np.random.default_rng(7)
    matrices = rng.normal(size=(200, 3, 4)) * 10.0 ** rng.integers(-20, 20, (200, 1, 1))
    matrices[3, 1] = matrices[3, 0]
    matrices[4] = 0.0
    matrices[5, 2, 3] = np.nan
    together, good = transforms.inverses(matrices)
    for matrix, inverse, exists in zip(matrices, together, good, strict=True):
        alone = transforms.inverse(matrix)
        assert exists == (alone is not None)
        assert alone is None or alone.tobytes() == inverse.tobytes()
