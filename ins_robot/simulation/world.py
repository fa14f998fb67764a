# SPDX-License-Identifier: MIT
"""The simulated building: which cells are walls, and where the robot is set down.

Comes from map_server files (`load`) or from those shipped (`builtin`). Only cells known to be
free are free; unknown ones and everything outside the image are walls. World frame: metres, x
right, y up, origin as the YAML says. Row 0 is at the bottom, so row grows with +y.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from ins_robot.errors import InputError
from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.simulation.clearance import Clearance
from ins_robot.simulation.shipped_worlds import DIRECTORY, shipped_worlds
from ins_robot.simulation.world_files import read_world

_START_MARGIN_M = 0.1
_EIGHT_NEIGHBOURS = np.ones((3, 3), dtype=bool)


class World:
    """Walls on a grid.

    Attributes
    ----------
    name : str
    is_occupied : (H, W) bool
        True for walls; the outermost ring always is. Read-only.
    resolution_m : float
    origin_m : (x, y)
        The outer corner of cell (0, 0).
    start : Pose2 | None
        Where the file says the robot is set down; see `start_pose`.
    clearance : Clearance
        Exact distances to the walls.
    """

    def __init__(
        self,
        is_occupied: NDArray[np.bool_],
        resolution_m: float,
        origin_m: tuple[float, float] = (0.0, 0.0),
        *,
        name: str = "",
        start: Pose2 | None = None,
    ) -> None:
        walls = np.ascontiguousarray(is_occupied, dtype=bool)
        if not (walls[[0, -1]].all() and walls[:, [0, -1]].all()):
            walls = np.pad(walls, 1, constant_values=True)
            origin_m = (origin_m[0] - resolution_m, origin_m[1] - resolution_m)
        walls.flags.writeable = False
        self.name = name
        self.is_occupied = walls
        self.resolution_m = resolution_m
        self.origin_m = origin_m
        self.start = start
        self.clearance = Clearance(walls, resolution_m, origin_m)

    @staticmethod
    def load(path: Path) -> World:
        """Read a map_server YAML file and its image; InputError when they cannot be used."""
        files = read_world(path)
        return World(
            ~files.is_free,
            files.resolution_m,
            files.origin_m,
            name=path.stem,
            start=files.start,
        )

    @staticmethod
    def builtin(name: str) -> World:
        """One of the worlds that ship with the simulator."""
        if name not in shipped_worlds():
            names = ", ".join(shipped_worlds())
            raise InputError(f"world '{name}': neither a .yaml file nor one of {names}")
        return World.load(DIRECTORY / f"{name}.yaml")

    @staticmethod
    def find(text: str) -> World:
        """What the command line means: a YAML file, or else the name of a shipped world."""
        return World.load(Path(text)) if Path(text).suffix else World.builtin(text)

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height."""
        height, width = self.is_occupied.shape
        return width * self.resolution_m, height * self.resolution_m

    def cells(self, points_m: ArrayLike) -> FloatArray:
        """(..., 2) points (x, y) -> continuous (row, col); floor gives the cell."""
        points = np.asarray(points_m, dtype=np.float64)
        cells: FloatArray = (points[..., ::-1] - self.origin_m[::-1]) / self.resolution_m
        return cells

    def metres(self, cells: ArrayLike) -> FloatArray:
        """(..., 2) continuous (row, col) -> points (x, y); add 0.5 to a cell for its centre."""
        points: FloatArray = np.asarray(cells, dtype=np.float64) * self.resolution_m
        return points[..., ::-1] + self.origin_m

    def start_pose(self, wanted: Pose2 | None, radius_m: float) -> Pose2:
        """Where the robot starts: `wanted`, else what the file says, else a place chosen here.

        The chosen place is the one nearest to the middle of the largest connected region in
        which the body has 0.1 m to spare (if there is none: just fits), heading 0.

        Raises
        ------
        InputError
            The body does not fit there, or nowhere.
        """
        pose = wanted or self.start
        if pose is None:
            return self._default_start(radius_m)
        width, height = self.size_m
        x, y = pose.x_m - self.origin_m[0], pose.y_m - self.origin_m[1]
        if not (0.0 <= x < width and 0.0 <= y < height):
            low_x, low_y = self.origin_m
            raise InputError(
                f"start {pose.x_m:.2f}, {pose.y_m:.2f} is outside the world (x {low_x:.2f} to "
                f"{low_x + width:.2f} m, y {low_y:.2f} to {low_y + height:.2f} m)"
            )
        distance = self.clearance.nearest_wall(pose.x_m, pose.y_m).distance_m
        if distance < radius_m:
            place = self._default_start(radius_m)
            raise InputError(
                f"robot radius {radius_m:.2f} m does not fit at {pose.x_m:.2f}, "
                f"{pose.y_m:.2f}: nearest wall {distance:.2f} m; choose --start X,Y in free "
                f"space, e.g. --start {place.x_m:.2f},{place.y_m:.2f}"
            )
        return pose

    def reachable(self, start: Pose2, radius_m: float) -> NDArray[np.bool_]:
        """(H, W) bool: cells whose centres a disc gets to from `start`, touching no wall."""
        fits = self.clearance.field_m >= radius_m
        row, col = np.floor(self.cells((start.x_m, start.y_m))).astype(int)
        labels, _ = ndimage.label(fits, structure=_EIGHT_NEIGHBOURS)
        around = labels[max(0, row - 1) : row + 2, max(0, col - 1) : col + 2]
        own = (
            labels[row, col] or around.max()
        )  # a start may fit though its cell's centre does not
        reached: NDArray[np.bool_] = (labels == own) & fits
        return reached

    def _default_start(self, radius_m: float) -> Pose2:
        for margin in (_START_MARGIN_M, 0.0):
            labels, count = ndimage.label(self.clearance.field_m >= radius_m + margin)
            if count:
                sizes = np.bincount(labels.reshape(-1))
                cells = np.argwhere(labels == 1 + int(sizes[1:].argmax())) + 0.5
                off = cells - cells.mean(axis=0)
                x, y = self.metres(cells[int((off * off).sum(axis=1).argmin())])
                return Pose2(float(x), float(y), 0.0)
        widest = float(self.clearance.field_m.max())
        raise InputError(
            f"world '{self.name}': no place for a robot of radius {radius_m:.2f} m, the widest "
            f"has {widest:.2f} m; is the resolution ({self.resolution_m:g} m a cell) right?"
        )
