# SPDX-License-Identifier: MIT
"""Draws the map's picture in a process of its own.

Drawing holds the interpreter for longer than the motors' dead-man waits, and wants memory that
the daemon need not keep and a replay does not have to spare. `python -m
ins_robot.daemon.drawing` reads a pickled picture from our own pipe, never from outside, and
answers with PNG bytes.
"""

from __future__ import annotations

import pickle
import subprocess
import sys

from ins_robot.errors import RobotError
from ins_robot.mapping.map_picture import MapPicture, png_bytes
from ins_robot.mapping.polar_picture import PolarPicture, polar_png_bytes

TIMEOUT_S = 120.0


def draw_elsewhere(picture: MapPicture | PolarPicture) -> bytes:
    """PNG bytes of `picture`; blocks the calling thread, not the interpreter.

    Raises
    ------
    RobotError
        When the process fails or takes too long.
    """
    command = [sys.executable, "-m", "ins_robot.daemon.drawing"]
    try:
        drawn = subprocess.run(
            command,
            input=pickle.dumps(picture),
            capture_output=True,
            timeout=TIMEOUT_S,
            check=False,
            start_new_session=True,  # Ctrl-C is for us: what is being saved is finished
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise RobotError(f"the picture could not be drawn: {error}") from None
    if drawn.returncode != 0:
        why = drawn.stderr.decode(errors="replace").strip().splitlines()[-1:]
        raise RobotError(f"the picture could not be drawn: {' '.join(why)}")
    return drawn.stdout


if __name__ == "__main__":
    picture = pickle.load(sys.stdin.buffer)
    draw = png_bytes if isinstance(picture, MapPicture) else polar_png_bytes
    sys.stdout.buffer.write(draw(picture))
