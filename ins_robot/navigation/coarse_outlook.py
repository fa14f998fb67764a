# SPDX-License-Identifier: MIT
"""An outlook in larger cells, to look far in little time; an aim there, back in its own.

A large cell is opaque when any of its cells is: what shows through a hole smaller than it is
not counted on.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ins_robot.navigation.outlook import Aim, IndexArray, Outlook


def coarsened(outlook: Outlook, times: int) -> Outlook:
    """In cells `times` as large: unseen where all is, as cheap to get to as the best of it."""
    is_opaque = _pooled(outlook.is_opaque, times, np.logical_or, False)
    is_unseen = _pooled(outlook.is_unseen, times, np.logical_and, True) & ~is_opaque
    cost_m = _pooled(outlook.cost_m, times, np.minimum, np.inf)
    factor = _pooled(outlook.factor, times, np.minimum, np.inf)
    return replace(
        outlook,
        resolution_m=outlook.resolution_m * times,
        is_unseen=is_unseen,
        is_opaque=is_opaque,
        factor=np.where(np.isfinite(cost_m), factor, np.inf),
        cost_m=cost_m,
        before=np.zeros((0, 0), np.int64),
        here=(outlook.here[0] // times, outlook.here[1] // times),
        edges=_in_blocks(outlook.edges, times),
        looks=replace(outlook.looks, cells=outlook.looks.cells / times),
        short_edges=_in_blocks(outlook.short_edges, times),
    )


def refined(outlook: Outlook, aim: Aim, times: int) -> Aim:
    """The same aim in an outlook's own cells: the cheapest there, and all edge cells there."""
    first = np.array(aim.cell) * times
    block = outlook.cost_m[first[0] : first[0] + times, first[1] : first[1] + times]
    row, col = divmod(int(block.argmin()), block.shape[1])
    edges = np.concatenate([*outlook.edges, *outlook.short_edges])
    is_target = np.zeros([n // times + 1 for n in outlook.cost_m.shape], bool)
    is_target[aim.targets[:, 0], aim.targets[:, 1]] = True
    coarse = edges // times
    return Aim(
        cell=(int(first[0]) + row, int(first[1]) + col),
        targets=edges[is_target[coarse[:, 0], coarse[:, 1]]],
        why=aim.why,
        heeds_looks=aim.heeds_looks,
        worth=aim.worth,
    )


def _pooled(cells: NDArray[Any], times: int, combine: np.ufunc, beyond: float) -> NDArray[Any]:
    """Blocks of cells (H, W) combined; past the end of the grid `beyond`."""
    height, width = cells.shape
    margins = [(0, -height % times), (0, -width % times)]
    cells = np.pad(cells, margins, constant_values=beyond)
    for _ in range(2):
        pooled = cells[::times]
        for k in range(1, times):
            pooled = combine(pooled, cells[k::times])
        cells = pooled.T
    return np.ascontiguousarray(cells)


def _in_blocks(edges: tuple[IndexArray, ...], times: int) -> tuple[IndexArray, ...]:
    """Each edge's cells (n, 2) in larger cells, once each."""
    sizes = [len(edge) for edge in edges]
    if not sizes:
        return ()
    cells = np.concatenate(edges) // times
    width = int(cells[:, 1].max()) + 1
    of = np.repeat(np.arange(len(edges)), sizes)
    key = (of * (int(cells[:, 0].max()) + 1) + cells[:, 0]) * width + cells[:, 1]
    _, first = np.unique(key, return_index=True)
    cuts = np.flatnonzero(np.diff(of[first])) + 1
    return tuple(np.split(cells[first], cuts))
