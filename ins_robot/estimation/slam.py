# SPDX-License-Identifier: MIT
"""SLAM in one screen: a scan and the motion since the last one in, pose and map out.

Predict by the motion, correct by the scan against the map built so far, keep the scan as a node
when it shows something new, close loops and relax the graph of nodes. Pose and map are
corrected together: a node that moves carries its scan.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum, auto

import numpy as np

from ins_robot.config import MapConfig, SlamConfig
from ins_robot.estimation.estimators import make_estimator
from ins_robot.estimation.joint_alignment import align_jointly
from ins_robot.estimation.loop_closing import LoopCloser
from ins_robot.estimation.motion_model import chain, turned
from ins_robot.estimation.node_map import MATCH_RADIUS_M, SURFEL_SPACING_M, Node, NodeMap, way_m
from ins_robot.estimation.odometry_trust import Innovation
from ins_robot.estimation.placement import (
    ANY_PLACE,
    INLIERS_MIN,
    Misfit,
    fits_at,
    place,
    too_few,
)
from ins_robot.estimation.protocol import Correction, Observation
from ins_robot.estimation.rendered_map import RenderedMap
from ins_robot.estimation.scan_matching import Alignment
from ins_robot.estimation.wall_directions import WallDirections
from ins_robot.estimation.wheel_scale import WheelScale, WheelScaleMeter
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2, between, compose, inverse
from ins_robot.mapping.likelihood_field import LikelihoodField
from ins_robot.mapping.occupancy_grid import IntArray, OccupancyGrid
from ins_robot.mapping.surfels import Surfels, surfels_of_scan
from ins_robot.messages import LaserScan, MotionIncrement, PoseEstimate

SCAN_SURFELS_MAX = 240
FIELD_STALE_M = 0.5
MAP_MOVED_M = 0.2  # closures found before that are measured on another map
KNOWN_SHARE = 0.9  # of the readings on the map: such a scan shows nothing new


class Keep(Enum):
    """Whether a scan is kept as a node, with its part in the map."""

    ALWAYS = auto()
    APART = auto()  # when the robot has moved or turned on since the last node
    NEW = (
        auto()
    )  # and it shows what the nodes there did not; else a log passes, and nothing grows
    NEVER = auto()


@dataclass(frozen=True, slots=True, kw_only=True)
class Anchor:
    """Where the base was at a scan's stamp, seen from a node whose corrections it follows."""

    stamp_s: float
    node_id: int
    node_from_base: Pose2


class Slam:
    """Pose and map, corrected together."""

    def __init__(
        self,
        config: SlamConfig,
        map_config: MapConfig,
        base_from_lrf: Pose2,
        rng: np.random.Generator,
        range_trusted_m: float = 3.0,
    ) -> None:
        self._config = config
        self._base_from_lrf = base_from_lrf
        self._estimator = make_estimator(config, rng)
        self._nodes = NodeMap()
        self._closer = LoopCloser()
        self._directions = WallDirections()
        self._rendered = RenderedMap(map_config, base_from_lrf, range_trusted_m)
        self._since_node: MotionIncrement | None = None
        self._left_node = 0  # where that motion began
        self._travelled_m = 0.0
        self._field: LikelihoodField | None = None
        self._field_at = np.zeros(3)
        self._linked = np.zeros(0, np.int64)
        self._wheel_scale = WheelScaleMeter()
        self.anchors: list[Anchor] = []
        self.loop_closures = 0
        self.map_moves = 0  # how often the graph was relaxed
        self.is_located = False  # whether the last scan was laid on the map
        self.innovation: Innovation | None = None  # what that said of the motion
        self.was_astray = False  # and far from where the motion had led

    def step(
        self, scan: LaserScan, motion: MotionIncrement, keep: Keep = Keep.APART
    ) -> PoseEstimate:
        """Take in a scan and the motion since the last one; `keep` it as a node or not."""
        before, covariance = self._estimator.pose(), self._estimator.covariance()
        self._estimator.predict(motion)
        self._remember(motion)
        surfels = self._surfels(scan)
        thinned = _spread_out(surfels)
        correction = self._correct(scan, thinned)
        match = None if correction is None else correction.match
        self.is_located = correction is not None
        self.innovation = (
            None if match is None else Innovation.of(match, before, covariance, motion)
        )
        doubt = None if correction is None else correction.doubt
        self.was_astray = doubt is not None
        if doubt is not None:
            self._distrust(doubt)
        if correction is not None:
            self._wheel_scale.located(self._estimator.pose())
        if self._becomes_node(keep, match):
            node = self._add_node(scan, surfels, match)
            self._tie_in(node, thinned)
        self._anchor(scan.stamp_s)
        return PoseEstimate(
            stamp_s=scan.stamp_s, pose=self.pose, covariance=self._estimator.covariance()
        )

    def place(self, scan: LaserScan, motion: MotionIncrement) -> MotionIncrement | Misfit:
        """The motion narrowed by where the scan fits; or why it fits nowhere near.

        For motions too vague to `step` with, such as those of an LRF that is carried. Changes
        nothing.
        """
        surfels = self._thinned(scan)
        if len(self._nodes) == 0:
            return motion if len(surfels) >= INLIERS_MIN else too_few(surfels)
        here = self._estimator.pose()
        prior = compose(here, motion.delta.as_array())
        field = self._nodes.local_field(self._linked_near(prior), prior)
        if field is None:
            return Misfit("nothing of the map is near where it was said to be taken")
        covariance = turned(motion.covariance, float(here[2]))
        placed = place(field, self.grid, surfels, prior, covariance)
        if isinstance(placed, Misfit):
            return placed
        pose, covariance = placed
        return replace(
            motion,
            delta=Pose2.from_array(between(here, pose)),
            covariance=turned(covariance, -float(here[2])),
        )

    def fits(self, scan: LaserScan, motion: MotionIncrement) -> bool:
        """Whether the scan fits the map where the motion has led. Changes nothing."""
        here = self._estimator.pose()
        prior = compose(here, motion.delta.as_array())
        field = self._nodes.local_field(self._linked_near(prior), prior)
        if field is None:  # nothing is known near: to see nothing is as expected
            return len(self._thinned(scan)) < INLIERS_MIN
        doubt = motion.repeated * motion.covariance
        covariance = self._estimator.covariance() + turned(doubt, float(here[2]))
        return fits_at(field, self.grid, self._thinned(scan), prior, covariance)

    def place_at(
        self, scan: LaserScan, pose: Pose2, covariance: FloatArray
    ) -> tuple[Pose2, FloatArray] | None:
        """Where around a pose of the map the scan fits, its covariance (3, 3); or None.

        However it came there; so nearly all of it must be on the map. Changes nothing.
        """
        prior = pose.as_array()
        nodes = self._nodes.linked(np.array([self._nearest(prior)]), prior)
        field = self._nodes.local_field(nodes, prior)
        if field is None:
            return None
        placed = place(field, self.grid, self._thinned(scan), prior, covariance, ANY_PLACE)
        if isinstance(placed, Misfit):
            return None
        return Pose2.from_array(placed[0]), placed[1]

    def relocate(self, scan: LaserScan, pose: Pose2, covariance: FloatArray) -> PoseEstimate:
        """Take in a scan from where the robot was carried to, as a node.

        No odometry leads there: the node hangs on what it is matched with, and on the nearest
        one by `pose`, of which `covariance` (3, 3), map frame, says how surely it is known.
        """
        at, nearest = pose.as_array(), self._nearest(pose.as_array())
        origin = self._nodes.graph.poses[nearest]
        stamp_s = scan.stamp_s
        still = MotionIncrement(
            from_stamp_s=stamp_s,
            to_stamp_s=stamp_s,
            delta=Pose2(),
            covariance=turned(covariance, -pose.heading_rad),
            repeated=1.0,
        )
        self._since_node = replace(
            still,
            delta=Pose2.from_array(between(origin, at)),
            covariance=turned(covariance, -float(origin[2])),
        )
        self._left_node = nearest
        self._estimator.put_down(at)
        self._field, self._linked = None, np.array([nearest])
        self._wheel_scale.interrupt()
        return self.step(scan, still, Keep.ALWAYS)

    def settle(self) -> None:
        """Lay all scans on one another at once; for when no more come, or hardly any."""
        if not (self._config.joint_alignment and self._estimator.closes_loops and self.anchors):
            return
        node = self.anchors[-1].node_id
        before = self._nodes.graph.poses[node].copy()
        self._field = None  # it may not hold any more, and its memory is wanted
        if align_jointly(self._nodes):
            self._map_moved(node, before)
            self._closer.forget()

    @property
    def pose(self) -> Pose2:
        """map_from_base at the last scan."""
        return Pose2.from_array(self._estimator.pose())

    @property
    def nodes(self) -> Sequence[Node]:
        """Nodes with their scans, poses as corrected so far."""
        return [
            Node(id=k, stamp_s=scan.stamp_s, pose=Pose2.from_array(pose), scan=scan)
            for k, (scan, pose) in enumerate(
                zip(self._nodes.scans, self._nodes.graph.poses, strict=True)
            )
        ]

    @property
    def node_poses(self) -> FloatArray:
        """(K, 3) map_from_base of the nodes, as corrected so far."""
        return self._nodes.graph.poses.copy()

    @property
    def grid(self) -> OccupancyGrid:
        """Occupancy grid of the corrected node scans."""
        return self._rendered.grid(self._nodes)

    @property
    def wheel_scale(self) -> WheelScale | None:
        """What the scans say about the wheels' radius; None while they say too little."""
        return self._wheel_scale.value()

    def notes(self) -> dict[str, float | str]:
        """What belongs into a run's summary beside pose and map."""
        scale = self.wheel_scale
        return {} if scale is None else scale.notes()

    def _remember(self, motion: MotionIncrement) -> None:
        self._travelled_m += way_m(motion)
        self._wheel_scale.moved(motion)
        self._since_node = (
            motion if self._since_node is None else chain(self._since_node, motion)
        )

    def _distrust(self, doubt: FloatArray) -> None:
        """The motion since the last node is known so much, (3, 3), less well than it claims."""
        self._wheel_scale.interrupt()
        since = self._since_node
        if since is not None:
            self._since_node = replace(since, covariance=since.covariance + doubt)

    def _surfels(self, scan: LaserScan) -> Surfels:
        bearing_std_rad = math.radians(self._config.bearing_std_deg)
        return surfels_of_scan(scan, bearing_std_rad, MATCH_RADIUS_M).at(self._base_from_lrf)

    def _thinned(self, scan: LaserScan) -> Surfels:
        return _spread_out(self._surfels(scan))

    def _correct(self, scan: LaserScan, surfels: Surfels) -> Correction | None:
        observation = Observation(
            scan,
            self._base_from_lrf,
            self._config.bearing_std_deg,
            surfels,
            self._field_around,
        )
        correction = self._estimator.correct(observation)
        moved = self._estimator.moved_nodes()
        if moved is not None:
            self._nodes.graph.poses[:] = moved
            self._field = None
        return correction

    def _field_around(self) -> LikelihoodField | None:
        """The local map, drawn again when the robot has left the middle of the last one."""
        if len(self._nodes) == 0:
            return None
        pose = self._estimator.pose()
        if self._field is None or math.dist(pose[:2], self._field_at[:2]) > FIELD_STALE_M:
            self._linked = self._linked_near(pose)
            self._field = self._nodes.local_field(self._linked, pose)
            self._field_at = pose
        return self._field

    def _linked_near(self, pose: FloatArray) -> IntArray:
        """Nodes near a pose: those linked to the ones the robot was among, else all."""
        linked = self._nodes.linked(self._linked, pose)
        if len(linked):
            return linked
        return self._nodes.linked(np.arange(len(self._nodes)), pose)

    def _nearest(self, pose: FloatArray) -> int:
        return self._nodes.nearest(np.arange(len(self._nodes)), pose)

    def _becomes_node(self, keep: Keep, match: Alignment | None) -> bool:
        if keep is Keep.ALWAYS or keep is Keep.NEVER or len(self._nodes) == 0:
            return keep is not Keep.NEVER
        apart_m = self._config.node_distance_m
        if self._is_beside(np.array([len(self._nodes) - 1]), apart_m):
            return False
        if keep is Keep.APART:
            return True
        is_known = match is not None and match.inlier_share > KNOWN_SHARE
        return not (is_known and self._is_beside(self._linked, 0.5 * apart_m))

    def _is_beside(self, nodes: IntArray, apart_m: float) -> bool:
        """Whether the robot looks from where one of `nodes` did, and the same way."""
        off = between(self._nodes.graph.poses[nodes], self._estimator.pose())
        is_near = np.hypot(off[:, 0], off[:, 1]) < apart_m
        is_turned_alike = np.abs(wrap_rad(off[:, 2])) < math.radians(self._config.node_turn_deg)
        return bool((is_near & is_turned_alike).any())

    def _add_node(self, scan: LaserScan, surfels: Surfels, match: Alignment | None) -> int:
        pose = self._estimator.pose()
        node = self._nodes.add(pose, scan, surfels, self._travelled_m)
        if node > 0 and self._since_node is not None:
            left = self._left_node
            self._nodes.link_motion(left, node, self._since_node, match is not None)
        if match is not None:
            self._nodes.link_match(node, pose, match)
        self._estimator.keep_node()
        self._since_node, self._left_node = None, node
        self._field = None
        self._linked = np.array([node])
        return node

    def _tie_in(self, node: int, surfels: Surfels) -> None:
        """Look where the walls run and for closed loops; relax the graph when they say so."""
        if not self._estimator.closes_loops or len(surfels) == 0:
            return
        is_turned = self._config.wall_directions and self._directions.see(
            self._nodes.graph, node, surfels, self._travelled_m
        )
        before = self._nodes.graph.poses[node].copy()
        if is_turned and self._nodes.graph.relax().max() > MAP_MOVED_M:
            self._closer.forget()
        is_closed = self._close_loops(node, surfels)
        if is_turned or is_closed:
            self._map_moved(node, before)

    def _map_moved(self, node: int, before: FloatArray) -> None:
        """The robot goes with a node that was at `before` (3,)."""
        self.map_moves += 1
        self._estimator.carry(compose(self._nodes.graph.poses[node], inverse(before)))
        self._wheel_scale.interrupt()

    def _close_loops(self, node: int, surfels: Surfels) -> bool:
        """Whether a loop was closed, and the graph relaxed."""
        self._linked = self._nodes.linked(self._linked, self._nodes.graph.poses[node])
        is_closed = self._closer.close(self._nodes, node, self._linked, surfels)
        self.loop_closures += is_closed
        return is_closed

    def _anchor(self, stamp_s: float) -> None:
        if len(self._nodes) == 0:
            return
        node = len(self._nodes) - 1
        if len(self._linked):
            node = self._nodes.nearest(self._linked, self._estimator.pose())
        node_from_base = between(self._nodes.graph.poses[node], self._estimator.pose())
        node_from_base[2] = wrap_rad(float(node_from_base[2]))
        self.anchors.append(
            Anchor(
                stamp_s=stamp_s, node_id=node, node_from_base=Pose2.from_array(node_from_base)
            )
        )


def _spread_out(surfels: Surfels) -> Surfels:
    """Few enough to match with, spread evenly."""
    return surfels.spread_out(SURFEL_SPACING_M, SCAN_SURFELS_MAX)
