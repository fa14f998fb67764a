# SPDX-License-Identifier: MIT
"""What a run left unseen, in one line: how many places, and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any


def left_words(summary: Mapping[str, Any]) -> str:
    """`2 places left unseen (1 no go, 1 too narrow), ...`; "" when nothing is known to be left.

    `summary` is that of the run, or its notes.
    """
    left = summary.get("left") or ()
    if not left:
        return ""
    reasons = Counter(str(place["state"]).replace("_", " ") for place in left)
    why = ", ".join(f"{count} {reason}" for reason, count in sorted(reasons.items()))
    places = "1 place" if len(left) == 1 else f"{len(left)} places"
    return f"{places} left unseen ({why}), see summary.json `left`"
