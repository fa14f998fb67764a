# SPDX-License-Identifier: MIT
"""Edges of the seen part of a map, and what shows from a place."""

import numpy as np
import pytest
from exploring import grid_of, plan

from ins_robot.navigation.sight import sees
from ins_robot.navigation.unseen import BarrenEdges, pieces, survey_unseen

ROOM = plan(6.4, 6.4, (0.5, 0.5, 5.9, 5.9))


def survey(is_known, edge_min_m=0.3, barren=None):
    return survey_unseen(grid_of(ROOM, is_known), edge_min_m, barren or BarrenEdges())


def known_but(rows, cols):
    is_known = np.ones(ROOM.is_occupied.shape, bool)
    is_known[rows, cols] = False
    return is_known


def test_a_room_seen_whole_has_no_edge():
    assert len(survey(known_but(slice(0, 0), slice(0, 0))).cells) == 0


def test_the_edge_of_unseen_ground_lies_on_free_ground_around_it():
    unseen = survey(known_but(slice(50, 60), slice(50, 70)))
    row, col = unseen.cells.T
    assert row.min() == 49
    assert row.max() == 60
    assert (col.min(), col.max()) == (49, 70)
    assert len(unseen.cells) == 2 * (20 + 10) + 4
    assert len(set(unseen.edge_of.tolist())) == 1
    ahead = (unseen.ahead_m / 0.05).astype(int)  # x, y of unseen ground beside each
    assert (unseen.is_unseen[ahead[:, 1], ahead[:, 0]]).all()


@pytest.mark.parametrize("thick", [1, 2])
def test_specks_are_no_edge(thick):
    assert len(survey(known_but(slice(50, 50 + thick), slice(20, 90))).cells) == 0


def test_a_short_edge_is_left_out():
    is_known = known_but(slice(10, 13), slice(0, 13))  # in a corner: seven cells touch it
    assert len(survey(is_known, edge_min_m=0.5).cells) == 0
    assert len(survey(is_known, edge_min_m=0.1).cells) > 0


def test_what_shows_depends_on_the_walls_between():
    walls = [(3.0, 0.5, 3.1, 4.0)]
    world = plan(6.4, 6.4, (0.5, 0.5, 5.9, 5.9), walls=walls)
    is_known = np.ones(world.is_occupied.shape, bool)
    is_known[20:40, 75:95] = False  # about (4.25, 1.5), behind the wall for one side
    unseen = survey_unseen(grid_of(world, is_known), 0.3, BarrenEdges())
    left, right = np.array([2.0, 1.5]), np.array([3.5, 2.5])
    middle = np.array([3.05, 1.5])
    assert len(unseen.showing_from(left[None], middle, None)) == 0
    assert len(unseen.showing_from(right[None], middle, None)) > 0
    backwards = np.array([-1.0, 0.0])
    assert len(unseen.showing_from(right[None], right, backwards)) == 0


def test_the_gain_of_a_scan_is_the_unseen_ground_in_its_sector():
    unseen = survey(known_but(slice(50, 60), slice(80, 100)))
    towards = unseen.gain_cells((55, 40), 0.0, np.radians(60.0), 6.0)
    assert 150 <= towards <= 200
    assert unseen.gain_cells((55, 40), np.pi, np.radians(60.0), 6.0) == 0
    assert unseen.gain_cells((55, 40), 0.0, np.radians(60.0), 1.0) == 0


def test_edges_become_barren_after_two_scans_in_vain():
    is_known = known_but(slice(50, 60), slice(50, 70))
    barren = BarrenEdges()
    ahead = survey(is_known).ahead_m
    barren.strike(ahead)
    assert len(survey(is_known, barren=barren).cells) > 0
    barren.strike(ahead)
    assert len(survey(is_known, barren=barren).cells) == 0


def test_barren_edges_are_looked_at_afresh_from_beyond_a_passage_and_no_longer_than_others():
    is_known = known_but(slice(50, 60), slice(50, 70))
    barren, grid = BarrenEdges(), grid_of(ROOM, is_known)
    ahead = survey(is_known).ahead_m
    everywhere = np.ones(grid.shape, bool)
    assert barren.where_opened(grid, everywhere) is None
    barren.strike(ahead, 2)
    assert barren.where_opened(grid, ~everywhere) is None
    for _ in range(2):
        afresh = barren.where_opened(grid, everywhere)
        assert len(survey(is_known, barren=afresh).cells) > 0
        assert len(survey(is_known, barren=barren).cells) == 0
        afresh.strike(ahead)
    assert barren.where_opened(grid, everywhere) is None


def test_a_drive_that_fails_through_a_passage_is_the_last_and_is_pardoned_once():
    is_known = known_but(slice(50, 60), slice(50, 70))
    barren, grid = BarrenEdges(), grid_of(ROOM, is_known)
    ahead = survey(is_known).ahead_m
    everywhere = np.ones(grid.shape, bool)
    for pardons in (True, False):
        barren.refuse(ahead)
        assert not barren.mask(ahead).any()
        barren.refuse(ahead)
        assert barren.mask(ahead).all()
        barren.where_opened(grid, everywhere).refuse(ahead)
        assert barren.where_opened(grid, everywhere) is None
        barren.pardon_once(ahead)
        assert barren.mask(ahead).any() != pardons


def test_a_long_edge_is_cut_into_pieces_of_about_the_length_asked_for():
    unseen = survey(known_but(slice(50, 53), slice(20, 100)))
    parts = pieces(unseen, int(unseen.edge_of[0]), 2.0)
    assert len(parts) == round(len(unseen.cells) * 0.05 / 2.0)
    assert sorted(np.concatenate(parts)) == list(range(len(unseen.cells)))
    spans = [np.ptp(unseen.points_m[part][:, 0]) for part in parts]
    assert max(spans) < 1.5


def test_sight_is_symmetric_and_blocked_by_walls_alone():
    rng = np.random.default_rng(3)
    is_blocked = rng.random((40, 40)) < 0.05
    a, b = rng.uniform(0, 40, (2, 30, 2))
    there = sees(is_blocked, a, b)
    assert 0.1 < there.mean() < 0.9
    assert (there == sees(is_blocked, b, a).T).mean() > 0.99  # samples may round differently
    assert sees(np.zeros((40, 40), bool), a, b).all()
