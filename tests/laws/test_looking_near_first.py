# SPDX-License-Identifier: MIT
"""Laws of decisions on a part of the map: they are those on all of it."""

import math

import numpy as np
import pytest
from exploration_study import sensor_robot as bench
from exploring import configured, plan

from ins_robot.geometry.pose2 import Pose2
from ins_robot.navigation.explorer import Drive, Explorer
from ins_robot.navigation.outlook import Aim
from ins_robot.navigation.trips import way_m
from ins_robot.navigation.wave import wave

ROOMS = [(x, 1.5, x + 3.8, 5.0 + x % 3) for x in range(1, 40, 4)]
DOORS = [(x + 3.8, 2.0, x + 4.0, 3.0) for x in range(1, 37, 4)]
LONG = plan(42, 9, *ROOMS, *DOORS)  # ten rooms in a row
MIDDLE = Pose2(22.0, 2.5, 0.0)


@pytest.mark.parametrize("seed", range(4))
def test_a_limited_wave_tells_the_costs_up_to_its_limit(seed):
    rng = np.random.default_rng(seed)
    factor = 1.0 + rng.random((60, 70))
    factor[rng.random(factor.shape) < 0.25] = np.inf
    start = (int(rng.integers(60)), int(rng.integers(70)))
    factor[start] = 1.0
    whole, _ = wave(factor, start, 0.05)
    part, before = wave(factor, start, 0.05, 1.0)
    np.testing.assert_array_equal(part, np.where(whole <= 1.0, whole, np.inf))
    ahead = np.argwhere(before >= 0)
    last = np.stack(np.divmod(before[before >= 0], factor.shape[1]), axis=-1)
    assert (np.abs(ahead - last).max(axis=1) == 1).all()
    assert (part[tuple(last.T)] < part[tuple(ahead.T)]).all()


@pytest.fixture(scope="module")
def decisions():
    """Of a run: (the drive, what it would have been on the whole map, reach, way home)."""
    told = []
    explore_on = Explorer._explore_on

    def spied(self, scene):
        drive = explore_on(self, scene)
        if isinstance(drive, Drive) and "in view" in drive.reason:
            told.append((drive, scene.reach_m, self, scene.map, scene.pose))
        return drive

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Explorer, "_explore_on", spied)
        rows, runs = [], []
        for run in bench.explore(LONG, MIDDLE, configured(strategy="auto")):
            runs[:] = [run]
            for drive, reach_m, explorer, grid, pose in told:
                scene = explorer._look_around(pose, grid)
                aim = explorer._strategy._chooser.aim(
                    scene.outlook(6.0, explorer._vain, explorer.graph)
                )
                assert isinstance(aim, Aim)
                place_m = grid.metres(np.array(aim.cell))
                home_m = way_m(scene.terrain, explorer.graph.nodes[0].position_m)
                rows.append((drive, reach_m, place_m, home_m))
            told.clear()
        return rows, runs[-1]


def test_the_place_chosen_is_that_of_the_whole_map(decisions):
    rows, _ = decisions
    for drive, _, place_m, _ in rows:
        assert math.dist(drive.path.points_m[-1], place_m) < 0.05
    reaches = [reach_m for _, reach_m, _, _ in rows]
    assert min(reaches) < max(reaches)


def test_the_way_home_over_nodes_is_about_as_long_as_the_cheapest(decisions):
    rows, _ = decisions
    ratios = [drive.home_m / home_m for drive, _, _, home_m in rows if home_m > 1.0]
    assert len(ratios) > 5
    assert min(ratios) > 0.9  # the cheapest keeps off walls: it is not the shortest
    assert max(ratios) < 1.15


def test_what_is_left_far_away_is_not_forgotten(decisions):
    _, run = decisions
    assert run.decision.is_complete
    assert not run.decision.unseen
    assert {round(node.pose.x_m) // 12 for node in run.explorer.graph.nodes} >= {-1, 0, 1}
