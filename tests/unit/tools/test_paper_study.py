# SPDX-License-Identifier: MIT
"""The paper's figures: which moments are shown, and what is told of runs in pairs."""

import json

import numpy as np
import pytest
from paper_study import campaign as campaigns
from paper_study.campaign import WORLDS, Campaign, Paired
from paper_study.comparisons import FIGURES, table
from paper_study.exploration_figures import PANELS, chosen_steps
from paper_study.recorded import Step

from ins_robot.messages import PlannedPath
from ins_robot.navigation.explorer import Drive, Finished


def run_of(count, goals):
    """Steps that decide for a gap of their own node, or of `goals[index]`."""
    path = PlannedPath(points_m=np.zeros((1, 2)), headings_rad=np.zeros(1))
    steps = []
    for k in range(count):
        drive = Drive(path=path, node_id=10 + goals.get(k, k), gap_id=0, reason="")
        decision = drive if k < count - 1 else Finished(reason="", left=())
        nodes = [{"id": 10 + index} for index in range(k + 1)]
        steps.append(Step(None, nodes, np.zeros((0, 2)), decision))
    return steps


def test_beginning_turning_point_and_end_are_shown():
    chosen = chosen_steps(run_of(26, {9: 8, 17: 2, 20: 15}))
    assert len(chosen) == PANELS
    assert {0, 1, 17, 18, 25} <= set(chosen)


@pytest.mark.parametrize("count", [7, 8, 40])
def test_a_run_without_a_turning_point_is_shown_evenly(count):
    chosen = chosen_steps(run_of(count, {}))
    assert len(chosen) == PANELS
    assert {0, 1, count - 1} <= set(chosen)
    assert max(np.diff(chosen)) <= -(-count // 4)


def test_pairs_tell_a_difference_that_the_spread_of_worlds_hides():
    rng = np.random.default_rng(0)
    base = rng.uniform(50.0, 700.0, 50)
    pair = Paired.of(base, base - 10.0 + rng.standard_normal(50))
    assert pair.low < -10.0 < pair.high
    assert pair.high - pair.low < 1.0
    assert pair.difference == pytest.approx(pair.mean - pair.base)


def test_a_run_that_did_not_end_counts_in_no_pair():
    pair = Paired.of(np.array([1.0, 2.0, np.nan]), np.array([2.0, np.nan, 5.0]))
    assert (pair.base, pair.difference) == (1.0, 1.0)


def test_runs_that_are_there_are_not_run_again(tmp_path, monkeypatch):
    monkeypatch.setattr(campaigns, "run", lambda *_: pytest.fail("a run was repeated"))
    rows = [
        {"variant": variant, "world": world, "seed": 0, "state": "complete", **figures}
        for variant, figures in (
            ("min-gap", dict.fromkeys(FIGURES, 100.0)),
            ("360 deg", dict.fromkeys(FIGURES, 90.0) | {"coverage": None}),
        )
        for world in WORLDS
    ]
    (tmp_path / "campaign.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    campaign = Campaign(tmp_path)
    campaign.run(("min-gap", "360 deg"), 1, 1)
    figures = {key: label for key, label in FIGURES.items() if key != "coverage"}
    text = table(campaign, "min-gap", "360 deg", figures, 1)
    assert "100, 90 (-10; -10 to -10)" in text
    assert "360 deg: 5 complete" in text
