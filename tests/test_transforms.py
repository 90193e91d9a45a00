"""Rigid transforms against scipy.spatial.transform."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from kinematics.transforms import (
    IDENTITY,
    Pose,
    by_turn,
    rotation_about,
    rotation_vector,
    rotation_vector_matrix,
    turn,
)

component = st.floats(-1.0, 1.0, allow_subnormal=False)
vector = st.tuples(component, component, component).map(np.array)
unit = vector.filter(lambda v: np.linalg.norm(v) > 0.05).map(lambda v: v / np.linalg.norm(v))
angle = st.floats(-10.0, 10.0)
seed = st.integers(0, 2**32 - 1)


def random_pose(rng: np.random.Generator, n: int) -> Pose:
    return Pose(Rotation.random(n, random_state=rng).as_matrix(), rng.normal(0, 500, (n, 3)))


@given(unit, st.lists(angle, min_size=1, max_size=5))
def test_rotation_about_equals_scipy(direction, angles):
    rotation = rotation_about(direction, angles)
    assert rotation.shape == (len(angles), 3, 3)
    # the reference takes the angle from the length of a rounded vector
    rounding = np.finfo(float).eps * np.abs(angles).max()
    difference = np.abs(rotation - Rotation.from_rotvec(np.outer(angles, direction)).as_matrix()).max()
    assert difference < 2e-15 + rounding


@given(vector, st.floats(0.0, 10.0))
def test_rotation_vector_matrix_equals_scipy(direction, length):
    vectors = np.array([direction * length, direction * 1e-9])
    assert np.abs(rotation_vector_matrix(vectors) - Rotation.from_rotvec(vectors).as_matrix()).max() < 4e-15


@given(unit, st.floats(0.0, 3.1))
@example(np.array([1.0, 0.0, 0.0]), 0.0)
@example(np.array([0.6, 0.0, -0.8]), 3.1)
def test_rotation_vector_is_the_inverse(direction, length):
    there = rotation_vector_matrix(direction * length)
    assert np.abs(rotation_vector(there) - direction * length).max() < 1e-13
    assert np.abs(rotation_vector_matrix(rotation_vector(there)) - there).max() < 1e-13


@given(unit, st.integers(-300, -2))
@example(np.array([0.0, 0.0, 1.0]), -323)
def test_rotation_vectors_near_zero_keep_all_their_digits(direction, exponent):
    tiny = direction * 10.0**exponent
    rotation = rotation_vector_matrix(tiny)
    half_skew = (rotation[0] - rotation[0].T) / 2
    skew = np.array([[0, -tiny[2], tiny[1]], [tiny[2], 0, -tiny[0]], [-tiny[1], tiny[0], 0]])
    assert np.abs(half_skew - np.sinc(10.0**exponent / np.pi) * skew).max() <= 1e-15 * 10.0**exponent
    assert np.abs(rotation_vector(rotation)[0] - tiny).max() <= 1e-14 * 10.0**exponent


def test_no_turn_is_exactly_the_identity():
    assert (rotation_about([0.6, 0.0, 0.8], [0.0, -0.0]) == np.eye(3)).all()
    assert (rotation_vector_matrix(np.zeros((2, 3))) == np.eye(3)).all()
    assert (rotation_vector(np.eye(3)[None]) == 0.0).all()


@pytest.mark.parametrize("letter", range(3))
def test_right_handed_quarter_turns(letter):
    """About x: y goes to z; and cyclically."""
    axes = np.eye(3)
    turned = rotation_about(axes[letter], math.pi / 2)
    assert turn(turned, axes[letter - 2])[0] == pytest.approx(axes[letter - 1], abs=5e-16)


@given(unit, angle, angle)
def test_turns_about_one_direction_add_up(direction, a, b):
    product = rotation_about(direction, a) @ rotation_about(direction, b)
    assert np.abs(product - rotation_about(direction, a + b)).max() < 1e-14
    assert np.abs(rotation_about(direction, a) @ rotation_about(direction, -a) - np.eye(3)).max() < 5e-15


@given(seed, st.integers(1, 4))
def test_composition_applies_the_right_pose_first(seed, n):
    rng = np.random.default_rng(seed)
    a, b, c = (random_pose(rng, n) for _ in range(3))
    points = rng.normal(0, 500, (n, 3))
    assert np.abs((a @ b).apply(points) - a.apply(b.apply(points))).max() < 1e-11
    for left, right in zip((a @ b) @ c, a @ (b @ c), strict=True):
        assert np.abs(left - right).max() < 1e-11
    for same in (a @ IDENTITY, IDENTITY @ a):
        assert (same.rotation == a.rotation).all()
        assert (same.translation == a.translation).all()


@given(seed, st.integers(1, 4))
def test_the_inverse_leads_back(seed, n):
    rng = np.random.default_rng(seed)
    pose, points = random_pose(rng, n), rng.normal(0, 500, (n, 3))
    assert np.abs(pose.inverse().apply(pose.apply(points)) - points).max() < 1e-11
    for same, own in zip(pose.inverse().inverse(), pose, strict=True):
        assert np.abs(same - own).max() < 1e-11
    for none, identity in zip(pose @ pose.inverse(), IDENTITY, strict=True):
        assert np.abs(none - identity).max() < 1e-11


@given(vector, st.lists(vector, min_size=1, max_size=4))
def test_derivatives_by_a_small_turn(direction, arms):
    arms = np.array(arms)
    turned = turn(rotation_vector_matrix(1e-6 * direction), arms) - arms
    assert by_turn(arms).shape == (len(arms), 3, 3)
    assert np.abs(by_turn(arms) @ (1e-6 * direction) - turned).max() < 3e-12
    assert (by_turn(arms[:, None]) == by_turn(arms)[:, None]).all()


def test_one_row_serves_for_all():
    rng = np.random.default_rng(3)
    one, many, points = random_pose(rng, 1), random_pose(rng, 4), rng.normal(size=(4, 3))
    assert one.apply(points).shape == (4, 3)
    assert many.apply(points[0]).shape == (4, 3)
    assert (one @ many).translation.shape == (4, 3)
    assert (many @ one).rotation.shape == (4, 3, 3)
    assert turn(many.rotation, points)[2] == pytest.approx(many.rotation[2] @ points[2])
