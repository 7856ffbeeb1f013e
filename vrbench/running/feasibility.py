"""Whether what a suite does in its takes fits into them: known before anything is recorded."""

from __future__ import annotations

from vrbench.config.case import Case
from vrbench.config.suite import Suite
from vrbench.errors import ConfigError
from vrbench.estimation.clock import MINIMUM_OVERLAP_S
from vrbench.motion.motion import at_speed


def check_feasible(suite: Suite, where: str) -> None:
    """Goes through every case that a robot moves, by the lengths of its motions.

    Args:
        suite: theirs.
        where: its file or name, for messages.

    Raises:
        ConfigError: an event comes after its take's last run, or a take is too short for its clock
            to be found; or as `Suite.motion`.
        DataError: as `Suite.motion`.
    """
    if suite.mover != "robot":
        return
    for case in suite.all_cases():
        last = _last_run_ends_s(suite, case)
        late = max((cue.at for cue in case.events if cue.at is not None), default=0.0)
        if late >= last:
            raise ConfigError(
                f"case {case.id} has an event at {late:g} s, and its last run is over after "
                f"{last:.4g} s",
                file=where,
                field="events",
                fix="give an earlier time, or after (runs of the motion)",
            )
        if "clock" in case.needs and last + case.hold < MINIMUM_OVERLAP_S:
            raise ConfigError(
                f"case {case.id} takes {last + case.hold:.3g} s at speed {case.speed:g}, and needs "
                "clock",
                file=where,
                field="cases",
                fix=f"at least {MINIMUM_OVERLAP_S:g} s are needed to find a clock",
            )


def _last_run_ends_s(suite: Suite, case: Case) -> float:
    """When the robot comes to rest for the last time, from the first run's begin [s].

    Without the ways back to where the motion begins, which only a plan knows.
    """
    if case.duration is not None:
        return case.duration
    once = at_speed(suite.motion(case.motion), case.speed).duration_s
    return case.loops * once + (case.loops - 1) * case.hold
