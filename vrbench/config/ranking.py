"""Whether runs of a suite can have a rank at all: what is known before anything is recorded."""

from __future__ import annotations

from collections import Counter

from vrbench.config.suite import Suite

# What several takes have together, with an interval; and what changes against a baseline are of.
POOLED = ("rmse", "mean")
CHANGES = ("ape.translation.aligned", "ape.rotation.aligned")
MIN_MOUNTS, MIN_REPEATS = 2, 3


def never_ranked(suite: Suite) -> list[str]:
    """Why no run of it stands on a board with a rank, a sentence each; none where runs can."""
    rank, found = suite.rank, []
    if rank.statistic not in POOLED:
        found.append(f"rank.statistic is {rank.statistic}: boards rank by {' or '.join(POOLED)}")
    if suite.compare == "paired" and (rank.metric not in CHANGES or rank.statistic != "rmse"):
        found.append(
            f"changes against the baseline are of the rmse of {' and '.join(CHANGES)} alone: only "
            "the baseline has a board"
        )
    ranked = [step for step in suite.schedule() if step.case.role == "scored"]
    takes = Counter((s.case.id, s.condition, s.mount) for s in ranked or suite.schedule())
    mounts = Counter((case, condition) for case, condition, _ in takes)
    if min(takes.values()) < MIN_REPEATS or min(mounts.values()) < MIN_MOUNTS:
        found.append(
            "a rank takes two mounts of three takes each: repeats: 3 and remounts: 1, or more"
        )
    return found
