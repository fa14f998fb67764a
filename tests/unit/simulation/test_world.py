# SPDX-License-Identifier: MIT
"""Worlds: what is wall, where the robot starts, and clear words for files that are no world."""

import csv
import runpy
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from ins_robot.errors import InputError
from ins_robot.geometry.pose2 import Pose2
from ins_robot.simulation.shipped_worlds import DIRECTORY, shipped_worlds
from ins_robot.simulation.world import World
from ins_robot.simulation.world_files import CELLS_MAX

REPOSITORY = Path(__file__).resolve().parents[3]
SHARED_WORLDS = REPOSITORY.parent / "shared" / "data" / "worlds"
RADIUS_M = 0.2


def write_world(directory, pixels, **keys):
    """A world from an image as it is seen: first row on top."""
    pixels = np.asarray(pixels, dtype=np.uint8)
    Image.fromarray(pixels).save(directory / "w.png")
    lines = {"image": "w.png", "resolution": 0.05, "origin": "[0.0, 0.0, 0.0]", **keys}
    path = directory / "w.yaml"
    path.write_text("".join(f"{key}: {value}\n" for key, value in lines.items() if value != ""))
    return path


def hall(height=60, width=80):
    pixels = np.full((height, width), 254)
    pixels[[0, -1]] = pixels[:, [0, -1]] = 0
    return pixels


def test_rows_grow_upwards_and_only_white_is_free(tmp_path):
    pixels = hall()
    pixels[5, 10] = 0  # fifth row from the top
    pixels[50, 20] = 205  # unknown
    world = World.load(write_world(tmp_path, pixels, origin="[-1.0, 2.0, 0.0]"))
    assert world.is_occupied.shape == (60, 80)
    assert world.is_occupied[60 - 1 - 5, 10]
    assert world.is_occupied[60 - 1 - 50, 20]
    assert world.is_occupied.sum() == 2 * 80 + 2 * 58 + 2
    np.testing.assert_allclose(world.cells([-1.0, 2.0]), [0.0, 0.0])
    np.testing.assert_allclose(world.metres([10.0, 20.0]), [-1.0 + 1.0, 2.0 + 0.5])


def test_a_world_free_to_its_edge_gets_a_wall_around_and_stays_in_place(tmp_path):
    world = World.load(write_world(tmp_path, np.full((40, 40), 255)))
    assert world.is_occupied.shape == (42, 42)
    np.testing.assert_allclose(world.metres([1.0, 1.0]), [0.0, 0.0], atol=1e-12)
    assert world.clearance.nearest_wall(0.3, 1.0).distance_m == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("keys", "values", "free"),
    [
        ({"negate": 1}, (0, 255), (True, False)),
        ({"mode": "raw", "free_thresh": 0.25}, (0, 24, 25, 255), (True, True, False, False)),
        ({"mode": "scale", "free_thresh": 0.5}, (255, 140, 120), (True, True, False)),
    ],
)
def test_modes_of_map_server(tmp_path, keys, values, free):
    pixels = np.full((20, 20), values[-1])
    pixels[10, 1 : 1 + len(values)] = values
    is_occupied = World.load(write_world(tmp_path, pixels, **keys)).is_occupied
    assert tuple(~is_occupied[20 - 1 - 10, 1 : 1 + len(values)]) == free


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"resolution": 0}, "resolution: 0 m must be above 0"),
        ({"resolution": "coarse"}, "resolution: coarse must be 1 finite number"),
        ({"resolution": ""}, "no line 'resolution: ...'"),
        ({"image": ""}, "no line 'image: ...'"),
        ({"image": "other.pgm"}, "other.pgm: the world's image is missing"),
        ({"image": "w.yaml"}, "w.yaml: not an image"),
        ({"origin": "[0, 0, 0.5]"}, "turned by 0.5 rad"),
        ({"mode": "colour"}, "mode: colour: must be one of trinary, scale, raw"),
        ({"start": "[1.0]"}, "start: [1.0]: expected [x, y]"),
        ({"start": "[1.0, nan]"}, "expected [x, y]"),
        ({"negate": 1}, "no free cell in 80 x 60"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path, keys, message):
    pixels = np.full((60, 80), 254)
    with pytest.raises(InputError) as caught:
        World.load(write_world(tmp_path, pixels, **keys))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_cut_off_image_is_refused(tmp_path):
    path = write_world(tmp_path, hall(), image="w.pgm")
    (tmp_path / "w.pgm").write_bytes(b"P5\n80 60\n255\n" + b"\xff" * 100)
    with pytest.raises(InputError, match="the image is cut off or damaged"):
        World.load(path)


@pytest.mark.parametrize("side", [4100, 9000, 20000])
def test_a_world_too_large_is_refused_before_it_is_read(tmp_path, side):
    assert side * side > CELLS_MAX
    path = write_world(tmp_path, hall(), image="w.pgm")
    (tmp_path / "w.pgm").write_bytes(b"P5\n%d %d\n255\n" % (side, side))
    with pytest.raises(InputError, match="a world may have 16,000,000"):
        World.load(path)


def test_files_that_are_no_world(tmp_path):
    with pytest.raises(InputError, match="no such world file"):
        World.find(str(tmp_path / "none.yaml"))
    with pytest.raises(InputError, match="is a directory"):
        World.load(tmp_path)
    write_world(tmp_path, hall())
    with pytest.raises(InputError, match="not text; a world is the YAML file"):
        World.load(tmp_path / "w.png")
    with pytest.raises(InputError, match="nor one of clutter, corridor_loop"):
        World.find("palace")


def test_start_given_in_the_file_or_by_the_caller(tmp_path):
    world = World.load(write_world(tmp_path, hall(), start="[1.0, 1.5, 90]"))
    assert world.start_pose(None, RADIUS_M) == Pose2(1.0, 1.5, np.pi / 2)
    assert world.start_pose(Pose2(2.0, 1.0), RADIUS_M) == Pose2(2.0, 1.0)


def test_start_in_a_wall_is_refused_with_the_distance_and_a_place_that_fits(tmp_path):
    world = World.load(write_world(tmp_path, hall()))
    with pytest.raises(InputError) as caught:
        world.start_pose(Pose2(0.05 + 0.07, 1.0), RADIUS_M)
    message = str(caught.value)
    assert "robot radius 0.20 m does not fit at 0.12, 1.00: nearest wall 0.07 m" in message
    x, y = (float(word) for word in message.rsplit("--start ", 1)[1].split(","))
    world.start_pose(Pose2(x, y), RADIUS_M)
    with pytest.raises(InputError, match=r"outside the world \(x 0.00 to 4.00 m"):
        world.start_pose(Pose2(9.0, 1.0), RADIUS_M)


def test_start_chosen_is_in_the_middle_of_the_largest_place(tmp_path):
    pixels = hall(60, 100)
    pixels[:, 30] = 0  # a small room on the left, a large one on the right
    pose = World.load(write_world(tmp_path, pixels)).start_pose(None, RADIUS_M)
    assert pose.x_m == pytest.approx((31 + 99) / 2 * 0.05, abs=0.06)
    assert pose.y_m == pytest.approx(1.5, abs=0.06)


def test_a_world_without_room_for_the_body(tmp_path):
    pixels = np.zeros((30, 30))
    pixels[12:16] = 255
    world = World.load(write_world(tmp_path, pixels))
    with pytest.raises(InputError, match="no place for a robot of radius"):
        world.start_pose(None, RADIUS_M)


def test_reachable_stops_where_the_disc_does_not_fit_through(tmp_path):
    pixels = hall(60, 121)
    pixels[:, 60] = 0
    for gap, is_open in ((8, False), (9, True)):  # 0.40 m and 0.45 m
        door = pixels.copy()
        door[20 : 20 + gap, 60] = 254
        world = World.load(write_world(tmp_path, door))
        reachable = world.reachable(Pose2(1.0, 1.0), RADIUS_M)
        assert reachable[:, 70:].any() == is_open
        assert (world.clearance.field_m[reachable] >= RADIUS_M).all()


@pytest.mark.parametrize("name", shipped_worlds())
def test_shipped_worlds_are_one_piece_with_their_start_inside(name):
    world = World.builtin(name)
    start = world.start_pose(None, RADIUS_M + 0.1)
    fits = world.clearance.field_m >= RADIUS_M
    assert world.reachable(start, RADIUS_M).sum() > 0.98 * fits.sum()


def test_shipped_worlds_are_what_the_tool_draws(tmp_path):
    runpy.run_path(str(REPOSITORY / "tools" / "make_worlds.py"))["write"](tmp_path)
    drawn = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    shipped = {path.name: path.read_bytes() for path in DIRECTORY.iterdir()}
    assert drawn == shipped
    assert {"open_room", "rooms", "corridor_loop", "clutter", "office", "figure5"} == set(
        shipped_worlds()
    )


@pytest.mark.skipif(not SHARED_WORLDS.is_dir(), reason="no ../shared/data/worlds here")
def test_starts_of_real_worlds_fit_where_their_table_says():
    with (SHARED_WORLDS / "worlds.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["name"].startswith("house_")]
    for row in rows:
        world = World.load(SHARED_WORLDS / f"{row['name']}.yaml")
        world.start_pose(Pose2(float(row["start0_x_m"]), float(row["start0_y_m"])), RADIUS_M)
        free_m2 = (~world.is_occupied).sum() * world.resolution_m**2
        assert free_m2 == pytest.approx(float(row["free_m2"]), abs=0.1)
