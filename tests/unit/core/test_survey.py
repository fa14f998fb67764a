# SPDX-License-Identifier: MIT
"""What a survey says of its end."""

import numpy as np
import pytest

from ins_robot.config import Config
from ins_robot.core.survey import Survey
from ins_robot.geometry.pose2 import Pose2
from ins_robot.messages import PlannedPath
from ins_robot.navigation.decisions import NO_GAP, Drive, Finished


def test_a_run_sent_somewhere_at_its_end_has_not_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    survey = Survey(Config(), np.random.default_rng(0), lambda: 0.0)
    path = PlannedPath(points_m=np.zeros((2, 2)), headings_rad=np.zeros(2))
    drive = Drive(path=path, node_id=0, gap_id=NO_GAP, reason="goto")
    monkeypatch.setattr(survey.explorer, "send_to", lambda *asked: drive)
    survey.ended = Finished(reason="no reachable gap is left", left=())
    assert survey.send_to((1.0, 0.0), Pose2()) is drive
    assert survey.ended is None
