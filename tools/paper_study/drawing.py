# SPDX-License-Identifier: MIT
"""What the figures share: colours, worlds and maps as pictures, small PNG files.

matplotlib comes with filterpy; it is imported in tools only.
"""

from __future__ import annotations

import io
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from ins_robot.geometry.angles import FloatArray
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping import palette
from ins_robot.mapping.map_files import GridView
from ins_robot.simulation.world import World


def hexed(colour: palette.Colour) -> str:
    """A colour of the robot's own pictures, as matplotlib takes it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


INK, WAY, TRUE = hexed(palette.INK), hexed(palette.BLUE), hexed(palette.GREEN)
ODOMETRY, NODE = hexed(palette.RED), hexed(palette.DEEP_BLUE)
OPEN_GAP, CHOSEN_GAP = hexed(palette.ORANGE), hexed(palette.RED)
LINK, WALL_GREY = "#9db7d9", "#c3c8d0"
UNKNOWN = "0.87"
PALETTE = 128
MARGIN_M = 0.4
DPI = 90


def save(figure: Figure, path: Path) -> None:
    """Write a PNG of few colours, some 10 kB."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=DPI, facecolor="white")
    plt.close(figure)
    save_image(Image.open(buffer).convert("RGB"), path)


def save_image(image: Image.Image, path: Path) -> None:
    """Write a picture (RGB) as a PNG of few colours."""
    image.quantize(PALETTE, dither=Image.Dither.NONE).save(path, optimize=True)


def show_map(ax: Axes, grid: GridView) -> None:
    """Free white, occupied dark, unknown grey; map frame."""
    ax.set_facecolor(UNKNOWN)
    height, width = grid.is_free.shape
    shades = np.full((height, width), float(UNKNOWN))
    shades[grid.is_free] = 1.0
    shades[grid.is_occupied] = 0.12
    x, y = grid.origin_m
    extent = (x, x + width * grid.resolution_m, y, y + height * grid.resolution_m)
    ax.imshow(shades, cmap="gray", vmin=0.0, vmax=1.0, origin="lower", extent=extent)


def show_walls(ax: Axes, world: World, start: Pose2, colour: str = WALL_GREY) -> None:
    """The walls' surfaces of the world as seen from `start`, which is the map's origin."""
    walls = world.is_occupied
    inside = np.pad(walls, 1, constant_values=True)
    touches_free = ~(
        inside[:-2, 1:-1] & inside[2:, 1:-1] & inside[1:-1, :-2] & inside[1:-1, 2:]
    )
    points = start.inverse().apply(world.metres(np.argwhere(walls & touches_free) + 0.5))
    ax.plot(*points.T, "s", ms=1.6, color=colour, mew=0)


def frame(ax: Axes, points_m: FloatArray, title: str = "") -> None:
    """Equal axes without ticks around points (N, 2)."""
    low, high = points_m.min(axis=0) - MARGIN_M, points_m.max(axis=0) + MARGIN_M
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    ax.set_aspect("equal")
    ax.set_xticks([])
    ax.set_yticks([])
    if title:
        ax.set_title(title, fontsize=9, color=INK)


def world_points_m(world: World, start: Pose2) -> FloatArray:
    """(4, 2) corners of the world, map frame."""
    height, width = world.is_occupied.shape
    corners = np.array([[0.0, 0.0], [0.0, width], [height, 0.0], [height, width]])
    return start.inverse().apply(world.metres(corners))


def scale_bar(ax: Axes, length_m: float = 1.0) -> None:
    """A bar in the lower right corner."""
    x, y = ax.get_xlim()[1] - 0.25, ax.get_ylim()[0] + 0.2
    ax.plot([x - length_m, x], [y, y], color=INK, lw=2.0, solid_capstyle="butt")
    text = f"{length_m:g} m "
    ax.text(x - length_m, y, text, ha="right", va="center", fontsize=7, color=INK)
