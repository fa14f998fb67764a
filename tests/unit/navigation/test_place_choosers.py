# SPDX-License-Identifier: MIT
"""The strategies that choose places, on drawn grids ('#' wall, '.' seen, 'R' robot)."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, label

from ins_robot.navigation.auto import Auto
from ins_robot.navigation.coarse_outlook import coarsened, refined
from ins_robot.navigation.demands import demands_of, shows_from
from ins_robot.navigation.outlook import Aim, Outlook, PastLooks
from ins_robot.navigation.sight_gain import unseen_in_view
from ins_robot.navigation.strategies import PLACE_CHOOSERS
from ins_robot.navigation.wave import wave

TWO_WAYS = """
##################################
#                                #
#........................#########
#........................#########
#...R....................#########
#........................#########
#......                  #########
##################################
"""
NEAR_SLIT_FAR_HALL = """
########################################
#..............................        #
#..............................        #
####.##........................        #
#### ##........................        #
#   R#####.....................        #
########################################
"""


def niche_on_the_way(deep, wide):
    """A corridor with a small pocket at a third of it, and some unseen ground at its end."""
    return "\n".join(
        [
            "#" * 92,
            *deep * ["#" * 35 + " " * wide + "#" * (57 - wide)],
            "#R" + "." * 86 + "   #",
            *2 * ["#" + "." * 87 + "   #"],
            "#" * 92,
        ]
    )


def drawn(text):
    rows = text.strip("\n").split("\n")
    cells = np.array([list(row) for row in rows])
    is_free = (cells == ".") | (cells == "R")
    is_unseen, is_opaque = cells == " ", cells == "#"
    here = tuple(int(v) for v in np.argwhere(cells == "R")[0])
    factor = np.where(is_free, 1.0, np.inf)
    cost, before = wave(factor, here, 0.1)
    labels, count = label(is_free & binary_dilation(is_unseen), np.ones((3, 3)))
    edges = tuple(np.argwhere(labels == n + 1) for n in range(count))
    return Outlook(
        resolution_m=0.1, range_m=6.0, is_unseen=is_unseen, is_opaque=is_opaque,
        factor=factor, cost_m=cost, before=before, here=here, edges=edges, reach_cells=1,
    )  # fmt: skip


@pytest.mark.parametrize("name", PLACE_CHOOSERS)
def test_every_chooser_names_a_place_it_can_get_to(name):
    outlook = drawn(TWO_WAYS)
    aim = PLACE_CHOOSERS[name]().aim(outlook)
    assert np.isfinite(outlook.cost_m[aim.cell])
    edge_cells = {tuple(c) for edge in outlook.edges for c in edge.tolist()}
    assert {tuple(c) for c in aim.targets.tolist()} <= edge_cells
    assert len(outlook.way_to(aim.cell)) >= 1


@pytest.mark.parametrize("name", PLACE_CHOOSERS)
def test_where_all_is_seen_there_is_nothing_to_choose(name):
    assert PLACE_CHOOSERS[name]().aim(drawn("#####\n#.R.#\n#####")) is None


def test_the_nearest_edge_is_the_nearest():
    outlook = drawn(TWO_WAYS)
    aim = PLACE_CHOOSERS["nearest-frontier"]().aim(outlook)
    near = min(float(cost.min()) for _, cost in outlook.reachable_edges)
    assert outlook.cost_m[aim.cell] == near


def test_explore_lite_goes_for_length():
    long = max(drawn(TWO_WAYS).edges, key=len)
    target = PLACE_CHOOSERS["explore-lite"]().aim(drawn(TWO_WAYS)).targets[0]
    assert target.tolist() in long.tolist()


def test_a_view_ends_at_walls():
    outlook = drawn(NEAR_SLIT_FAR_HALL.replace("R", ".", 1).replace("#..", "#R.", 1))
    shown = unseen_in_view(outlook, outlook.here)
    assert 0 < shown < outlook.is_unseen.sum()


def test_demands_lie_beyond_the_edges_and_show_only_past_walls():
    outlook = drawn(TWO_WAYS)
    demands = demands_of(outlook, np.concatenate(outlook.edges))
    assert outlook.is_unseen[demands.cells[:, 0], demands.cells[:, 1]].all()
    assert (demands.area_m2 > 0.0).all()
    walled = outlook.is_opaque.copy()
    walled[4, :] = True  # a wall between the robot's row and what is above
    places = np.array([[5, 10]])
    above = demands.cells[demands.cells[:, 0] < 2]
    assert shows_from(outlook, places, above, 4.0).any()
    blocked = Outlook(**{**vars(outlook), "is_opaque": walled})
    assert not shows_from(blocked, places, above, 4.0).any()


def test_auto_looks_from_afar_instead_of_driving_there():
    outlook = drawn(TWO_WAYS)
    auto = PLACE_CHOOSERS["auto"]().aim(outlook)
    nearest_edge = PLACE_CHOOSERS["explore-lite"]().aim(outlook)
    assert outlook.cost_m[auto.cell] < outlook.cost_m[nearest_edge.cell]
    assert len(auto.targets) > 1


@pytest.mark.parametrize("is_alone", [False, True])
def test_auto_looks_into_a_niche_on_the_way_unless_it_looks_on_the_way_anyhow(is_alone):
    outlook = drawn(niche_on_the_way(2, 2))
    auto = Auto(is_alone=is_alone)
    aim = auto.aim(outlook)
    assert aim.targets[:, 1].max() < 40
    assert outlook.cost_m[aim.cell] > 1.0
    driving = Outlook(**{**vars(outlook), "looks_on_the_way": True})
    assert auto.aim(driving).targets[:, 1].min() > 80


def test_auto_alone_looks_through_a_keyhole_on_the_way():
    outlook = drawn(niche_on_the_way(4, 3))
    hall = tuple(e for e in outlook.edges if e[:, 1].min() > 80)
    keyhole = tuple(e for e in outlook.edges if e[:, 1].max() < 40)
    outlook = Outlook(**{**vars(outlook), "edges": hall, "short_edges": keyhole})
    assert Auto(is_alone=True).aim(outlook).targets[:, 1].max() < 40
    assert Auto(is_alone=False).aim(outlook).targets[:, 1].min() > 80


def test_an_aim_on_the_way_is_worth_what_the_far_one_is():
    outlook = drawn(niche_on_the_way(2, 2))
    on_the_way = Auto(is_alone=False).aim(outlook)
    far = Auto(is_alone=False).aim(Outlook(**{**vars(outlook), "looks_on_the_way": True}))
    assert on_the_way.worth == far.worth


def test_auto_looks_at_short_edges_last():
    outlook = drawn(NEAR_SLIT_FAR_HALL.replace("R", " ").replace("#..", "#R.", 1))
    far = tuple(e for e in outlook.edges if e[:, 1].min() > 20)
    slit = tuple(e for e in outlook.edges if e[:, 1].min() <= 20)
    assert far
    assert slit
    both = Outlook(**{**vars(outlook), "edges": far, "short_edges": slit})
    assert PLACE_CHOOSERS["auto"]().aim(both).targets[:, 1].min() > 20
    last = Outlook(**{**vars(outlook), "edges": (), "short_edges": slit})
    assert PLACE_CHOOSERS["auto"]().aim(last).targets[:, 1].max() <= 20


def looked_from(outlook, cell):
    looks = PastLooks(
        cells=np.array([cell]) + 0.5, towards_rad=np.zeros(1), half_rad=np.full(1, np.pi)
    )
    return Outlook(**{**vars(outlook), "looks": looks})


def test_auto_does_not_look_again_from_where_it_looked_in_vain():
    outlook = drawn(TWO_WAYS)
    auto = Auto(is_alone=False)
    first = auto.aim(outlook)
    again = auto.aim(looked_from(outlook, first.cell))
    assert again is None or math.dist(again.cell, first.cell) > 2.0


def test_only_auto_alone_looks_through_keyholes():
    outlook = drawn(NEAR_SLIT_FAR_HALL.replace("R", " ").replace("#..", "#R.", 1))
    slit = tuple(e for e in outlook.edges if e[:, 1].min() <= 20)
    last = Outlook(**{**vars(outlook), "edges": (), "short_edges": slit})
    assert Auto(is_alone=True).aim(last) is not None
    assert Auto(is_alone=False).aim(last) is None


def test_large_cells_keep_walls_and_doubt_what_is_unseen():
    fine = drawn(TWO_WAYS)
    coarse = coarsened(fine, 2)
    rows, cols = np.argwhere(fine.is_opaque).T // 2
    assert coarse.is_opaque[rows, cols].all()
    rows, cols = np.argwhere(np.isfinite(fine.cost_m)).T
    assert np.isfinite(coarse.factor[rows // 2, cols // 2]).all()
    dear = coarsened(Outlook(**{**vars(fine), "factor": 3.0 * fine.factor}), 2)
    np.testing.assert_array_equal(dear.factor, 3.0 * coarse.factor)
    for row, col in np.argwhere(coarse.is_unseen):
        block = fine.is_unseen[2 * row : 2 * row + 2, 2 * col : 2 * col + 2]
        assert block.all()
    assert coarse.cost_m.min() == fine.cost_m.min() == 0.0
    assert coarse.resolution_m == 2.0 * fine.resolution_m


def test_an_aim_in_large_cells_comes_back_to_cells_of_the_grid():
    fine = drawn(TWO_WAYS)
    coarse = coarsened(fine, 2)
    edge = coarse.edges[0][:1]
    place = np.argwhere(np.isfinite(coarse.cost_m))[-1]
    aim = refined(fine, Aim(cell=tuple(place.tolist()), targets=edge, why=""), 2)
    assert np.isfinite(fine.cost_m[aim.cell])
    assert (np.array(aim.cell) // 2 == place).all()
    edges = {tuple(c) for e in fine.edges for c in e.tolist()}
    assert {tuple(c) for c in aim.targets.tolist()} <= edges
    assert (aim.targets // 2 == edge).all()


SHAFT = """
#############
#     #     #
######.######
######.######
######.######
######.######
######.######
#.....R.....#
#############
"""


def test_what_did_not_show_from_beside_a_keyholes_line_is_not_aimed_at_from_there_again():
    """The robot stands a bit beside the cell it was sent to, and sees nothing of the shaft."""
    outlook = drawn(SHAFT)
    factor = np.where(np.arange(9)[:, None] == 7, outlook.factor, np.inf)  # too narrow for it
    cost, before = wave(factor, outlook.here, 0.1)
    edge = (np.array([[2, 6]]),)
    outlook = replace(outlook, factor=factor, cost_m=cost, before=before, edges=edge)
    unseen = outlook.is_unseen.copy()
    unseen[1, 6], opaque = True, outlook.is_opaque.copy()
    opaque[1, 6] = False
    outlook = replace(outlook, is_unseen=unseen, is_opaque=opaque)
    aim = Auto().aim(outlook)
    assert aim is not None
    for beside, is_from_there in ((0.6, True), (3.0, False)):
        look = PastLooks(
            cells=np.array([aim.cell]) + np.array([0.5, 0.5 + beside]),
            towards_rad=np.array([-0.5 * math.pi]),
            half_rad=np.array([math.radians(150.0)]),
        )
        again = Auto().aim(replace(outlook, looks=look))
        assert (again is None or again.cell != aim.cell) == is_from_there
