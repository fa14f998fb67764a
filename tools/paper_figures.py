# SPDX-License-Identifier: MIT
"""The paper's figures 3 to 9 from our own runs, and numbers for what it leaves open.

    python tools/paper_figures.py --out runs/paper                  # all of them
    python tools/paper_figures.py --out runs/paper --only 5,8,9
    python tools/paper_figures.py --out runs/paper --only 6 --seeds 10 --jobs 2
    python tools/paper_figures.py --out runs/paper --questions --seeds 5

Figures go to OUT/figureN.png, what they show and the runs behind them to stdout. Figure 3 needs
the recordings (--data). Figure 6 and --questions run five worlds with each seed, some 20 s a
run; runs in OUT are not run again, so after a change of the code take another OUT. Needs
matplotlib (filterpy brings it).
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

FIGURES = (3, 4, 5, 6, 7, 8, 9)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="where figures and runs go")
    parser.add_argument("--only", type=numbers, default=FIGURES, help="e.g. 3,5,6")
    parser.add_argument("--questions", action="store_true", help="the open questions alone")
    parser.add_argument("--seeds", type=int, default=10, help="of figure 6 and the questions")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    from paper_study import comparisons, estimator_figures, exploration_figures, sensor_figures

    if args.questions:
        print(comparisons.questions(args.out, args.seeds, args.jobs))
        return 0
    draw = {
        3: lambda: sensor_figures.figure_3(args.out, args.data),
        4: lambda: sensor_figures.figure_4(args.out),
        5: lambda: exploration_figures.figure_5(args.out),
        6: lambda: comparisons.figure_6(args.out, args.seeds, args.jobs),
        7: lambda: sensor_figures.figure_7(args.out),
        8: lambda: estimator_figures.figure_8(args.out),
        9: lambda: exploration_figures.figure_9(args.out),
    }
    for number in args.only:
        print(f"figure {number}: {draw[number]()}", flush=True)
    return 0


def numbers(text: str) -> tuple[int, ...]:
    found = tuple(int(part) for part in text.split(","))
    if not set(found) <= set(FIGURES):
        raise argparse.ArgumentTypeError(f"figures are {FIGURES[0]} to {FIGURES[-1]}")
    return found


if __name__ == "__main__":
    raise SystemExit(main())
