# SPDX-License-Identifier: MIT
"""Growing a mask by a cell is what scipy's dilation does."""

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from ins_robot.mapping.neighbourhood import grown


@pytest.mark.parametrize("corners", [True, False])
@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (30, 41)])
def test_it_is_a_dilation_by_one_cell(corners, shape):
    mask = np.random.default_rng(3).random(shape) < 0.1
    structure = np.ones((3, 3), bool) if corners else None
    before = mask.copy()
    np.testing.assert_array_equal(
        grown(mask, corners=corners), binary_dilation(mask, structure)
    )
    np.testing.assert_array_equal(mask, before)
