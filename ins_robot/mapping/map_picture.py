# SPDX-License-Identifier: MIT
"""The map as a picture for people: walls, the way driven, nodes, gaps, robot, scale bar.

In goes a grid and what to draw on it (all in the map frame), out come PNG bytes, the same for
the same input. Cells are scaled by a whole number, so walls stay crisp; what is drawn on top
(`picture_marks`) is smooth. Pillow is imported when used.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.map_files import BoolArray, GridView, TernaryMap
from ins_robot.mapping.palette import MIST, NIGHT, WHITE
from ins_robot.mapping.png_file import png_file
from ins_robot.mapping.zones import Zone

if TYPE_CHECKING:
    from PIL.Image import Image

LONG_SIDE_PX = 1600  # cells are scaled up to about this ...
LONG_SIDE_MAX_PX = 3200  # ... and a map of more cells down to less than this
WIDTH_MIN_PX = 640  # below this the footer has no room; unknown space is added
SCALE_MAX = 14
MARGIN_M = 0.4
RAY_WIDTH_M, RAY_LENGTH_M = 0.9, 2.0  # what is narrower and longer than this is not shown whole

_UNKNOWN = MIST
_FREE = WHITE
_OCCUPIED = NIGHT


@dataclass(frozen=True, slots=True, kw_only=True)
class GapMark:
    """A gap to be drawn: its ends (2, 2), and whether it is still to be explored."""

    ends_m: FloatArray
    is_open: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class GoalMark:
    """Where to go: the way (N, 2), and the pose to take there."""

    path_m: FloatArray
    place: Pose2


def _no_points() -> FloatArray:
    return np.zeros((0, 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class MapPicture:
    """What is on the picture.

    `way_m` is (N, 2), `nodes_m` (K, 2). `robot`, `goal` None: not drawn.
    `node_ids` are written beside the nodes. `zones` are no-go zones and virtual walls,
    `limits_m` closed lines (N, 2) around where the robot may be.
    `caption` is one short line.
    """

    grid: GridView
    way_m: FloatArray = field(default_factory=_no_points)
    nodes_m: FloatArray = field(default_factory=_no_points)
    gaps: Sequence[GapMark] = ()
    robot: Pose2 | None = None
    robot_radius_m: float = 0.2
    goal: GoalMark | None = None
    node_ids: Sequence[int] = ()
    zones: Sequence[Zone] = ()
    limits_m: Sequence[FloatArray] = ()
    caption: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """Map metres to picture pixels: x to the right, y up, a whole number of pixels a cell.

    Or of cells a pixel, in a picture of a large map.
    """

    left_m: float
    top_m: float
    px_per_m: float

    def pixels(self, points_m: FloatArray) -> FloatArray:
        """(..., 2) pixel (column, row), from the picture's top left corner."""
        points = np.asarray(points_m, dtype=np.float64)
        return np.stack(
            [
                (points[..., 0] - self.left_m) * self.px_per_m,
                (self.top_m - points[..., 1]) * self.px_per_m,
            ],
            axis=-1,
        )

    def metres(self, pixels: FloatArray) -> FloatArray:
        """Inverse of `pixels`."""
        pixels = np.asarray(pixels, dtype=np.float64)
        return np.stack(
            [
                self.left_m + pixels[..., 0] / self.px_per_m,
                self.top_m - pixels[..., 1] / self.px_per_m,
            ],
            axis=-1,
        )


def png_bytes(picture: MapPicture) -> bytes:
    """The picture as a PNG file."""
    return png_file(draw_map(picture))


def draw_map(picture: MapPicture) -> Image:
    """The picture as a Pillow image."""
    from PIL import Image as PilImage

    from ins_robot.mapping.picture_marks import draw_footer, draw_marks, footer_px

    cells, scale, frame = _cells_and_frame(picture)
    size = (cells.shape[1] * scale, cells.shape[0] * scale)
    image = PilImage.new("RGB", (size[0], size[1] + footer_px(size[0])), _FREE)
    image.paste(PilImage.fromarray(cells).resize(size, PilImage.Resampling.NEAREST), (0, 0))
    draw_marks(image, size, picture, frame)
    draw_footer(image, size, picture, frame)
    return image


def _cells_and_frame(picture: MapPicture) -> tuple[NDArray[np.uint8], int, Frame]:
    """Colours (H, W, 3) of the part to show, first row = top; pixels a cell; where it lies."""
    shown = _part_to_show(picture)
    shown = _shrunk(shown, -(-max(shown.is_free.shape) // LONG_SIDE_MAX_PX))
    resolution_m = shown.resolution_m
    height, width = shown.is_free.shape
    scale = min(SCALE_MAX, max(1, round(LONG_SIDE_PX / max(height, width))))
    spare = max(0, -(-WIDTH_MIN_PX // scale) - width)
    left = spare // 2
    pad = ((0, 0), (left, spare - left))
    is_free, is_occupied = np.pad(shown.is_free, pad), np.pad(shown.is_occupied, pad)
    cells = np.empty((*is_free.shape, 3), dtype=np.uint8)
    cells[:] = _UNKNOWN
    cells[is_free] = _FREE
    cells[is_occupied] = _OCCUPIED
    frame = Frame(
        left_m=shown.origin_m[0] - left * resolution_m,
        top_m=shown.origin_m[1] + height * resolution_m,
        px_per_m=scale / resolution_m,
    )
    return np.ascontiguousarray(cells[::-1]), scale, frame


def _shrunk(shown: TernaryMap, by: int) -> TernaryMap:
    """`by` x `by` cells as one, occupied if any is: walls are thinner than that."""
    if by == 1:
        return shown
    height, width = shown.is_free.shape
    pad = ((0, -height % by), (0, -width % by))

    def any_of(cells: BoolArray) -> BoolArray:
        rows, cols = (side // by for side in (height + pad[0][1], width + pad[1][1]))
        blocks = np.pad(cells, pad).reshape(rows, by, cols, by)
        return np.asarray(blocks.any(axis=(1, 3)))

    return TernaryMap(
        resolution_m=by * shown.resolution_m,
        origin_m=shown.origin_m,
        is_occupied=any_of(shown.is_occupied),
        is_free=any_of(shown.is_free),
    )


def _part_to_show(picture: MapPicture) -> TernaryMap:
    """The known part and the way; long single rays, gone out through a window, are cut."""
    whole = TernaryMap.of(picture.grid)
    resolution_m = whole.resolution_m
    known = whole.is_occupied | whole.is_free
    way = np.floor((picture.way_m - whole.origin_m) / resolution_m).astype(np.int64)
    rows = _span(known.sum(axis=1), way[:, 1], resolution_m)
    cols = _span(known.sum(axis=0), way[:, 0], resolution_m)
    return whole.window(rows, cols, math.ceil(MARGIN_M / resolution_m))


def _span(
    known_counts: NDArray[np.int64], driven: NDArray[np.int64], resolution_m: float
) -> tuple[int, int]:
    """Rows (or columns) [from, to) to show, by how many cells of each are known."""
    known = np.flatnonzero(known_counts)
    if not len(known):
        return 0, 1
    broad = np.flatnonzero(known_counts * resolution_m >= RAY_WIDTH_M)
    core = np.concatenate([broad, np.clip(driven, 0, len(known_counts) - 1)])
    if not len(core):
        core = known
    first, last = int(core.min()), int(core.max())
    ray_cells = RAY_LENGTH_M / resolution_m
    if first - known[0] <= ray_cells:
        first = min(first, int(known[0]))
    if known[-1] - last <= ray_cells:
        last = max(last, int(known[-1]))
    return first, last + 1
