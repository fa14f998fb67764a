# SPDX-License-Identifier: MIT
"""The cells of the benchmark, and running them: one after another, in a pool, or on a cluster.

A finished cell is a line of results.jsonl and is not run again. A worker that dies loses only
what it was at: that cell is given to another.
"""

from __future__ import annotations

import csv
import json
import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from pathlib import Path

from exploration_study.measure import measure_reference, measure_sensor

ATTEMPTS = 3  # of a cell whose worker died


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """One cell of the benchmark."""

    folder: str
    world: str
    start: int
    strategy: str
    mode: str
    pose: str
    seed: int
    sensor: str
    overrides: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """What tells it from others, wherever its worlds lie."""
        return json.dumps([v for k, v in asdict(self).items() if k != "folder"])


def measure(job: Job) -> dict[str, object]:
    """Run one cell; a JSON-able line."""
    begun = time.perf_counter()
    x_m, y_m = read_starts(Path(job.folder))[job.world][job.start]
    path = Path(job.folder) / f"{job.world}.yaml"
    if job.sensor == "reference":
        track = measure_reference(path, (x_m, y_m), job.strategy, job.mode)
    else:
        track = measure_sensor(
            path, (x_m, y_m), job.strategy, job.mode, job.pose, job.seed, job.overrides
        )
    names = ("world", "start", "strategy", "mode", "pose", "seed", "sensor")
    return {
        **{name: getattr(job, name) for name in names},
        **track.as_json(),
        "wall_s": round(time.perf_counter() - begun, 1),
        "key": job.key,
        "curve": _thinned(track.curve),
    }


def _thinned(
    curve: list[tuple[float, float, float]], most: int = 120
) -> list[tuple[float, float, float]]:
    step = max(1, math.ceil(len(curve) / most))
    return [*curve[:-1:step], curve[-1]] if curve else []


def read_starts(folder: Path) -> dict[str, list[tuple[float, float]]]:
    """Start places by world, from worlds.csv."""
    starts: dict[str, list[tuple[float, float]]] = {}
    with (folder / "worlds.csv").open() as file:
        for row in csv.DictReader(file):
            places = []
            while row.get(f"start{len(places)}_x_m"):
                n = len(places)
                places.append((float(row[f"start{n}_x_m"]), float(row[f"start{n}_y_m"])))
            starts[row["name"]] = places
    return starts


def read_results(file: Path) -> dict[str, dict[str, object]]:
    """Finished lines by key; a line cut off by an interruption does not count."""
    done: dict[str, dict[str, object]] = {}
    if not file.exists():
        return done
    for line in file.read_text().splitlines():
        try:
            row = json.loads(line)
            done[str(row["key"])] = row
        except (ValueError, KeyError):
            continue
    return done


Runner = Callable[[list[Job]], Iterable[dict[str, object]]]


def finish(jobs: list[Job], file: Path, run: Runner) -> list[dict[str, object]]:
    """Run what is not in the file yet, each line written as it comes; all lines in order."""
    done = read_results(file)
    waiting = [job for job in jobs if job.key not in done]
    print(f"{len(jobs)} cells, {len(jobs) - len(waiting)} finished before", file=sys.stderr)
    with file.open("a") as out:
        if file.stat().st_size and not file.read_bytes().endswith(b"\n"):
            out.write("\n")
        for count, row in enumerate(run(waiting), start=1):
            out.write(json.dumps(row) + "\n")
            out.flush()
            done[str(row["key"])] = row
            print(f"{count}/{len(waiting)} {line_of(row)}", file=sys.stderr, flush=True)
    return [done[job.key] for job in jobs if job.key in done]


def line_of(row: dict[str, object]) -> str:
    """A cell in one line, for who watches."""
    return (
        "{world} start {start} {strategy} {mode} {pose} seed {seed}: L99 {l99_m} m, "
        "coverage {coverage}, {stops} stops, {time_s} s, {ms_per_decision} ms a decision"
    ).format(**row) + (f", {row['failure']}" if row["failure"] else "")


def run_here(count: int) -> Runner:
    """On this machine, in `count` processes."""

    def run(jobs: list[Job]) -> Iterator[dict[str, object]]:
        if count <= 1:
            yield from (measure(job) for job in jobs)
            return
        left = dict.fromkeys(jobs, ATTEMPTS)
        while left:
            with ProcessPoolExecutor(count) as pool:
                futures: dict[Future[dict[str, object]], Job] = {
                    pool.submit(measure, job): job for job in left
                }
                for future in as_completed(futures):
                    job = futures[future]
                    try:
                        row = future.result()
                    except BrokenProcessPool:
                        left[job] -= 1
                        continue
                    del left[job]
                    yield row
            for job in [job for job, attempts in left.items() if attempts == 0]:
                raise SystemExit(
                    f"{job.world} {job.strategy}: its worker died {ATTEMPTS} times; "
                    "out of memory? run with --jobs 1"
                )

    return run


def run_on_cluster(address: str) -> Runner:
    """On the workers of a Dask scheduler; they need this package and the worlds' directory."""

    def run(jobs: list[Job]) -> Iterator[dict[str, object]]:
        try:
            from distributed import Client
            from distributed import as_completed as completed
        except ImportError:
            raise SystemExit(
                "--scheduler needs Dask: pip install 'ins-robot[cluster]'"
            ) from None
        with Client(address) as client:
            client.run(_find_tools, str(Path(__file__).parents[1]))
            futures = client.map(measure, jobs, pure=False, retries=ATTEMPTS)
            for future in completed(futures):
                yield future.result()

    return run


def _find_tools(folder: str) -> None:
    if folder not in sys.path:
        sys.path.insert(0, folder)
