# SPDX-License-Identifier: MIT
"""Reading a world from disk: the YAML file that map_server knows, and the image it names.

Beside map_server's keys a world may say where the robot is set down: `start: [x, y, deg]`,
metres and degrees in the world frame. Other keys are left alone: the files are often foreign.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from ins_robot.errors import InputError
from ins_robot.geometry.pose2 import Pose2
from ins_robot.mapping.map_files import MapDescription, read_description

CELLS_MAX = 16_000_000
"""200 m x 200 m at 0.05 m; the distances to its walls take 1.5 GB while they are computed."""

_MODES = ("trinary", "scale", "raw")
_GREY_LEVELS = 256
_RAW_FULL = 100.0  # mode raw: the pixel is the occupancy in per cent, 255 unknown
_START_VALUES = (2, 3)


@dataclass(frozen=True, slots=True, kw_only=True)
class WorldFiles:
    """What the two files hold: free cells (H, W), row 0 at the bottom, and where they lie."""

    is_free: NDArray[np.bool_]
    resolution_m: float
    origin_m: tuple[float, float]
    start: Pose2 | None


def read_world(path: Path) -> WorldFiles:
    """Read a world's YAML file and image; InputError says what is wrong with them."""
    description = read_description(_read_text(path), str(path))
    mode = description.others.get("mode", _MODES[0])
    if mode not in _MODES:
        raise InputError(f"{path}: mode: {mode}: must be one of {', '.join(_MODES)}")
    image = path.parent / description.image
    is_free = _read_is_free(image, description, mode == "raw")
    if not is_free.any():
        raise InputError(
            f"{image}: no free cell in {is_free.shape[1]} x {is_free.shape[0]}; free is white "
            f"(occupancy below free_thresh = {description.free_thresh:g}); check 'negate'"
        )
    return WorldFiles(
        is_free=is_free,
        resolution_m=description.resolution_m,
        origin_m=description.origin_m,
        start=_start(description.others.get("start", ""), path),
    )


def _read_text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: no such world file") from None
    except IsADirectoryError:
        raise InputError(f"{path}: is a directory, not a world's YAML file") from None
    except PermissionError:
        raise InputError(f"{path}: may not be read by this user") from None
    except UnicodeDecodeError:
        raise InputError(
            f"{path}: not text; a world is the YAML file beside its image, not the image"
        ) from None


def _read_is_free(path: Path, description: MapDescription, is_raw: bool) -> NDArray[np.bool_]:
    """Cells known to be free: not occupied, not grey, not transparent."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image = Image.open(path)
        with image:
            if image.width * image.height > CELLS_MAX:
                raise InputError(_too_large(path, f"{image.width} x {image.height} cells"))
            pixels = np.asarray(image.convert("LA"))
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise InputError(_too_large(path, "far too many cells")) from None
    except FileNotFoundError:
        raise InputError(f"{path}: the world's image is missing") from None
    except UnidentifiedImageError:
        raise InputError(f"{path}: not an image (PGM or PNG expected)") from None
    except (OSError, ValueError, SyntaxError) as error:  # what Pillow raises on broken files
        raise InputError(f"{path}: the image is cut off or damaged: {error}") from None
    level = np.arange(_GREY_LEVELS)
    if is_raw:
        is_free_level = level < _RAW_FULL * description.free_thresh
    else:
        darkness = level if description.is_negated else level[::-1]
        is_free_level = darkness / level[-1] < description.free_thresh
    is_free: NDArray[np.bool_] = is_free_level[pixels[::-1, :, 0]] & (pixels[::-1, :, 1] > 0)
    return is_free


def _too_large(path: Path, size: str) -> str:
    return f"{path}: {size}: a world may have {CELLS_MAX:,}; crop it or make it coarser"


def _start(text: str, path: Path) -> Pose2 | None:
    if not text:
        return None
    try:
        values = [float(item) for item in text.strip("[] ").split(",")]
    except ValueError:
        values = []
    if len(values) not in _START_VALUES or not all(map(math.isfinite, values)):
        raise InputError(f"{path}: start: {text}: expected [x, y] or [x, y, degrees]")
    x, y, degrees = [*values, 0.0][:3]
    return Pose2(x, y, math.radians(degrees))
