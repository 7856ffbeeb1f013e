"""How much a run will write, and whether there is room for it."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path

from vrbench.config.suite import Step, Suite
from vrbench.errors import ConfigError
from vrbench.motion.motion import at_speed
from vrbench.recording.guard import LEAST_FREE
from vrbench.recording.recorder import SETTLE_S

# Bytes a sample takes in a take, with its joints, states and indexes: measured on takes of the
# emulated devices, and rounded up.
BYTES = {"robot": 600, "mocap": 200, "headset": 350}
# A person moves as long as they like: half an hour is reckoned with.
PERSONS_S = 1800.0
# Retries, plans, results.
MARGIN = 1.25


def run_bytes(suite: Suite, steps: Sequence[Step], rates: Mapping[str, float]) -> int:
    """How much the takes of these steps will take, roughly [bytes].

    Args:
        suite: theirs.
        steps: what is recorded.
        rates: of the rig's devices [Hz], by `robot`, `mocap`, `headset`.
    """
    a_second = sum(BYTES[name] * rate for name, rate in rates.items())
    seconds = sum(step_s(suite, step) for step in steps)
    return round(MARGIN * a_second * seconds)


def step_s(suite: Suite, step: Step) -> float:
    """How long a take lasts, roughly [s]; a plan may stretch it."""
    case = step.case
    if suite.mover == "person":
        return PERSONS_S
    if case.duration is not None:
        return case.duration + 2 * SETTLE_S
    once = at_speed(suite.motion(case.motion), case.speed).duration_s + case.hold
    return case.loops * once + 2 * SETTLE_S


def check_room(folder: Path, needed: int) -> None:
    """Refuses to begin what can't be ended.

    Raises:
        ConfigError: the disk that the folder is or will be on has less room than `needed` bytes.
    """
    place = folder.absolute()
    while not place.exists():
        place = place.parent
    free = shutil.disk_usage(place).free
    if free < needed + LEAST_FREE:
        raise ConfigError(
            f"the run will take about {_size(needed)} and leaves {_size(LEAST_FREE)} alone, "
            f"and {_size(free)} are free",
            file=folder,
            field="-o",
            fix="make room, or name a folder on another disk",
        )


def _size(size: float) -> str:
    for unit in ("kB", "MB"):
        size /= 1e3
        if size < 1e3:
            return f"{size:.0f} {unit}"
    return f"{size / 1e3:.1f} GB"
