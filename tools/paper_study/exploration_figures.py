# SPDX-License-Identifier: MIT
"""Figure 5, the navigation algorithm step by step, and figure 9, the map beside its world."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from ins_robot.config import Config
from ins_robot.navigation.decisions import NO_GAP, Drive
from ins_robot.simulation.world import World
from paper_study import drawing
from paper_study.recorded import Recorded, Step, finished, record, steps

PANELS = 7
FAR_BACK = 3  # nodes: going back so far is no mere turning around
RADIUS_M = Config().robot.radius_m
PAPER = ("exploration.strategy=min-gap",)


def figure_5(out: Path) -> str:
    """The world and seven moments of a run in it."""
    recorded = record(out, "figure5", 0, PAPER)
    world = World.builtin(recorded.world)
    start = world.start_pose(None, RADIUS_M)
    corners = drawing.world_points_m(world, start)
    run = steps(recorded)
    figure, axes = plt.subplots(2, 4, figsize=(12.0, 2.0 * _height(corners, 6.0)))
    drawing.show_walls(axes.flat[0], world, start, drawing.INK)
    axes.flat[0].plot(0.0, 0.0, "o", ms=5, color=drawing.TRUE)
    drawing.frame(axes.flat[0], corners, "(a) the world; the robot starts at the dot")
    drawing.scale_bar(axes.flat[0])
    for letter, index, ax in zip("bcdefgh", chosen_steps(run), axes.flat[1:], strict=True):
        _draw_step(ax, run[index])
        drawing.frame(ax, corners, f"({letter}) {_what(run, index)}")
    figure.tight_layout(pad=0.6)
    drawing.save(figure, out / "figure5.png")
    return f"{recorded.command}; {len(run)} nodes"


def chosen_steps(run: Sequence[Step]) -> list[int]:
    """The first two steps, where it turns back to an old node, the end; others in between."""
    count = len(run)
    chosen = {0, 1, count - 1}
    turning = [k for k in range(count) if _goes_back(run, k) >= FAR_BACK]
    if turning:
        farthest = max(turning, key=lambda k: (_goes_back(run, k), -k))
        chosen |= {farthest, min(farthest + 1, count - 1)}
    while len(chosen) < min(PANELS, count):  # the middle of the longest stretch left out
        ends = sorted(chosen)
        gaps = np.diff(ends)
        at = int(gaps.argmax())
        chosen.add(ends[at] + int(gaps[at]) // 2)
    return sorted(chosen)


def _goes_back(run: Sequence[Step], index: int) -> int:
    """How many nodes ago the node was made whose gap is chosen."""
    decision = run[index].decision
    if not isinstance(decision, Drive) or decision.gap_id == NO_GAP:
        return 0
    return index - _index_of(run[index], decision.node_id)


def _index_of(step: Step, node_id: int) -> int:
    return next(k for k, node in enumerate(step.nodes) if node["id"] == node_id)


def _what(run: Sequence[Step], index: int) -> str:
    decision = run[index].decision
    if not isinstance(decision, Drive):
        return f"N{index + 1}: no gap left, the map is complete"
    if decision.gap_id == NO_GAP:
        return f"N{index + 1}: no gap left, the way home"
    node = _index_of(run[index], decision.node_id)
    text = f"N{index + 1}: to N{node + 1}G{decision.gap_id + 1}"
    return f"{text}, back over known ways" if _goes_back(run, index) >= FAR_BACK else text


def _draw_step(ax: Axes, step: Step) -> None:
    """Map, way, nodes, the newest one's neighbours, open gaps; the gap chosen, and the way."""
    drawing.show_map(ax, step.map)
    places = np.array([[node["x_m"], node["y_m"]] for node in step.nodes])
    for other in step.nodes[-1]["neighbours"]:
        ax.plot(*places[[-1, _index_of(step, other)]].T, color=drawing.LINK, lw=0.7)
    for node in step.nodes:
        for gap in node["gaps"]:
            if gap["state"] == "unexplored":
                ax.plot(*np.array(gap["ends"]).T, color=drawing.OPEN_GAP, lw=2.0)
    ax.plot(*step.way_m.T, color=drawing.WAY, lw=1.2)
    ax.plot(*places.T, "o", ms=3.0, color=drawing.NODE)
    for k, (x, y) in enumerate(places):
        ax.annotate(
            f"N{k + 1}", (x, y), xytext=(2, 2), textcoords="offset points", fontsize=5.5
        )
    decision = step.decision
    if isinstance(decision, Drive):
        for gap in step.nodes[_index_of(step, decision.node_id)]["gaps"]:
            if gap["id"] == decision.gap_id:
                ax.plot(*np.array(gap["ends"]).T, color=drawing.CHOSEN_GAP, lw=2.4)
        ax.plot(*decision.path.points_m.T, "--", color=drawing.CHOSEN_GAP, lw=1.0)
    ax.add_patch(plt.Circle(places[-1], RADIUS_M, fill=False, ec=drawing.CHOSEN_GAP, lw=1.0))


def figure_9(out: Path) -> str:
    """The test environment and the map made of it."""
    recorded = record(out, "office", 0, PAPER)
    world = World.builtin(recorded.world)
    start = world.start_pose(None, RADIUS_M)
    corners = drawing.world_points_m(world, start)
    core = finished(recorded)
    _, way = core.corrected_trajectory()
    _, true = recorded.truth()
    figure, axes = plt.subplots(1, 2, figsize=(12.0, _height(corners, 12.0)))
    drawing.show_walls(axes[0], world, start, drawing.INK)
    axes[0].plot(*true[:, :2].T, color=drawing.TRUE, lw=1.0)
    drawing.frame(axes[0], corners, f"(a) the test environment: {recorded.world}, true way")
    drawing.scale_bar(axes[0], 2.0)
    drawing.show_map(axes[1], core.survey.grid)
    axes[1].plot(*way[:, :2].T, color=drawing.WAY, lw=1.0)
    drawing.frame(axes[1], corners, "(b) the generated 2-D map, estimated way")
    figure.tight_layout(pad=0.6)
    drawing.save(figure, out / "figure9.png")
    return f"{recorded.command}; {_metrics(recorded)}"


def _height(corners_m: np.ndarray, width: float) -> float:
    sides = np.ptp(corners_m, axis=0)
    return float(0.5 * width * sides[1] / sides[0] + 0.5)


def _metrics(recorded: Recorded) -> str:
    summary = recorded.summary()
    return (
        f"coverage {summary['coverage']:.3f}, localization "
        f"{summary['localization_rmse_m']:.3f} m, wall error {summary['wall_error_m']:.3f} m"
    )
