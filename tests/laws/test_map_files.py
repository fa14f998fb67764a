# SPDX-License-Identifier: MIT
"""Laws of the map's files and picture: what is written can be read back and found again."""

import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from ins_robot.config import ExplorationConfig
from ins_robot.errors import InputError
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping import palette
from ins_robot.mapping.map_files import (
    TernaryMap,
    pgm_bytes,
    read_description,
    read_map,
    read_pgm,
    yaml_text,
)
from ins_robot.mapping.map_picture import (
    Frame,
    GapMark,
    MapPicture,
    draw_map,
    png_bytes,
)
from ins_robot.mapping.picture_marks import legend
from ins_robot.mapping.round_lengths import round_above, round_below
from ins_robot.mapping.zones import Zone, ZoneKind
from ins_robot.navigation.bounds import Bounds

FOOTER = 150  # rows of a picture that may be below the map


def random_map(rng, height, width, resolution_m=0.05, origin_m=(-1.3, 2.7)):
    cells = rng.integers(0, 3, (height, width))
    return TernaryMap(
        resolution_m=resolution_m, origin_m=origin_m, is_occupied=cells == 2, is_free=cells == 1
    )


def assert_same(a, b):
    assert (a.resolution_m, a.origin_m) == (b.resolution_m, b.origin_m)
    np.testing.assert_array_equal(a.is_occupied, b.is_occupied)
    np.testing.assert_array_equal(a.is_free, b.is_free)


@settings(max_examples=50, deadline=None)
@given(
    st.integers(1, 30),
    st.integers(1, 30),
    st.floats(0.005, 0.5),
    st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)),
    st.integers(0, 2**32),
)
def test_a_map_comes_back_from_its_files(height, width, resolution_m, origin_m, seed):
    grid = random_map(np.random.default_rng(seed), height, width, resolution_m, origin_m)
    assert_same(read_map(pgm_bytes(grid), yaml_text(grid, "map.pgm")), grid)


def test_the_image_has_the_largest_y_on_top():
    grid = TernaryMap(
        resolution_m=0.1,
        origin_m=(0.0, 0.0),
        is_occupied=np.array([[True, False], [False, False]]),
        is_free=np.array([[False, True], [False, False]]),
    )
    assert pgm_bytes(grid) == b"P5\n2 2\n255\n" + bytes([205, 205, 0, 254])
    assert np.array_equal(
        np.asarray(Image.open(io.BytesIO(pgm_bytes(grid)))), [[205, 205], [0, 254]]
    )


def test_what_map_server_ships_is_read():
    text = (
        "# made by map_saver\nimage: 'my map.pgm'\nresolution: 0.050000\n"
        "origin: [-10.0, -3.5, 0.000000]\nnegate: 1\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    description = read_description(text, "m.yaml")
    assert (description.image, description.origin_m) == ("my map.pgm", (-10.0, -3.5))
    pixels = b"P5\n# CREATOR: map_generator.cpp\n3 1\n255\n" + bytes([254, 100, 0])
    read = read_map(pixels, text)
    assert read.is_occupied.tolist() == [[True, False, False]]
    assert read.is_free.tolist() == [[False, False, True]]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("resolution: 0.05", "resolution: 0"), "above 0"),
        (("resolution: 0.05", "resolution: fast"), "y:3: resolution"),
        (("resolution: 0.05\n", ""), "no line 'resolution"),
        (("origin: [-1.3, 2.7, 0.0]", "origin: [1, 2]"), "3 finite"),
        (("2.7, 0.0]", "2.7, 0.5]"), "turned"),
        (("negate: 0", "negate"), "not 'key: value'"),
    ],
)
def test_a_wrong_description_says_what_and_where(change, words):
    grid = random_map(np.random.default_rng(0), 2, 2)
    with pytest.raises(InputError, match=words):
        read_description(yaml_text(grid, "map.pgm").replace(*change), "y")


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "not a binary PGM"),
        (b"P2\n1 1\n255\n0", "not a binary PGM"),
        (b"P5\n", "damaged"),
        (b"P5\n# endless", "damaged"),
        (b"P5\n3 x", "damaged"),
        (b"P5\n2 2\n65535\n", "65535"),
        (b"P5\n0 2\n255\n", "0 x 2"),
        (b"P5\n999999 999999\n255\n", "999999"),
        (b"P5\n2 2\n255\n123", "3 of 4"),
    ],
)
def test_a_wrong_image_says_what_is_wrong(data, words):
    with pytest.raises(InputError, match=words):
        read_pgm(data, "x.pgm")


def test_cropping_keeps_every_known_cell_where_it_was():
    rng = np.random.default_rng(3)
    whole = TernaryMap(
        resolution_m=0.1,
        origin_m=(5.0, -5.0),
        is_occupied=np.pad(rng.random((4, 6)) < 0.5, 3),
        is_free=np.zeros((10, 12), dtype=bool),
    )
    part = whole.cropped(1)

    def places(grid):
        rows, cols = np.nonzero(grid.is_occupied)
        x = grid.origin_m[0] + cols * grid.resolution_m
        y = grid.origin_m[1] + rows * grid.resolution_m
        return sorted(zip(x.round(6), y.round(6), strict=True))

    assert places(part) == places(whole)
    assert part.is_occupied.shape < whole.is_occupied.shape
    assert not part.is_occupied[0].any()
    assert not part.is_occupied[:, -1].any()
    assert part.is_occupied[1].any()


def test_a_map_that_knows_nothing_can_be_saved_and_drawn():
    nothing = np.zeros((64, 64), dtype=bool)
    grid = TernaryMap(
        resolution_m=0.05, origin_m=(0.0, 0.0), is_occupied=nothing, is_free=nothing
    )
    assert grid.cropped(4).is_free.shape == (9, 9)
    assert Image.open(io.BytesIO(png_bytes(MapPicture(grid=grid)))).width >= 640


def test_frames_of_picture_and_map_are_each_others_inverse():
    frame = Frame(left_m=-3.0, top_m=8.0, px_per_m=40.0)
    points = np.random.default_rng(0).normal(0.0, 5.0, (20, 2))
    np.testing.assert_allclose(frame.metres(frame.pixels(points)), points)
    assert frame.pixels(np.array([-3.0, 8.0])).tolist() == [0.0, 0.0]
    assert frame.pixels(np.array([-2.0, 7.0])).tolist() == [40.0, 40.0]


def room():
    is_free = np.zeros((80, 100), dtype=bool)
    is_free[10:70, 10:90] = True
    is_occupied = np.zeros_like(is_free)
    is_occupied[10, 10:90] = is_occupied[69, 10:90] = True
    is_occupied[10:70, 10] = is_occupied[10:70, 89] = True
    return TernaryMap(
        resolution_m=0.05, origin_m=(-2.0, -1.0), is_occupied=is_occupied, is_free=is_free
    )


def colour_centre(image, colour):
    rows, cols = np.nonzero((np.asarray(image)[:-FOOTER] == colour).all(axis=-1))
    return cols.mean(), rows.mean()


def frame_of_room():
    """Of a picture of it."""
    empty = draw_map(MapPicture(grid=room()))
    rows, cols = np.nonzero((np.asarray(empty)[:-FOOTER] == palette.NIGHT).all(axis=-1))
    # The outer edges of the walls give the frame: x -1.5 to 2.5 m, y -0.5 to 2.5 m.
    px_per_m = (cols.max() + 1 - cols.min()) / 4.0
    assert (rows.max() + 1 - rows.min()) / 3.0 == px_per_m
    return Frame(
        left_m=-1.5 - cols.min() / px_per_m,
        top_m=2.5 + rows.min() / px_per_m,
        px_per_m=px_per_m,
    )


def test_things_are_drawn_where_they_are():
    frame = frame_of_room()
    drawn = draw_map(
        MapPicture(
            grid=room(),
            gaps=[GapMark(ends_m=np.array([[0.9, 2.0], [1.1, 2.0]]), is_open=True)],
            nodes_m=np.array([[-1.0, 0.0]]),
        )
    )
    assert colour_centre(drawn, palette.ORANGE) == pytest.approx(
        tuple(frame.pixels(np.array([1.0, 2.0])) - 0.5), abs=1.0
    )
    assert colour_centre(drawn, palette.DEEP_BLUE) == pytest.approx(
        tuple(frame.pixels(np.array([-1.0, 0.0])) - 0.5), abs=1.0
    )


def test_a_large_map_is_drawn_smaller_and_loses_no_wall():
    is_free, is_occupied = np.ones((2, 2500, 3300), bool)
    is_occupied[:] = False
    is_occupied[:, 1001] = is_occupied[2000, :] = True
    grid = TernaryMap(
        resolution_m=0.05,
        origin_m=(-1.3, 2.7),
        is_occupied=is_occupied,
        is_free=is_free & ~is_occupied,
    )
    drawn = np.asarray(draw_map(MapPicture(grid=grid)))
    assert drawn.shape[1] <= 3300 / 2 + 20
    is_wall = (drawn == palette.NIGHT).all(axis=-1)
    assert is_wall.any(axis=0).mean() > 0.95
    assert is_wall[:1200].any(axis=1).mean() > 0.95


def test_start_and_robot_are_both_seen_where_the_robot_has_come_home():
    way = np.array([[0.0, 0.0], [1.0, 0.5], [0.0, 0.0]])
    drawn = np.asarray(draw_map(MapPicture(grid=room(), way_m=way, robot=Pose2())))[:-FOOTER]
    for colour in (palette.GREEN, palette.RED):
        assert (drawn == colour).all(axis=-1).any()


@pytest.mark.parametrize(
    ("kind", "points", "label"),
    [
        (ZoneKind.NO_GO, ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)), "no-go zone"),
        (ZoneKind.WALL, ((0.0, 0.0), (1.0, 0.0)), "virtual wall"),
    ],
)
def test_zones_are_in_the_legend(kind, points, label):
    zones = (Zone(name="a", kind=kind, points_m=points),)
    footer = np.asarray(draw_map(MapPicture(grid=room(), zones=zones)))[-FOOTER:]
    assert (footer == palette.DEEP_RED).all(axis=-1).any()
    assert [entry[2] for entry in legend(MapPicture(grid=room(), zones=zones))] == [label]


def test_limits_are_drawn_where_they_are():
    config = ExplorationConfig(
        boundary=((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)), max_radius_m=1.5
    )
    limits_m = Bounds(config, keep_m=0.2).outlines_m(Pose2(0.4, 0.0))
    drawn = np.asarray(draw_map(MapPicture(grid=room(), limits_m=limits_m)))[:-FOOTER]
    rows, cols = np.nonzero((drawn == palette.DEEP_RED).all(axis=-1))
    x, y = frame_of_room().metres(np.stack([cols + 0.5, rows + 0.5], axis=-1)).T
    off_square = np.abs(np.maximum(np.abs(x), np.abs(y)) - 1.0)
    off_circle = np.abs(np.hypot(x - 0.4, y) - 1.5)
    assert (np.minimum(off_square, off_circle) < 0.03).all()
    assert ((off_square < 0.03) & (off_circle > 0.1)).any()
    assert ((off_circle < 0.03) & (off_square > 0.1)).any()


def test_the_same_picture_has_the_same_bytes():
    picture = MapPicture(
        grid=room(),
        way_m=np.cumsum(np.full((50, 2), 0.02), axis=0),
        robot=Pose2(1.0, 1.0, 0.5),
        caption="long " * 100,
    )
    assert png_bytes(picture) == png_bytes(picture)


@settings(max_examples=50)
@given(st.one_of(st.floats(0.01, 1e4), st.sampled_from([0.1, 0.2, 0.5, 1.0, 20.0, 500.0])))
def test_lengths_on_pictures_are_round_and_fit(length_m):
    below, above = round_below(length_m), round_above(length_m)
    assert below <= length_m * (1 + 1e-9) < 2.5 * below * (1 + 1e-6)
    assert above * (1 + 1e-9) >= length_m > above / 2.5 * (1 - 1e-6)
    assert {f"{below:.6e}"[:8], f"{above:.6e}"[:8]} <= {"1.000000", "2.000000", "5.000000"}
