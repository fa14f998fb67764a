# SPDX-License-Identifier: MIT
"""However a run ends, its files are there, the devices stay, the next run is untouched."""

import asyncio
import json
import os
import signal
import threading
from pathlib import Path

import pytest
from live_robot import Live, live

from ins_robot.cli.commands.emulate import check_config_out, emulated_config, only_emulator
from ins_robot.cli.main import main
from ins_robot.config import Config
from ins_robot.core.run_core import RunCore
from ins_robot.daemon import runtime
from ins_robot.daemon.mission import Mission
from ins_robot.errors import InputError, StateError
from ins_robot.simulation.emulators.motor import MotorEmulator
from ins_robot.simulation.virtual_clock import run_virtual


def _summary(directory: Path) -> dict:
    return json.loads((directory / "summary.json").read_text())


def _directory(path: Path) -> Path:
    path.mkdir()
    return path


def test_a_run_stopped_while_paused_leaves_the_next_one_free(tmp_path: Path) -> None:
    async def story(at: Live) -> None:
        at.robot.begin(_directory(tmp_path / "1"), "1")
        mission = await at.until("driving")
        await asyncio.sleep(1.5)
        mission.pause()
        await at.robot.end("enough")
        at.robot.begin(_directory(tmp_path / "2"), "2")
        await at.until("driving")
        before_m = at.simulated.body.path_length_m
        await asyncio.sleep(3.0)
        assert at.simulated.body.path_length_m > before_m + 0.2
        await at.robot.end("enough")

    run_virtual(live(story, tmp_path))
    assert _summary(tmp_path / "2")["state"] == "stopped"


def test_a_run_stopped_in_full_drive_leaves_no_motion_to_the_next_one(tmp_path: Path) -> None:
    async def story(at: Live) -> None:
        at.robot.begin(_directory(tmp_path / "1"), "1")
        await at.until("driving")
        await asyncio.sleep(2.5)
        assert at.robot.pilot.velocity.vx_mps**2 + at.robot.pilot.velocity.vy_mps**2 > 0.01
        await at.robot.end("enough")
        await asyncio.sleep(1.0)
        before_m = at.simulated.body.path_length_m
        at.robot.begin(_directory(tmp_path / "2"), "2")
        await asyncio.sleep(1.0)
        assert at.simulated.body.path_length_m < before_m + 1e-3
        await at.robot.end("enough")

    run_virtual(live(story, tmp_path))


def test_a_run_stopped_before_it_began_ends(tmp_path: Path) -> None:
    async def story(at: Live) -> None:
        at.robot.begin(tmp_path, "short")
        await at.robot.end("at once")

    run_virtual(live(story, tmp_path))
    summary = _summary(tmp_path)
    assert (summary["state"], summary["reason"], summary["scans"]) == ("stopped", "at once", 0)


def test_a_full_disk_ends_the_run_but_not_the_daemon(tmp_path: Path) -> None:
    async def story(at: Live) -> None:
        at.robot.begin(tmp_path, "full")
        mission = await at.until("driving")
        mission.journal._file.close()
        mission.journal._file = full
        await at.robot.finished.wait()
        assert at.robot.pipeline.missing == []

    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full here")
    with Path("/dev/full").open("wb", buffering=0) as full:
        run_virtual(live(story, tmp_path))
    summary = _summary(tmp_path)
    assert summary["state"] == "failed"
    assert "No space left" in summary["reason"]
    assert (tmp_path / "map.png").stat().st_size > 0


def test_motors_that_fall_silent_for_good_end_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def story(at: Live) -> None:
        at.robot.begin(tmp_path, "dead")
        await at.until("driving")
        monkeypatch.setattr(MotorEmulator, "advance", lambda *_: b"")
        await at.robot.finished.wait()

    run_virtual(live(story, tmp_path))
    summary = _summary(tmp_path)
    assert summary["state"] == "failed"
    assert "motors: no telemetry" in summary["reason"]


def test_a_run_that_cannot_be_saved_is_told_and_the_next_one_may_start(tmp_path: Path) -> None:
    async def story(at: Live) -> None:
        lost = _directory(tmp_path / "lost")
        at.robot.begin(lost, "lost")
        await asyncio.sleep(1.0)
        lost.rename(tmp_path / "elsewhere")
        with pytest.raises(InputError, match=r"map\.pgm: cannot be written"):
            await at.robot.end("enough")
        assert at.robot.last_summary is not None
        assert at.robot.last_summary["state"] == "failed"
        at.robot.begin(_directory(tmp_path / "next"), "next")
        await at.robot.end("enough")

    run_virtual(live(story, tmp_path))
    assert _summary(tmp_path / "next")["state"] == "stopped"


def test_a_bug_in_the_core_leaves_the_map_and_the_truth_about_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    light, calls = RunCore.compute, []

    def buggy(self, job):
        calls.append(job)
        if len(calls) == 2:
            raise ZeroDivisionError("a bug")
        return light(self, job)

    async def story(at: Live) -> None:
        at.robot.begin(tmp_path, "buggy")
        await at.robot.finished.wait()

    monkeypatch.setattr(RunCore, "compute", buggy)
    with pytest.raises(ExceptionGroup) as raised:
        run_virtual(live(story, tmp_path))
    assert raised.group_contains(ZeroDivisionError)
    summary = _summary(tmp_path)
    assert (summary["state"], summary["nodes"]) == ("failed", 1)
    assert "internal error" in summary["reason"]


def test_saving_in_real_time_disturbs_no_device(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save, names = runtime.write_run, []

    def slow(*saved):
        threading.Event().wait(0.3)  # fifteen telemetry frames come meanwhile
        return save(*saved)

    async def story(at: Live) -> None:
        at.robot.begin(tmp_path, "real")
        await asyncio.sleep(0.5)
        names.append(await at.robot.snapshot(lambda result: threading.current_thread().name))
        await at.robot.end("enough")

    monkeypatch.setattr(runtime, "write_run", slow)
    robot = asyncio.run(live(story, tmp_path))
    assert names[0].startswith("survey")  # where nothing changes the grid meanwhile
    for device in ("lrf", "imu", "motors"):
        assert robot.supervisor.reports[device].last_error == ""


def test_a_stop_during_clear_is_not_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def story(at: Live) -> None:
        at.robot.stop_motors("bumper")

        async def rearm() -> None:
            at.robot.stop_motors("emergency stop")

        monkeypatch.setattr(at.robot.pipeline.motors, "rearm", rearm)
        with pytest.raises(StateError, match="meanwhile"):
            await at.robot.release_motors()
        assert at.robot.stop_latch.is_set
        assert at.robot.pilot.is_stopped
        monkeypatch.undo()
        await at.robot.release_motors()
        assert not at.robot.stop_latch.is_set

    run_virtual(live(story, tmp_path))


def test_a_run_without_a_map_has_all_keys_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["simulate", "open_room", "--out", str(tmp_path)]
    impossible = ["--set", "lrf.spin_up_timeout_s=0.05"]
    (tmp_path / "summary.json").write_text('{"state": "complete"}')
    assert main([*words, *impossible]) == 1
    assert capsys.readouterr().out.startswith("failed: lrf: ")
    assert main([*words, *impossible, "--json"]) == 1
    summary = json.loads(capsys.readouterr().out)
    assert summary == _summary(tmp_path)
    assert summary["state"] == "failed"
    assert summary["wall_error_m"] is None


def test_a_recording_that_cannot_be_opened_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run.journal").mkdir()
    assert main(["simulate", "open_room", "--out", str(tmp_path)]) == 1
    assert "run.journal: cannot be written" in capsys.readouterr().err
    assert main(["emulate", "--config-out", str(tmp_path / "c.toml"), "--seed", "-1"]) == 1
    assert "--seed -1" in capsys.readouterr().err


def test_what_is_no_file_is_not_replaced_by_a_configuration(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="not from `emulate`"):
        check_config_out(tmp_path / "pipe")
    check_config_out(tmp_path / "new.toml")


def test_one_emulated_configuration_belongs_to_one_emulator(tmp_path: Path) -> None:
    runs, config_out = tmp_path / "c.runs", tmp_path / "c.toml"
    refused = pytest.raises(InputError, match=r"c\.toml: another `ins-robot emulate` runs")
    with only_emulator(runs, config_out), refused, only_emulator(runs, config_out):
        pass
    with only_emulator(runs, config_out):  # the first has ended
        pass


@pytest.mark.parametrize("length", [1, 120])
def test_the_socket_of_an_emulated_configuration_outlives_the_emulator(length: int) -> None:
    config_out = Path("/d" * length, "c.toml")
    config = emulated_config(Config(), Path("/lines"), config_out)
    assert config.lrf.port == "/lines/lrf"
    assert not config.daemon.socket.startswith("/lines/")
    assert len(config.daemon.socket) <= 100
    other = emulated_config(Config(), Path("/other"), config_out)
    assert other.daemon == config.daemon


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_simulation_that_is_interrupted_leaves_its_map(
    number: signal.Signals,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    async def drive(mission: Mission, *args: object) -> None:
        signal.raise_signal(number)
        await asyncio.sleep(3600.0)

    monkeypatch.setattr(Mission, "_drive", drive)
    assert main(["simulate", "open_room", "--out", str(tmp_path)]) == 130
    says = f"interrupted; what was mapped so far is in {tmp_path}\n"
    assert capsys.readouterr().err.endswith(says)
    summary = _summary(tmp_path)
    assert (summary["state"], summary["scans"]) == ("stopped", 1)


def test_a_simulation_interrupted_at_once_does_not_claim_a_map(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    async def direct(*args: object) -> None:
        signal.raise_signal(signal.SIGINT)
        await asyncio.sleep(3600.0)

    monkeypatch.setattr("ins_robot.cli.commands.simulate._direct", direct)
    assert main(["simulate", "open_room", "--out", str(tmp_path)]) == 130
    assert "before the run began: no map is in" in capsys.readouterr().err


def test_two_devices_on_one_line_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    same = "wheels.port=/dev/ins-lrf"
    assert main(["simulate", "open_room", "--out", "unused", "--set", same]) == 1
    assert "two devices need two lines" in capsys.readouterr().err


def test_the_seed_of_the_configuration_counts(tmp_path: Path) -> None:
    short = ["simulate", "open_room", "--set", "exploration.max_scans=1"]
    for name, *words in [
        ("asked", "--seed", "7"),
        ("set", "--set", "slam.seed=7"),
        ("default",),
    ]:
        assert main([*short, "--out", str(tmp_path / name), *words]) == 0
    asked, configured, default = (
        (tmp_path / name / "graph.json").read_bytes() for name in ("asked", "set", "default")
    )
    assert asked == configured != default
