# SPDX-License-Identifier: MIT
"""SLAM on a foreign log: its scans and odometry in, a run's result out.

Every record of the log gets its line in the trajectory, with the log's own stamp; corrections
reach the whole past. The order of records is the order of time: stamps may go back.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ins_robot.config import Config
from ins_robot.core.run_result import RunResult, RunState, path_length_m
from ins_robot.core.trajectory import Anchor, correct
from ins_robot.errors import InputError
from ins_robot.estimation.motion_habit import MotionHabit
from ins_robot.estimation.odometry_trust import OdometryTrust
from ins_robot.estimation.slam import Keep, Slam
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.logs.memory import peak_rss_mb
from ins_robot.logs.sensor_log import SensorLog

Progress = Callable[[float], None]


def replay_log(
    log: SensorLog,
    config: Config,
    name: str,
    rng: np.random.Generator,
    clock: Callable[[], float],
    progress: Progress,
    is_stopped: Callable[[], bool] = lambda: False,
) -> RunResult:
    """Run SLAM over a log.

    Parameters
    ----------
    log : SensorLog
        As read; see its `without_odometry` and `with_every`.
    clock : callable
        Tells seconds for the cost figures; does not influence the result.
    progress : callable
        Is told the share done, 0 to 1, after each scan.
    is_stopped : callable
        Asked before each scan but the first; True: the result is of the log up to here, and
        it is not asked again.

    Raises
    ------
    InputError
        If the log has no scan.
    """
    begun_s = clock()
    slam = Slam(config.slam, config.map, log.base_from_lrf, rng, log.range_trusted_m)
    habit: MotionHabit | OdometryTrust = OdometryTrust() if log.has_odometry else MotionHabit()
    slam_ms: list[float] = []
    scan_rows: list[int] = []
    is_cut = False
    for step in log.scan_steps():
        is_cut = bool(scan_rows) and is_stopped()
        if is_cut:
            break
        step_begun_s = clock()
        before = slam.pose
        slam.step(step.scan, habit.expect(step.motion), Keep.NEW)
        if isinstance(habit, OdometryTrust):
            habit.learn(step.motion, slam.innovation)
        elif slam.is_located:
            habit.learn(before.between(slam.pose))
        slam_ms.append(1e3 * (clock() - step_begun_s))
        scan_rows.append(step.row)
        share = (step.row + 1) / len(log.records)
        progress(share)
    if not scan_rows:
        raise InputError(f"{name}: the log has no scan")
    settle_begun_s = clock()
    slam.settle()
    settle_ms = 1e3 * (clock() - settle_begun_s)

    records = log.records[: scan_rows[-1] + 1] if is_cut else log.records
    stamps_s = np.array([record.stamp_s for record in records])
    odom_from_base = np.array([record.odom_from_base.as_array() for record in records])
    map_from_base = corrected_by(slam, scan_rows, odom_from_base)
    duration_s = float(stamps_s.max() - stamps_s.min())
    return RunResult(
        name=name,
        state=RunState.STOPPED if is_cut else RunState.COMPLETE,
        reason=f"interrupted at {share:.0%}" if is_cut else f"end of the {log.kind}",
        grid=slam.grid,
        stamps_s=stamps_s,
        map_from_base=map_from_base,
        graph=node_chain(slam),
        robot_radius_m=log.robot_radius_m,
        duration_s=duration_s,
        path_length_m=path_length_m(odom_from_base if log.has_odometry else map_from_base),
        scans=len(scan_rows),
        nodes=len(slam.nodes),
        loop_closures=slam.loop_closures,
        lrf_on_s=duration_s,
        ins_ms_total=0.0,
        wall_time_s=clock() - begun_s,
        peak_rss_mb=peak_rss_mb(),
        slam_ms=slam_ms,
        notes={**slam.notes(), "settle_ms": round(settle_ms, 1)},
    )


def corrected_by(
    slam: Slam, scan_rows: Sequence[int], odom_from_base: FloatArray
) -> FloatArray:
    """(N, 3) map_from_base of all rows, by what SLAM says now of the rows with scans.

    Rows take the place of stamps, which in a log may repeat and go back.
    """
    nodes = slam.node_poses
    anchors = [
        Anchor(
            stamp_s=float(row),
            odom_from_base=Pose2.from_array(odom_from_base[row]),
            map_from_base=Pose2.from_array(nodes[anchor.node_id]) @ anchor.node_from_base,
        )
        for row, anchor in zip(scan_rows, slam.anchors, strict=True)
    ]
    return correct(np.arange(len(odom_from_base), dtype=np.float64), odom_from_base, anchors)


def node_chain(slam: Slam) -> dict[str, Any]:
    """graph.json of a log: SLAM's nodes, each the neighbour of those before and after it.

    A log's robot was not ours to explore with, so there are no gaps.
    """
    nodes = slam.nodes
    graph = []
    for node in nodes:
        bearings_rad = node.scan.bearings_rad
        graph.append(
            {
                "id": node.id,
                "stamp_s": node.stamp_s,
                "x_m": node.pose.x_m,
                "y_m": node.pose.y_m,
                "heading_rad": node.pose.heading_rad,
                "sector": [float(bearings_rad.min()), float(bearings_rad.max())],
                "neighbours": [i for i in (node.id - 1, node.id + 1) if 0 <= i < len(nodes)],
                "gaps": [],
            }
        )
    return {"nodes": graph}
