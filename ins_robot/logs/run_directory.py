# SPDX-License-Identifier: MIT
"""The files that every run leaves: map, picture, trajectory, graph, summary.

Each is written to a temporary name and renamed, so that a reader sees a whole file or none.
summary.json is written last: where it is, all the others are.
"""

from __future__ import annotations

import io
import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ins_robot.core.run_result import RunResult
from ins_robot.errors import InputError
from ins_robot.geometry.angles import FloatArray, wrap_rad
from ins_robot.geometry.pose2 import Pose2
from ins_robot.logs.journal import JOURNAL_NAME
from ins_robot.logs.text_lines import split_lines
from ins_robot.mapping.map_files import TernaryMap, pgm_bytes, yaml_text
from ins_robot.mapping.map_picture import GapMark, MapPicture, png_bytes
from ins_robot.mapping.zones import ZONES_FILE, zones_as_json

MAP_PNG, MAP_PGM, MAP_YAML = "map.png", "map.pgm", "map.yaml"
TRAJECTORY, TRUTH, GRAPH, SUMMARY = "trajectory.tum", "truth.tum", "graph.json", "summary.json"

MARGIN_CELLS = 4
UNEXPLORED = "unexplored"
_TUM_WORDS = 8


def holds_run(path: Path) -> bool:
    """True when an earlier run is in `path`, which new files may replace; False: nothing is.

    Raises
    ------
    InputError
        If other things are there, which are not ours to write among.
    """
    names = {entry.name for entry in path.iterdir()} if path.is_dir() else set()
    if names and not names & {SUMMARY, TRAJECTORY, JOURNAL_NAME}:
        raise InputError(
            f"--out {path}: things are there that are no run of ours; name a new directory"
        )
    return bool(names)


def prepare_directory(path: Path) -> bool:
    """Make `path` a directory that can be written; before the long work, so that none is lost.

    Of an earlier run the summary goes (where one is, all the files beside it are of its run),
    and what the new one may not have. True when there was one.

    Raises
    ------
    InputError
        If it is a file, may not be written, or holds other things.
    """
    is_replaced = holds_run(path)
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe = path / f".probe.{os.getpid()}"
        probe.write_bytes(b"")
        probe.unlink()
        for name in (SUMMARY, TRUTH, ZONES_FILE):
            (path / name).unlink(missing_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise InputError(f"{path}: is a file, not a directory; choose another --out") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None
    return is_replaced


def write_run(
    directory: Path, result: RunResult, draw: Callable[[MapPicture], bytes] = png_bytes
) -> dict[str, Any]:
    """Write all files of the run except the recording; the summary is returned."""
    ternary = TernaryMap.of(result.grid).cropped(MARGIN_CELLS)
    write_atomically(directory / MAP_PGM, pgm_bytes(ternary))
    write_atomically(directory / MAP_YAML, yaml_text(ternary, MAP_PGM).encode())
    write_atomically(directory / MAP_PNG, draw(picture_of(result)))
    write_atomically(directory / TRAJECTORY, tum_bytes(result.stamps_s, result.map_from_base))
    if result.true_map_from_base is not None:
        truth = tum_bytes(result.stamps_s, result.true_map_from_base)
        write_atomically(directory / TRUTH, truth)
    if result.zones:
        write_atomically(directory / ZONES_FILE, json_bytes(zones_as_json(result.zones)))
    write_atomically(directory / GRAPH, json_bytes(result.graph))
    summary = result.summary()
    write_atomically(directory / SUMMARY, json_bytes(summary))
    return summary


def write_atomically(path: Path, data: bytes) -> None:
    """Write a whole file or nothing: temporary name, sync, rename."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def tum_bytes(stamps_s: FloatArray, poses: FloatArray) -> bytes:
    """Poses (N, 3) as lines `t x y z qx qy qz qw`."""
    half = 0.5 * np.asarray(poses, dtype=np.float64)[:, 2]
    zero = np.zeros(len(half))
    table = np.column_stack(
        [stamps_s, poses[:, 0], poses[:, 1], zero, zero, zero, np.sin(half), np.cos(half)]
    )
    buffer = io.StringIO()
    np.savetxt(buffer, table, fmt="%.6f %.6f %.6f %d %d %d %.9f %.9f")
    return buffer.getvalue().encode()


def read_tum(path: Path) -> tuple[FloatArray, FloatArray]:
    """Stamps (N,) and poses (N, 3) from a file of `tum_bytes`.

    Raises
    ------
    InputError
        With the line number, when a line is not eight finite numbers.
    """
    rows = []
    for line in split_lines(path):
        row = line.numbers(0, len(line.words))
        if len(row) != _TUM_WORDS or not np.isfinite(row).all():
            raise line.error(f"a line of a trajectory is {_TUM_WORDS} finite numbers")
        rows.append(row)
    table = np.array(rows).reshape(-1, _TUM_WORDS)
    headings = 2.0 * np.arctan2(table[:, 6], table[:, 7])
    return table[:, 0], np.column_stack([table[:, 1], table[:, 2], wrap_rad(headings)])


def json_bytes(value: Any) -> bytes:
    """JSON text with a final newline; numbers that JSON does not know become null."""
    return (json.dumps(_finite(value), indent=1, allow_nan=False) + "\n").encode()


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value


def picture_of(result: RunResult) -> MapPicture:
    """What map.png shows of a run."""
    nodes = list(result.graph.get("nodes", ()))
    gaps = [
        GapMark(ends_m=np.array(gap["ends"]), is_open=gap["state"] == UNEXPLORED)
        for node in nodes
        for gap in node["gaps"]
    ]
    poses = result.map_from_base
    caption = (
        f"{result.name}: {result.scans} scan{'s' * (result.scans != 1)}, "
        f"{result.path_length_m:.1f} m, {_minutes(result.duration_s)}; {result.reason}"
    )
    return MapPicture(
        grid=TernaryMap.of(result.grid),
        way_m=poses[:, :2],
        nodes_m=np.array([[node["x_m"], node["y_m"]] for node in nodes]).reshape(-1, 2),
        gaps=gaps,
        robot=Pose2.from_array(poses[-1]) if len(poses) else None,
        robot_radius_m=result.robot_radius_m,
        zones=result.zones,
        limits_m=result.limits_m,
        caption=caption,
    )


def _minutes(duration_s: float) -> str:
    minutes, seconds = divmod(round(duration_s), 60)
    return f"{minutes} min {seconds} s" if minutes else f"{seconds} s"
