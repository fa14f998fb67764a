# SPDX-License-Identifier: MIT
"""Figures of the range finder: 3 its error, 4 a polar sweep, 7 features on the range signal."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from compare_sensor import SPECIFIED, fitted_laws
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from sensor_study import recordings, samples, simulated
from sensor_study.plots import draw_error_characteristic

from ins_robot.config import Config
from ins_robot.estimation.protocol import FEATURE_REACH_M
from ins_robot.mapping import palette
from ins_robot.mapping.features import EDGE_M, EDGE_SLOPE, FeatureKind, features_of_scan
from ins_robot.mapping.polar_picture import draw_polar
from ins_robot.sensing.scan_summary import polar_picture
from paper_study import drawing
from paper_study.recorded import finished, first_revolutions, record

BEARING_STD_RAD = math.radians(Config().slam.bearing_std_deg)
POLAR_SHRINK = 2
MARKS = {
    FeatureKind.OBJECT: ("o", drawing.hexed(palette.RED), "object"),
    FeatureKind.WALL_END: (">", drawing.hexed(palette.ORANGE), "wall end"),
    FeatureKind.INNER_CORNER: ("v", drawing.hexed(palette.DEEP_BLUE), "inner corner"),
    FeatureKind.OUTER_CORNER: ("^", drawing.hexed(palette.GREEN), "outer corner"),
}


def figure_3(out: Path, data: Path) -> str:
    """The error characteristic, real and simulated."""
    if not data.exists():
        return f"not drawn: no recordings in {data}"
    botvac = [
        recordings.read_recording(data / "robot" / f"{name}.csv") for name in recordings.BOTVAC
    ]
    is_open = recordings.open_beams(botvac)
    real = [still for recording in botvac for still in recording.standstills(is_open)]
    homes = [data / "worlds" / f"{name}.yaml" for name in samples.HOMES]
    turns = simulated.stand_in_homes(
        homes, Config().simulation, is_open, samples.PLACES, samples.SEEDS[0]
    )
    laws = fitted_laws(real)
    shown = {f"{name}, fitted": laws[name] for name in ("cubic", "square")}
    draw_error_characteristic(
        real,
        [turn.standstill for turn in turns],
        shown | {"specification": SPECIFIED},
        out / "figure3.png",
    )
    return f"error characteristic of single readings; cubic: {laws['cubic']}"


def figure_4(out: Path) -> str:
    """One sweep of 360 degrees, as `ins-robot scan` shows it."""
    recorded = record(out, "rooms")
    picture = polar_picture(first_revolutions(recorded), Config().lrf)
    drawing.save_image(draw_polar(picture).reduce(POLAR_SHRINK), out / "figure4.png")
    return f"{recorded.command}, first scan: {picture.caption}"


def figure_7(out: Path) -> str:
    """The range signal of a scan, its derivative, and what was found."""
    recorded = record(out, "clutter")
    survey = finished(recorded).survey
    stands = {node.id for node in survey.explorer.graph.nodes}
    nodes = [node for node in survey.slam.nodes if node.id in stands]  # no sweeps
    found = [features_of_scan(n.scan, BEARING_STD_RAD, FEATURE_REACH_M) for n in nodes]
    richest = max(range(len(nodes)), key=lambda k: (len(set(found[k].kinds)), len(found[k])))
    scan, features = nodes[richest].scan, found[richest]
    figure, (above, below) = plt.subplots(2, 1, figsize=(9.0, 5.0), sharex=True)
    degrees = np.degrees(scan.bearings_rad)
    order = np.argsort(degrees)
    degrees, ranges_mm = degrees[order], 1e3 * scan.ranges_m[order]
    above.plot(degrees, ranges_mm, "-", lw=0.8, marker=".", ms=3, color=drawing.WAY)
    at = np.degrees(np.arctan2(features.points_m[:, 1], features.points_m[:, 0]))
    far_mm = 1e3 * np.hypot(*features.points_m.T)
    for kind, (mark, colour, label) in MARKS.items():
        of_kind = features.kinds == kind
        text = f"{label} ({of_kind.sum()})"
        above.plot(at[of_kind], far_mm[of_kind], mark, ms=7, mfc="none", mec=colour, label=text)
    above.set_ylabel("range, mm")
    above.legend(fontsize=7, ncols=4, loc="upper center")
    above.set_ylim(0.0, 1.25 * float(np.nanmax(ranges_mm)))
    _draw_derivative(below, degrees, ranges_mm)
    figure.tight_layout(pad=0.6)
    drawing.save(figure, out / "figure7.png")
    counts = {label: int((features.kinds == k).sum()) for k, (_, _, label) in MARKS.items()}
    told = ", ".join(f"{count} {label}" for label, count in counts.items())
    return f"{recorded.command}, scan {richest + 1} of {len(nodes)}: {told}"


def _draw_derivative(ax: Axes, degrees: np.ndarray, ranges_mm: np.ndarray) -> None:
    """Differences of neighbouring readings, and the step from which one is an edge."""
    step_mm = np.diff(ranges_mm)
    edge_mm = 1e3 * EDGE_M + EDGE_SLOPE * np.minimum(
        ranges_mm[1:], ranges_mm[:-1]
    ) * np.radians(np.diff(degrees))
    ax.plot(degrees[1:], step_mm, "-", lw=0.9, color=drawing.INK, label="differentiated signal")
    for sign, label in ((1.0, "beyond this: an edge"), (-1.0, None)):
        ax.plot(degrees[1:], sign * edge_mm, ":", lw=0.9, color=drawing.ODOMETRY, label=label)
    ax.set_ylabel("range step, mm")
    ax.set_xlabel("bearing, degrees counter-clockwise from ahead; one reading a degree")
    ax.legend(fontsize=7, loc="upper right")
