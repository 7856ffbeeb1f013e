"""Fixings: how the headset sat while hands were now and then at it, within one mount.

After every change of condition a check motion estimates X anew. Where that disagrees with what was
found before, the headset has moved on its mount: from there on it counts as fixed anew.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from vrbench.protocols.calibration import Calibration, slip
from vrbench.statistics import NORMAL_95


@dataclass(frozen=True, slots=True, eq=False)
class Fixing:
    """The calibrations and checks between which the headset didn't move on its mount.

    Attributes:
        members: in order of time.
        checks: names of the takes that are checks.
        moved: how it had moved before, in words; empty for the first fixing of a mount.
    """

    members: Sequence[Calibration]
    checks: Collection[str]
    moved: str = ""

    def without(self, take: str) -> Fixing:
        """The same without what this take found."""
        return Fixing([c for c in self.members if c.take != take], self.checks, self.moved)

    @property
    def best(self) -> list[Calibration]:
        """Those that X is taken from: calibrations, and checks only where there are no others."""
        return [c for c in self.members if c.take not in self.checks] or list(self.members)


def fixing_at(
    calibrations: Sequence[Calibration], checks: Collection[str], when: int, bracket_m: float
) -> Fixing:
    """The fixing that holds at a time.

    Only a check begins a new one: calibrations that disagree without hands between them are for the
    gate to refuse. It does so where its X differs from one before by more than `bracket_m` and than
    the uncertainty of both explains.

    Args:
        calibrations: of one mount, checks too.
        checks: names of the takes that are checks.
        when: time by the recorder's clock [ns].
        bracket_m: how far X may differ [m].
    """
    fixings = [Fixing([], checks)]
    for c in sorted(calibrations, key=lambda c: c.start):
        members = fixings[-1].members
        moved = _moved(members, c, bracket_m) if c.take in checks else ""
        if moved:
            fixings.append(Fixing([c], checks, moved))
        else:
            fixings[-1] = Fixing([*members, c], checks, fixings[-1].moved)
    begun = [f for f in fixings[1:] if f.members[0].start <= when]
    return begun[-1] if begun else fixings[0]


def _moved(before: Sequence[Calibration], check: Calibration, bracket_m: float) -> str:
    """How far a check finds the headset from where it was; empty where that may be chance."""
    for earlier in before:
        apart, sigma = slip(earlier, check)
        chance = NORMAL_95 * sigma
        if apart - chance > bracket_m:
            return (
                f"the headset moved by {apart * 1e3:.1f} mm (+- {chance * 1e3:.1f}) between "
                f"{earlier.take} and {check.take}: scored with the X found since"
            )
    return ""
