# SPDX-License-Identifier: MIT
"""Laws of Sim(2) and of its fit: exact, honest, equivariant, robust, and refusing by name."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from ins_robot.errors import DegenerateGeometryError
from ins_robot.estimation.similarity import fit_similarity
from ins_robot.geometry.pose2 import Pose2
from ins_robot.geometry.similarity2 import Similarity2

similarities = st.builds(
    Similarity2,
    st.floats(0.2, 5.0),
    st.floats(-math.pi, math.pi, exclude_max=True),
    st.floats(-20, 20),
    st.floats(-20, 20),
)


def as_array(s):
    return np.array([s.scale, s.turn_rad, s.x_m, s.y_m])


def cloud(rng, count, size_m=3.0):
    return rng.uniform(-size_m, size_m, (count, 2))


@given(similarities, similarities, similarities)
def test_similarities_are_a_group_and_act_on_points(a, b, c):
    points = cloud(np.random.default_rng(0), 5)
    assert ((a @ b) @ c).apply(points) == pytest.approx(a.apply(b.apply(c.apply(points))))
    assert (a @ a.inverse()).apply(points) == pytest.approx(points, abs=1e-9)
    assert (a.inverse() @ a).apply(points) == pytest.approx(points, abs=1e-9)


def test_a_similarity_of_scale_one_carries_poses_as_a_rigid_motion_does():
    pose, carry = Pose2(1.0, -2.0, 0.7), Pose2(0.3, 0.2, 2.9)
    carried = Similarity2(1.0, 2.9, 0.3, 0.2).apply_to_pose(pose)
    assert carried.as_array() == pytest.approx((carry @ pose).as_array())


@settings(max_examples=60, deadline=None)
@given(similarities, st.integers(2, 30), st.integers(0, 10_000))
def test_the_known_transform_comes_back_exactly(truth, count, seed):
    points = cloud(np.random.default_rng(seed), count)
    fit = fit_similarity(points, truth.apply(points))
    assert fit.transform.apply(points) == pytest.approx(truth.apply(points), abs=1e-7)
    assert fit.transform.scale == pytest.approx(truth.scale, rel=1e-6)
    assert fit.is_inlier.all()


def test_with_noise_the_errors_are_those_of_the_covariance():
    """Chi-squared over 400 draws: mean 4 for four parameters."""
    rng = np.random.default_rng(1)
    truth = Similarity2(1.05, 0.4, 2.0, -1.0)
    squares = []
    for _ in range(400):
        points = cloud(rng, 20)
        fit = fit_similarity(points, truth.apply(points) + rng.normal(0.0, 0.05, (20, 2)))
        off = as_array(fit.transform) - as_array(truth)
        squares.append(off @ np.linalg.inv(fit.covariance) @ off)
    assert np.mean(squares) == pytest.approx(4.0, rel=0.2)
    assert np.mean(np.array(squares) < 9.49) > 0.9  # 95 % of a chi-squared of four


def test_it_is_the_sum_of_absolute_errors_that_is_least():
    rng = np.random.default_rng(2)
    points = cloud(rng, 12)
    seen = Similarity2(0.9, -1.0, 0.5, 0.7).apply(points) + rng.normal(0.0, 0.05, (12, 2))

    def absolute(p):
        return np.hypot(*(Similarity2(*p).apply(points) - seen).T).sum()

    fit = fit_similarity(points, seen)
    assert fit.is_inlier.all()
    best = minimize(absolute, as_array(fit.transform) + 0.02, method="Nelder-Mead", tol=1e-10)
    assert absolute(as_array(fit.transform)) <= best.fun + 1e-6


@settings(max_examples=40, deadline=None)
@given(similarities, similarities)
def test_the_fit_moves_with_either_frame(of_l, of_r):
    rng = np.random.default_rng(3)
    points = cloud(rng, 15)
    seen = Similarity2(1.1, 0.3, 1.0, 2.0).apply(points) + rng.normal(0.0, 0.03, (15, 2))
    here = fit_similarity(points, seen)
    away = fit_similarity(of_l.apply(points), of_r.apply(seen))
    expected = of_r @ here.transform @ of_l.inverse()
    at = of_l.apply(points)
    tolerance = 1e-5 * of_r.scale
    assert away.transform.apply(at) == pytest.approx(expected.apply(at), abs=tolerance)
    assert (away.is_inlier == here.is_inlier).all()


@pytest.mark.parametrize("seed", range(20))
def test_thirty_percent_wrong_pairs_change_nothing_that_matters(seed):
    rng = np.random.default_rng(seed)
    truth = Similarity2(1.02, 0.2, 0.3, -0.4)
    points = cloud(rng, 20)
    seen = truth.apply(points) + rng.normal(0.0, 0.02, (20, 2))
    seen[:6] = cloud(rng, 6)
    is_wrong = np.arange(20) < 6
    is_far = np.hypot(*(seen - truth.apply(points)).T) > 0.5
    fit = fit_similarity(points, seen)
    assert not fit.is_inlier[is_wrong & is_far].any()
    assert fit.is_inlier[~is_wrong].sum() >= 12
    assert np.hypot(*(fit.transform.apply(points) - truth.apply(points)).T).max() < 0.06


def test_a_fixed_scale_is_kept():
    points = cloud(np.random.default_rng(5), 10)
    fit = fit_similarity(points, 1.1 * points, fixed_scale=1.0)
    assert fit.transform.scale == pytest.approx(1.0)
    assert fit.scale_std == 0.0


ONE = np.array([[1.0, 2.0]])
FOUR = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]])


@pytest.mark.parametrize(
    ("l_m", "r_m", "name"),
    [
        (ONE, ONE, "too few"),
        (FOUR[:0], FOUR[:0], "too few"),
        (FOUR, FOUR * np.nan, "not finite"),
        (np.repeat(ONE, 4, axis=0), FOUR, "coincident"),
        (FOUR, np.repeat(ONE, 4, axis=0), "coincident"),
        (np.repeat(ONE, 4, axis=0) + FOUR * 1e-9, FOUR, "coincident"),
    ],
    ids=["one", "none", "NaN", "left at a point", "right at a point", "left nearly"],
)
def test_sets_without_an_answer_are_refused_by_name(l_m, r_m, name):
    with pytest.raises(DegenerateGeometryError, match=name):
        fit_similarity(l_m, r_m)


def test_points_no_further_apart_than_their_errors_are_refused():
    rng = np.random.default_rng(6)
    points = 0.02 * cloud(rng, 6, 1.0)
    with pytest.raises(DegenerateGeometryError, match="coincident"):
        fit_similarity(points, points + rng.normal(0.0, 0.1, (6, 2)), np.full(6, 0.1))
