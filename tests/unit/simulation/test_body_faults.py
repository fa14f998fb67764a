# SPDX-License-Identifier: MIT
"""What a fault does to the bytes that the devices send, and when."""

import math
import struct
from dataclasses import replace

import numpy as np
import pytest

from ins_robot.config import Config
from ins_robot.geometry.pose2 import Pose2
from ins_robot.simulation.body_faults import BodyFault, FaultSchedule
from ins_robot.simulation.emulators.gyro_chip import PWR_MGMT_1
from ins_robot.simulation.harness import SimulatedRobot
from ins_robot.simulation.world import World

TICK_S = 0.02
FROM_TICK, UNTIL_TICK, END_TICK = 100, 200, 300
GYRO_LSB_PER_DPS = 131.0
DUTIES = (-0.06, 0.0, 0.06)
STILL = (0.0, 0.0, 0.0)

Line = tuple[bytes, bytes, object, tuple[int, int, int]]


@pytest.fixture(scope="module")
def hall():
    walls = np.zeros((100, 140), dtype=bool)  # 7 m x 5 m
    walls[[0, -1]] = walls[:, [0, -1]] = True
    return World(walls, 0.05)


def listen(hall, *faults, chip="hmc5883l", duties=STILL) -> list[Line]:
    """What gyro, compass, inputs and encoders say, tick by tick."""
    config = Config()
    config = replace(config, simulation=replace(config.simulation, compass_chip=chip))
    robot = SimulatedRobot(config, hall, Pose2(2.0, 2.5, 0.5), 3)
    for fault in faults:
        robot.body.faults.add(fault, FROM_TICK * TICK_S, (UNTIL_TICK - FROM_TICK) * TICK_S)
    gyro, compass = robot.registers
    gyro.write(PWR_MGMT_1, b"\x01", 0.0)
    if chip == "hmc5883l":
        compass.write(0, b"\x18\x20\x00", 0.0)  # 75 Hz, for ever
    else:
        compass.write(9, b"\x1d", 0.0)  # 200 Hz, for ever
    lines = []
    for tick in range(END_TICK):
        now_s = (tick + 0.5) * TICK_S
        robot.body.advance(now_s, duties)
        field = compass.read(3 if chip == "hmc5883l" else 0, 6, now_s)
        rates = gyro.read(0x43, 6, now_s)
        lines.append((rates, field, robot.body.inputs(), robot.body.counts()))
    return lines


def column(lines, index, form):
    return np.array([struct.unpack(form, line[index]) for line in lines], dtype=float)


@pytest.mark.parametrize("fault", BodyFault)
def test_before_its_episode_a_fault_changes_nothing(hall, fault):
    calm, faulty = listen(hall, duties=DUTIES), listen(hall, fault, duties=DUTIES)
    assert calm[:FROM_TICK] == faulty[:FROM_TICK]
    assert calm[FROM_TICK:UNTIL_TICK] != faulty[FROM_TICK:UNTIL_TICK]


@pytest.mark.parametrize("fault", [BodyFault.GYRO_BIAS_STEP, BodyFault.COMPASS_DISTURBED])
def test_after_its_episode_a_sensor_s_fault_leaves_no_trace(hall, fault):
    calm, faulty = listen(hall, duties=DUTIES), listen(hall, fault, duties=DUTIES)
    assert calm[UNTIL_TICK:] == faulty[UNTIL_TICK:]


def test_the_gyro_reads_two_degrees_a_second_more_about_z_and_nothing_else_changes(hall):
    calm, faulty = listen(hall), listen(hall, BodyFault.GYRO_BIAS_STEP)
    more = column(faulty, 0, ">3h") - column(calm, 0, ">3h")
    episode = more[FROM_TICK:UNTIL_TICK, 2] / GYRO_LSB_PER_DPS
    assert episode == pytest.approx(np.full(len(episode), 2.0), abs=1.01 / GYRO_LSB_PER_DPS)
    assert (more[:, :2] == 0).all()
    assert [line[1:] for line in calm] == [line[1:] for line in faulty]


@pytest.mark.parametrize(
    ("chip", "form", "x", "y"), [("hmc5883l", ">3h", 0, 2), ("qmc5883l", "<3h", 0, 1)]
)
def test_the_compass_turns_by_thirty_degrees_and_the_norm_does_not(hall, chip, form, x, y):
    calm = listen(hall, chip=chip)
    faulty = listen(hall, BodyFault.COMPASS_DISTURBED, chip=chip)

    def bearing_and_norm(lines):
        field = column(lines[FROM_TICK + 1 : UNTIL_TICK], 1, form)
        bearing = math.atan2(field[:, y].mean(), field[:, x].mean())
        return math.degrees(bearing), np.linalg.norm(field, axis=1).mean()

    before, norm = bearing_and_norm(calm)
    after, same_norm = bearing_and_norm(faulty)
    # A heading is what the field's bearing on the body falls short of north.
    assert (before - after + 180.0) % 360.0 - 180.0 == pytest.approx(30.0, abs=1.0)
    assert same_norm == pytest.approx(norm, rel=0.01)
    assert [(line[0], *line[2:]) for line in calm] == [(line[0], *line[2:]) for line in faulty]


def test_episodes_begin_end_and_overlap():
    schedule = FaultSchedule()
    schedule.add(BodyFault.GYRO_BIAS_STEP, 1.0, 2.0)
    schedule.add(BodyFault.GYRO_BIAS_STEP, 5.0, 1.0)
    schedule.add(BodyFault.COMPASS_DISTURBED, 2.0, 2.0)
    both = {BodyFault.GYRO_BIAS_STEP, BodyFault.COMPASS_DISTURBED}
    assert [len(schedule.active(t)) for t in (0.99, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)] == [
        *(0, 1, 2, 1, 0, 1, 0)
    ]
    assert schedule.active(2.5) == both
