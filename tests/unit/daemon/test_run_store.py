# SPDX-License-Identifier: MIT
"""Run directories: counted for ever, listed truthfully, removed whole."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ins_robot.daemon import run_store
from ins_robot.daemon.run_store import RunStore, sanitised
from ins_robot.errors import InputError, StateError


def finish(path: Path, **summary: object) -> None:
    (path / "summary.json").write_text(json.dumps({"state": "complete", **summary}))


def test_runs_are_counted_and_named(tmp_path: Path) -> None:
    store = RunStore(tmp_path / "var" / "runs")
    assert store.names() == []
    assert [store.create(name).name for name in ("lab", "", "../Büro 7/x")] == [
        "0001-lab",
        "0002-run",
        "0003-B-ro-7-x",
    ]
    assert store.names() == ["0001-lab", "0002-run", "0003-B-ro-7-x"]


def test_a_number_is_never_given_twice(tmp_path: Path) -> None:
    RunStore(tmp_path).create("a")
    RunStore(tmp_path).create("b")
    RunStore(tmp_path).delete(["0001-a", "0002-b"])
    assert RunStore(tmp_path).create("c").name == "0003-c"


@pytest.mark.parametrize("content", [None, b"", b"12x", b"\xff\xff", b"1"])
def test_a_lost_or_torn_counter_goes_on_after_the_highest_run(
    tmp_path: Path, content: bytes | None
) -> None:
    (tmp_path / "0041-lab").mkdir()
    (tmp_path / "0007-lab").mkdir()
    if content is not None:
        (tmp_path / run_store.COUNTER_FILE).write_bytes(content)
    assert RunStore(tmp_path).create().name == "0042-run"


def test_a_crash_between_counting_and_making_skips_a_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = RunStore(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(run_store, "sanitised", lambda name: "missing/parent")
        with pytest.raises(InputError, match="no run can be created"):
            store.create()
    assert store.create("next").name == "0002-next"


def test_numbers_beyond_four_digits_still_sort(tmp_path: Path) -> None:
    for name in ("10000-a", "9999-b", "0002-c"):
        (tmp_path / name).mkdir()
    assert RunStore(tmp_path).names() == ["0002-c", "9999-b", "10000-a"]


def test_the_list_tells_what_is_known(tmp_path: Path) -> None:
    store = RunStore(tmp_path)
    done, torn, odd, current = (store.create(name) for name in "abcd")
    finish(done, reason="no gap is left", duration_s=61.5, path_length_m=12.25, scans=9)
    (done / "map.png").write_bytes(bytes(500_000))
    (torn / "summary.json").write_text('{"state": "comp')
    (odd / "summary.json").write_text(
        '{"state": "failed", "scans": "many", "duration_s": true}'
    )
    infos = store.infos(current=current.name)
    assert [info.state for info in infos] == ["complete", "interrupted", "failed", "running"]
    assert (infos[0].duration_s, infos[0].path_length_m, infos[0].scans) == (61.5, 12.25, 9)
    assert infos[0].reason == "no gap is left"
    assert infos[0].size_mb == pytest.approx(0.5, abs=0.01)
    assert (infos[2].scans, infos[2].duration_s) == (None, None)
    json.dumps([info.as_dict() for info in infos])


def test_other_files_are_not_runs(tmp_path: Path) -> None:
    store = RunStore(tmp_path)
    store.create("real")
    (tmp_path / "0002-file").write_text("")
    (tmp_path / "notes").mkdir()
    elsewhere = tmp_path.parent / "elsewhere"
    elsewhere.mkdir()
    (tmp_path / "0003-link").symlink_to(elsewhere)
    assert store.names() == ["0001-real"]
    assert store.create().name == "0002-run"  # numbers count runs only


def test_deleting_is_all_or_nothing(tmp_path: Path) -> None:
    store = RunStore(tmp_path)
    for name in "abc":
        finish(store.create(name))
    with pytest.raises(InputError, match="no run '0009-z'"):
        store.delete(["0001-a", "0009-z"])
    with pytest.raises(StateError, match="'0002-b' is being recorded"):
        store.delete(["0001-a", "0002-b"], current="0002-b")
    assert store.names() == ["0001-a", "0002-b", "0003-c"]
    store.delete(["0001-a", "0001-a", "0003-c"])
    assert store.names() == ["0002-b"]
    assert sorted(path.name for path in tmp_path.iterdir()) == [".counter", "0002-b"]


@pytest.mark.parametrize(
    "name", ["", ".", "..", "../victim", "/tmp", "0001-a/../../victim", "victim", "0001-a\n"]
)
def test_nothing_but_runs_can_be_deleted(tmp_path: Path, name: str) -> None:
    victim = tmp_path / "victim"
    victim.mkdir()
    store = RunStore(tmp_path / "runs")
    store.create("a")
    with pytest.raises(InputError):
        store.delete([name])
    assert victim.is_dir()
    assert store.names() == ["0001-a"]


def test_a_deletion_cut_short_is_finished_by_the_next_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = RunStore(tmp_path)
    finish(store.create("a"))

    def power_cut(path: Path, **options: object) -> None:
        if not options:
            raise OSError(5, "Input/output error")

    with monkeypatch.context() as patch:
        patch.setattr(run_store.shutil, "rmtree", power_cut)
        with pytest.raises(InputError, match="0001-a: cannot be removed"):
            store.delete(["0001-a"])
    assert store.names() == []  # never a run with half of its files
    store.create("b")
    assert sorted(path.name for path in tmp_path.iterdir()) == [".counter", "0002-b"]


def test_the_oldest_runs_make_room(tmp_path: Path) -> None:
    store = RunStore(tmp_path, keep_runs=3)
    for name in "abcde":
        store.create(name)
    assert store.names() == ["0003-c", "0004-d", "0005-e"]
    assert RunStore(tmp_path, keep_runs=1).prune(current="0003-c") == ["0004-d"]
    assert store.names() == ["0003-c", "0005-e"]
    assert RunStore(tmp_path, keep_runs=0).prune() == []


def test_a_full_disk_refuses_a_run_and_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(StateError, match=r"MB free, daemon.keep_free_mb = 1000000000000"):
        RunStore(tmp_path, keep_free_mb=10**12).create("a")
    assert list(tmp_path.iterdir()) == []


def test_a_directory_that_cannot_be_is_one_clear_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"daemon\.runs = .*file/runs: no run can be created"):
        RunStore(tmp_path / "file" / "runs").create()


def test_the_latest_map(tmp_path: Path) -> None:
    store = RunStore(tmp_path)
    assert store.latest_with("map.png") is None
    first, second, _ = (store.create(name) for name in "abc")
    (first / "map.png").write_bytes(b"1")
    (second / "map.png").write_bytes(b"2")
    assert store.latest_with("map.png") == second / "map.png"


@given(st.text(max_size=200))
def test_every_name_becomes_a_plain_one(name: str) -> None:
    clean = sanitised(name)
    assert 1 <= len(clean) <= 64
    assert set(clean) <= set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_")
    assert sanitised(clean) == clean
