# SPDX-License-Identifier: MIT
"""All of a run that is computed: the same records in the same order give the same run.

The daemon journals what enters here, message by message and mark by mark; replay reads the
journal and calls the same methods. A scan is prepared on the event loop (cheap), computed in
the worker (`compute`). SLAM lives in the map frame and the Kalman filter in the odom frame, so
when it is done changes only where the robot is steered.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from ins_robot.config import Config
from ins_robot.core.drift_meter import DriftMeter
from ins_robot.core.odometry import Odometry
from ins_robot.core.run_result import RunResult, RunState
from ins_robot.core.survey import Decision, Sector, Survey, Timer
from ins_robot.core.trajectory import Anchor, TrajectoryRecorder
from ins_robot.core.whereabouts import Found, Here, PutDown, Whereabouts
from ins_robot.estimation.placement import Misfit
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.zones import Zone
from ins_robot.messages import ImuSample, LaserScan, MotionIncrement, PoseEstimate, WheelSample
from ins_robot.navigation.explorer import Drive
from ins_robot.sensing.deskew import deskew
from ins_robot.sensing.scan_filter import combine, select_sector

TRAJECTORY_PERIOD_S = 0.1
FIRST_SECTOR = Sector()


class MotionSource(Protocol):
    """What tells the motion between scans: the robot's own senses, or a person's word."""

    @property
    def pose(self) -> Pose2:
        """odom_from_base, now."""

    @property
    def is_ready(self) -> bool:
        """Poses count from here."""

    def on_imu(self, sample: ImuSample) -> object:
        """Take a reading of gyro and compass."""

    def on_wheels(self, sample: WheelSample) -> object:
        """Take a telemetry frame."""

    def poses_at(self, stamps_s: FloatArray) -> FloatArray:
        """(N, 3) odom_from_base at stamps (N,)."""

    def increment(self, from_s: float, to_s: float) -> MotionIncrement:
        """Motion between two stamps, in the base frame at the first."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanJob:
    """One scan, ready for the worker."""

    scan: LaserScan
    motion: MotionIncrement
    odom_from_base: Pose2
    at_m: float  # of the way driven
    sector: Sector | None  # None: on the way, no decision


@dataclass(frozen=True, slots=True, kw_only=True)
class ScanOutcome:
    """What the worker made of it; the decision is None for a scan on the way.

    No estimate: the scan fits nowhere, for the reason in `misfit`, and map and pose are as they
    were (`CarriedCore`).
    """

    job: ScanJob
    estimate: PoseEstimate | None
    decision: Decision | None
    misfit: Misfit | None = None


class RunCore:
    """Odometry, survey and trajectory of one run."""

    def __init__(self, config: Config, rng: np.random.Generator, timer_s: Timer) -> None:
        self._config = config
        self._base_from_lrf = Pose2(config.lrf.x_m, config.lrf.y_m, 0.0)
        self._later_sector = Sector(half_width_rad=math.radians(config.lrf.sector_deg))
        self.odometry: MotionSource = Odometry(config.kalman, config.imu, config.wheels)
        self.survey = Survey(config, rng, timer_s)
        self.trajectory = TrajectoryRecorder()
        self.drift = DriftMeter()
        self.map_from_odom = Pose2()
        self.path_length_m = 0.0
        self.scans = 0
        self.sweeps = 0
        self.is_recorded = True  # False: the run is over, its figures stay; the pose goes on
        self.first_stamp_s: float | None = None
        self.last_stamp_s = 0.0
        self._whereabouts = Whereabouts(self.survey.slam, self._base_from_lrf)
        self._carried_s: list[tuple[float, float]] = []  # paused at, found again at
        self._revolutions: list[LaserScan] = []
        self._odom_at_scans: dict[float, Pose2] = {}  # by stamp; prepared, perhaps not computed
        self._located_at_s: float | None = None
        self._recorded_at_s = -math.inf
        self._recorded_odom = Pose2()  # at the last frame of the run
        self._now_s = 0.0
        self._last_odom = Pose2()
        self._way_m = 0.0  # driven, after the run too
        self._told_at_m = 0.0  # of that way: the last scan that was computed

    @property
    def pose(self) -> Pose2:
        """The robot in the map, now."""
        return self.map_from_odom @ self.odometry.pose

    @property
    def position_std_m(self) -> float:
        """How far off the position may be since the last scan that located the robot."""
        if self._located_at_s is None:
            return 0.0
        now_s = max(self._located_at_s, self._now_s)  # telemetry may be late
        doubt = self.odometry.increment(self._located_at_s, now_s).covariance
        return math.sqrt(float(doubt[0, 0] + doubt[1, 1]))

    def nearest_look_m(self) -> float:
        """Distance from here to the nearest place where a scan was taken."""
        here = self.odometry.pose
        places = self._odom_at_scans.values()
        return min((here.distance_m(place) for place in places), default=math.inf)

    def last_look_m(self) -> float:
        """Distance driven since the last scan whose outcome steers the robot."""
        return self._way_m - self._told_at_m

    @property
    def next_sector(self) -> Sector:
        """The first scan looks all around, later ones forward (the paper's +-150 deg)."""
        return self._later_sector if self.scans else FIRST_SECTOR

    # What enters, in the order of the journal.

    def on_imu(self, sample: ImuSample) -> None:
        """A reading of gyro and compass."""
        self.odometry.on_imu(sample)

    def on_wheels(self, sample: WheelSample) -> None:
        """A telemetry frame: the heartbeat of the odometry."""
        self.odometry.on_wheels(sample)
        pose, self._now_s = self.odometry.pose, sample.stamp_s
        self._way_m += self._last_odom.distance_m(pose)
        self._last_odom = pose
        if self.is_recorded:
            self._record(sample.stamp_s, pose)

    def _record(self, stamp_s: float, odom_from_base: Pose2) -> None:
        """Count this instant to the run."""
        if self.first_stamp_s is None:
            self.first_stamp_s = stamp_s
        self.last_stamp_s, self.path_length_m = stamp_s, self._way_m
        self._recorded_odom = odom_from_base
        if stamp_s - self._recorded_at_s >= TRAJECTORY_PERIOD_S - 1e-3:
            self._recorded_at_s = stamp_s
            self.trajectory.add(stamp_s, odom_from_base)

    def begin_scan(self) -> None:
        """Revolutions from here on belong together."""
        self._revolutions.clear()

    def on_revolution(self, revolution: LaserScan) -> int:
        """One more revolution; how many there are."""
        self._revolutions.append(revolution)
        return len(self._revolutions)

    def prepare_node_scan(self, set_rpm: float) -> ScanJob:
        """The revolutions since `begin_scan`, taken standing, as one scan at a node."""
        sector = self.next_sector
        whole = combine(self._revolutions, self._config.lrf, set_rpm)
        scan = select_sector(whole, sector.centre_rad, sector.half_width_rad)
        self.scans += 1
        return self._taken_in(self._job(scan, sector))

    def prepare_look(self, set_rpm: float) -> ScanJob:
        """The revolutions since `begin_scan`, taken standing after a pause; for `find_itself`.

        It counts only once its place is known.
        """
        return self._job(combine(self._revolutions, self._config.lrf, set_rpm), None)

    def prepare_sweep(self) -> ScanJob:
        """The last revolution, taken while driving, de-skewed to its first beam's pose."""
        raw = self._revolutions[-1]
        at_beams = self.odometry.poses_at(raw.stamp_s + raw.beam_offsets_s)
        at_stamp = self.odometry.poses_at(np.array([raw.stamp_s]))[0]
        scan = deskew(raw, at_beams, at_stamp, self._base_from_lrf)
        self.sweeps += 1
        return self._taken_in(self._job(scan, None))

    def compute(self, job: ScanJob) -> ScanOutcome:
        """The heavy part; in the worker. From its end on the correction steers the robot.

        Nobody need wait for it: a scan that is in the recording counts, as it will in replay.
        """
        decision: Decision | None = None
        slam = self.survey.slam
        map_moves, expected = slam.map_moves, self.map_from_odom @ job.odom_from_base
        if job.sector is None:
            estimate = self.survey.scan_on_the_way(job.scan, job.motion)
        else:
            estimate, decision = self.survey.scan_at_node(job.scan, job.motion, job.sector)
        if slam.map_moves != map_moves or slam.was_astray:
            self.drift.interrupted(job.at_m)
        elif slam.is_located:
            self.drift.located(expected.distance_m(estimate.pose), job.at_m)
        self._told_at_m = job.at_m
        self.map_from_odom = estimate.pose @ job.odom_from_base.inverse()
        return ScanOutcome(job=job, estimate=estimate, decision=decision)

    def find_itself(self, look: ScanJob, paused_s: float, *, is_first: bool) -> Found:
        """Where the robot is, which was paused at `paused_s` and may have been carried.

        In the worker. A look that does not tell leaves no trace in map, pose and figures.
        """
        if is_first:
            self._whereabouts = Whereabouts(self.survey.slam, self._base_from_lrf)
        found = self._whereabouts.look(look.scan, look.motion, self.survey.grid)
        if isinstance(found, Here):
            self.sweeps += 1
            self.compute(self._taken_in(replace(look, motion=found.motion)))
        elif isinstance(found, PutDown):
            self.scans += 1
            self._go_on_from(self._taken_in(look), found, paused_s)
        return found

    def _go_on_from(self, look: ScanJob, found: PutDown, paused_s: float) -> None:
        before = self.map_from_odom @ look.odom_from_base
        estimate = self.survey.scan_where_put_down(
            look.scan, found.pose, found.covariance, before
        )
        self._carried_s.append((paused_s, look.scan.stamp_s))
        self.drift.interrupted(look.at_m)
        self._told_at_m = look.at_m
        self.map_from_odom = estimate.pose @ look.odom_from_base.inverse()

    def give_up(self, goal: Drive, why: str, pose: Pose2) -> Decision:
        """The goal could not be reached; in the worker."""
        return self.survey.give_up(goal, why, pose)

    def replan(self, pose: Pose2) -> Decision:
        """The way turned out to be blocked; in the worker."""
        return self.survey.replan(pose)

    def go_to(self, place_m: tuple[float, float], pose: Pose2) -> Drive:
        """Somebody named a place; in the worker. StateError: it cannot be reached."""
        return self.survey.send_to(place_m, pose)

    def go_home(self, why: str, pose: Pose2) -> Decision:
        """Exploring has to end; in the worker."""
        return self.survey.end(why, pose)

    def forbid(self, zones: tuple[Zone, ...]) -> None:
        """No-go zones and virtual walls from now on; in the worker."""
        self.survey.explorer.forbid(zones)

    # What comes out at the end.

    def settle(self) -> None:
        """The recording has ended: the map once more, from all scans at once; in the worker.

        The robot goes with the map; between runs it still has to know where it is.
        """
        slam = self.survey.slam
        map_moves, before = slam.map_moves, slam.pose
        self.survey.settle()
        if slam.map_moves != map_moves:
            self.drift.interrupted(self._told_at_m)
            self.map_from_odom = slam.pose @ before.inverse() @ self.map_from_odom

    def corrected_trajectory(self) -> tuple[FloatArray, FloatArray]:
        """Stamps (N,) and map_from_base poses (N, 3), corrections applied to the whole past."""
        nodes = self.survey.slam.nodes
        anchors = [
            Anchor(
                stamp_s=anchor.stamp_s,
                odom_from_base=self._odom_at_scans[anchor.stamp_s],
                map_from_base=nodes[anchor.node_id].pose @ anchor.node_from_base,
            )
            for anchor in self.survey.slam.anchors
        ]
        return self.trajectory.corrected(anchors, self._carried_s)

    @property
    def duration_s(self) -> float:
        """Robot time since the first wheel telemetry of the run."""
        return 0.0 if self.first_stamp_s is None else self.last_stamp_s - self.first_stamp_s

    @property
    def notes(self) -> dict[str, Any]:
        """What summary.json tells beside what every run has."""
        carried = {"relocalisations": len(self._carried_s)} if self._carried_s else {}
        slam = self.survey.slam
        return {"sweeps": self.sweeps, **carried, **self._end_notes(), **slam.notes()}

    def _end_notes(self) -> dict[str, Any]:
        """How far from home the run ended, and what was left unseen; null: it was stopped."""
        home, ended = self._start(), self.survey.ended
        last = self.map_from_odom @ self._recorded_odom
        return {
            "home_m": round(last.distance_m(home), 3),
            "left": None if ended is None else [left.as_json() for left in ended.unseen],
        }

    def _start(self) -> Pose2:
        """Where the map has the first scan."""
        nodes = self.survey.explorer.graph.nodes
        return nodes[0].pose if nodes else Pose2()

    def result(
        self,
        *,
        name: str,
        state: RunState,
        reason: str,
        lrf_on_s: float,
        wall_time_s: float,
        peak_rss_mb: float,
        notes: Mapping[str, Any],
    ) -> RunResult:
        """The run as far as it has come, for its files."""
        stamps_s, map_from_base = self.corrected_trajectory()
        slam, bounds = self.survey.slam, self.survey.explorer.bounds
        return RunResult(
            name=name,
            state=state,
            reason=reason,
            grid=self.survey.grid,
            stamps_s=stamps_s,
            map_from_base=map_from_base,
            graph=self.survey.explorer.as_json(),
            robot_radius_m=self._config.robot.radius_m,
            duration_s=self.duration_s,
            path_length_m=self.path_length_m,
            scans=self.scans,
            nodes=len(self.survey.explorer.graph),
            loop_closures=slam.loop_closures,
            lrf_on_s=lrf_on_s,
            ins_ms_total=self.survey.ins_ms,
            wall_time_s=wall_time_s,
            peak_rss_mb=peak_rss_mb,
            slam_ms=self.survey.slam_ms,
            notes={**self.notes, "settle_ms": round(self.survey.settle_ms, 1), **notes},
            zones=bounds.zones,
            limits_m=bounds.outlines_m(self._start()),
        )

    def _job(self, scan: LaserScan, sector: Sector | None) -> ScanJob:
        stamp_s = scan.stamp_s
        since_s = stamp_s if self._located_at_s is None else self._located_at_s
        motion = self.odometry.increment(since_s, stamp_s)
        odom_from_base = Pose2.from_array(self.odometry.poses_at(np.array([stamp_s]))[0])
        return ScanJob(
            scan=scan,
            motion=motion,
            odom_from_base=odom_from_base,
            at_m=self._way_m,
            sector=sector,
        )

    def _taken_in(self, job: ScanJob) -> ScanJob:
        """Note a scan that the map will have."""
        self._located_at_s = job.scan.stamp_s
        self._odom_at_scans[job.scan.stamp_s] = job.odom_from_base
        return job
