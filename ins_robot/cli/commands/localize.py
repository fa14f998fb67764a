# SPDX-License-Identifier: MIT
"""`ins-robot localize`: where on a finished map a log's robot is, from nothing."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ins_robot.cli.commands.replay import add_fov_argument, positive
from ins_robot.errors import InputError

if TYPE_CHECKING:
    from ins_robot.estimation.global_localization import Verdict
    from ins_robot.geometry.angles import FloatArray

EXIT_AMBIGUOUS = 3
EXIT_LOST = 4
SCANS_MAX = 20
RIVALS_SHOWN = 10


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.epilog = (
        f"Exit code 0: located; {EXIT_AMBIGUOUS}: ambiguous, the candidates are printed; "
        f"{EXIT_LOST}: lost, no place of the map fits. Scans closer together than 0.3 m and "
        "30 degrees are passed over."
    )
    parser.add_argument(
        "map", type=Path, metavar="MAP", help="a map.yaml (ROS map_server) or a run directory"
    )
    parser.add_argument(
        "log", type=Path, metavar="LOG", help="what `replay` reads; its scans are looked up"
    )
    parser.add_argument(
        "--skip", type=_count, default=0, metavar="N", help="leave out the log's first N scans"
    )
    parser.add_argument(
        "--scans",
        type=positive,
        default=SCANS_MAX,
        metavar="N",
        help=f"use N scans at most (default {SCANS_MAX}); fewer when sure before",
    )
    add_fov_argument(parser)
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")


def _count(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r}: must be a whole number, 0 or more")
    return int(text)


def run(args: argparse.Namespace) -> int:
    """Print the pose at the last scan used, in the map frame; or the candidates."""
    from itertools import islice

    import numpy as np

    from ins_robot.estimation.global_localization import GlobalLocalizer, Located
    from ins_robot.logs.finished_map import read_finished_map
    from ins_robot.logs.scan_source import open_scans, spaced

    grid = read_finished_map(args.map)
    source = open_scans(args.log, np.random.default_rng(0), args.fov)
    localizer = GlobalLocalizer(grid, source.base_from_lrf)
    verdict, stamp_s, used = None, 0.0, 0
    steps = islice(source.steps, args.skip, None)
    for scan, motion in islice(spaced(steps), args.scans):
        verdict = localizer.step(scan, motion)
        stamp_s, used = scan.stamp_s, used + 1
        if isinstance(verdict, Located):
            break
    if verdict is None:
        skipped = f" after the first {args.skip}" if args.skip else ""
        raise InputError(f"{args.log}: the log has no scan{skipped}")
    report = {"map": str(args.map), "stamp_s": stamp_s, "scans": used, **_values(verdict)}
    if args.json:
        import json

        print(json.dumps(report, indent=2))
    else:
        print("\n".join(_lines(report)))
    return {"located": 0, "ambiguous": EXIT_AMBIGUOUS, "lost": EXIT_LOST}[report["verdict"]]


def _values(verdict: Verdict) -> dict[str, Any]:
    """The verdict as JSON values."""
    from ins_robot.estimation.global_localization import Ambiguous, Located

    match verdict:
        case Located():
            return {
                "verdict": "located",
                "fit_share": round(verdict.fit_share, 3),
                **_pose(verdict.pose.as_array()),
                "covariance": verdict.covariance.tolist(),
            }
        case Ambiguous():
            candidates = [
                {**_pose(pose), "weight": round(float(weight), 4)}
                for pose, weight in zip(verdict.poses, verdict.weights, strict=True)
            ]
            return {
                "verdict": "ambiguous",
                "fit_share": round(verdict.fit_share, 3),
                "candidates": candidates[:RIVALS_SHOWN],
                "candidates_in_all": len(candidates),
            }
    return {"verdict": "lost", "fit_share": round(verdict.fit_share, 3)}


def _pose(pose: FloatArray) -> dict[str, float]:
    return {
        "x_m": round(float(pose[0]), 4),
        "y_m": round(float(pose[1]), 4),
        "heading_deg": round(math.degrees(float(pose[2])), 3),
    }


def _lines(report: dict[str, Any]) -> list[str]:
    """The same for people."""
    at = f"after {report['scans']} scans, at {report['stamp_s']:.3f} s"
    fit = f"{100.0 * report['fit_share']:.0f} % of the readings fit"
    if report["verdict"] == "located":
        variances = [report["covariance"][k][k] for k in range(3)]
        return [
            _place(report),
            f"located {at}; {fit}; standard deviation "
            f"{math.sqrt(variances[0] + variances[1]):.3f} m, "
            f"{math.degrees(math.sqrt(variances[2])):.2f} deg",
        ]
    if report["verdict"] == "ambiguous":
        rows = [f"{_place(one)}  weight {one['weight']:.2f}" for one in report["candidates"]]
        return [
            f"ambiguous {at}: {report['candidates_in_all']} candidates; {fit} the first",
            *rows,
        ]
    return [f"lost {at}: no place of the map fits; at the best one {fit}"]


def _place(values: dict[str, Any]) -> str:
    x_m, y_m, heading_deg = (values[key] for key in ("x_m", "y_m", "heading_deg"))
    return f"x {x_m:.3f} m  y {y_m:.3f} m  heading {heading_deg:.2f} deg"
