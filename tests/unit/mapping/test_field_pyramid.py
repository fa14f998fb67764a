# SPDX-License-Identifier: MIT
"""Maxima are those of the cells they stand for, wherever the window lies on the field."""

import numpy as np
import pytest

from ins_robot.mapping.likelihood_field import GRADE_VALUES, LikelihoodField
from ins_robot.mapping.surfels import Surfels

HALF_M = 0.6


def few_surfels() -> Surfels:
    points = np.random.default_rng(0).uniform(-HALF_M, HALF_M, (4, 2))
    return Surfels(
        points_m=points,
        normals=np.tile([1.0, 0.0], (4, 1)),
        is_flat=np.ones(4, bool),
        std_m=np.full(4, 0.05),
        tilt_std_rad=np.zeros(4),
        is_lone=np.zeros(4, bool),
        sources=np.zeros(4, np.int64),
    )


@pytest.mark.parametrize("level", [0, 1, 2, 3])
def test_levels_hold_the_maxima_of_their_cells_and_nothing_lies_outside(level: int) -> None:
    field = LikelihoodField(few_surfels())
    low, high = (-9, -5), (field.width + 6, field.height + 11)
    pyramid = field.pyramid(low, high, level)
    around = np.zeros((high[1] - low[1], high[0] - low[0]))
    around[5 : 5 + field.height, 9 : 9 + field.width] = GRADE_VALUES[field.grades]
    side = 2**level
    squares = np.lib.stride_tricks.sliding_window_view(around, (side, side))
    maxima = squares.max(axis=(2, 3))
    rows, cols = np.indices(maxima.shape).reshape(2, -1)
    cells = pyramid.cells(cols + low[0], rows + low[1])
    values = pyramid.mean_values(cells[:, None], level)
    np.testing.assert_array_equal(values, maxima.reshape(-1))
    assert maxima.max() == 1.0


def test_a_window_beside_the_field_is_empty() -> None:
    field = LikelihoodField(few_surfels())
    for low in ((-50, 0), (field.width + 5, 0), (0, -50), (0, field.height + 5)):
        pyramid = field.pyramid(low, (low[0] + 20, low[1] + 20), 1)
        cells = pyramid.cells(*(np.arange(15) + edge for edge in low))
        assert pyramid.mean_values(cells, 1) == 0.0
