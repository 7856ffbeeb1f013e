"""Conformance of metric families, on a made-up take whose errors are known to nobody but it."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from vrbench.clocks import ClockMap
from vrbench.config.rig import Mounting
from vrbench.errors import EstimationError
from vrbench.geometry import Transform, quat_multiply, rotvec_to_quat
from vrbench.metrics.registry import Family, Value
from vrbench.metrics.scored import ScoredTake
from vrbench.motion.generators import generate
from vrbench.plugin.testing.offered import Offered
from vrbench.plugin.testing.verdicts import NonconformityError, require
from vrbench.streams import Columns, Samples
from vrbench.trajectory import NS, Trajectory

UNITS = frozenset(
    ["mm", "deg", "ms", "s", "ppm", "Hz", "%", "1", "count", "mm/m", "mm/h", "deg/h", "mm/(m/s)"]
)
STATISTICS = frozenset(
    [
        "rmse",
        "mean",
        "median",
        "std",
        "min",
        "max",
        "p95",
        "sse",
        "value",
        "slope",
        "last-first",
        "count",
    ]
)
POINTS, BANDS = ("", "eye", "tcp", "body"), ("all", "<2Hz", ">2Hz")
METRIC = re.compile(r"[a-z][a-z0-9_-]*(\.[a-z0-9_-]+)*(@\S+)?")
Y = Transform.of((0.4, -0.3, 1.1), (0.5, 0.5, 0.5, 0.5))


def made_up_take(seed: int = 1, seconds: float = 20.0) -> ScoredTake:
    """A take of a simulated head that errs by about a millimetre; its arrays can't be written."""
    rng = np.random.default_rng(seed)
    x = Mounting().tcp_eye.transform()
    motion = generate("saturate-30s-1").trajectory
    start = 1_700_000_000 * NS + seed * 100 * NS
    there = np.arange(0, seconds, 0.01)
    t_reference = np.rint((there + 5.0) * NS).astype(np.int64)
    s = np.arange(0, seconds, 1 / 72)
    t = np.rint((s + 5.0) * NS).astype(np.int64)

    def tcp(at: np.ndarray) -> Transform:
        return motion.at(at) @ x.inverse()

    off = Transform(
        rng.normal(0.0, 1e-3, (len(s), 3)), rotvec_to_quat(rng.normal(0.0, 1e-3, (len(s), 3)))
    )
    eye = tcp(t) @ x
    world = Y.inverse() @ Transform(eye.p + off.p, quat_multiply(eye.q, off.q))
    truth, reference = tcp(t), Trajectory(t_reference + start, tcp(t_reference))
    samples = Samples.of(t + start, world)
    streams = {
        "headset/eye": samples,
        "robot/tcp": Samples.of(reference.t, reference.pose),
        "robot/target": Samples.of(reference.t, reference.pose),
    }
    for array in (truth.p, truth.q, world.p, world.q, reference.pose.p, reference.pose.q):
        array.flags.writeable = False
    return ScoredTake(
        columns=Columns(streams),
        reference=reference,
        samples=samples,
        estimate=samples.trajectory(),
        truth=truth,
        clock=ClockMap.affine(start, 0.0),
        x=x,
        y=Y,
        anchor_end=int(reference.t[0]) + 5 * NS,
    )


class MetricConformance(Offered):
    """What a metric family is held to."""

    kind = "metric"

    def test_units_and_names_are_those_of_tables(self) -> None:
        """Each metric has a dotted name and one of the units that tables know."""
        family: Family = self.thing()
        require(family.units, "the family has no metrics", "units={'name.of.metric': 'mm'}.")
        for metric, unit in family.units.items():
            require(
                METRIC.fullmatch(metric), f"{metric!r} is no good name", "Lower case, with dots."
            )
            require(
                unit in UNITS, f"unit {unit!r} of {metric}", f"One of {' '.join(sorted(UNITS))}."
            )
        require(
            family.of_take or family.of_repeats,
            "the family computes nothing",
            "Give of_take, or of_repeats.",
        )

    def test_values_are_as_declared(self) -> None:
        """Its values are of its metrics, in their units, finite or with a reason."""
        for value in self._values(made_up_take()):
            check_value(self.thing(), value)

    def test_the_same_take_gives_the_same_values(self) -> None:
        """Nothing in it is left to chance, and nothing is kept from take to take."""
        first = self._values(made_up_take())
        self._values(made_up_take(2))
        require(
            first == self._values(made_up_take()),
            "the same take gives other values",
            "Seed what is random, and keep no state between calls.",
        )

    def test_a_take_without_x_is_no_surprise(self) -> None:
        """What doesn't declare that it needs X does without."""
        family: Family = self.thing()
        if "x" not in family.needs:
            self._values(replace(made_up_take(), x=None, y=None))

    def test_a_short_take_is_told(self) -> None:
        """A take too short for it gives values with a reason, or an EstimationError."""
        for value in self._values(made_up_take(seconds=0.1)):
            check_value(self.thing(), value)

    def _values(self, take: ScoredTake) -> list[Value]:
        family: Family = self.thing()
        found: list[Value] = []
        try:
            if family.of_take is not None:
                found += _list(family.of_take(take))
            if family.of_repeats is not None:
                found += _list(family.of_repeats([take, take]))
        except EstimationError:
            return []
        except ValueError as error:
            if "read-only" not in str(error):
                raise
            raise NonconformityError(
                f"it writes into the take: {error}", "Copy what you change."
            ) from None
        return found


def _list(values: Iterable[Value]) -> list[Value]:
    return list(values)


def check_value(family: Family, value: object) -> None:
    """That a value is one of the family's.

    Raises:
        NonconformityError: it isn't.
    """
    if not isinstance(value, Value):
        raise NonconformityError(
            f"it yields a {type(value).__name__}", "Yield vrbench.metrics.registry.Value."
        )
    require(
        family.units.get(value.metric) == value.unit,
        f"{value.metric} comes in {value.unit!r}, declared is {family.units.get(value.metric)!r}",
        "Name every metric and its unit in `units`.",
    )
    for what, found, right in (
        ("statistic", value.statistic, sorted(STATISTICS)),
        ("point", value.point, POINTS),
        ("band", value.band, BANDS),
    ):
        require(
            found in right, f"{what} {found!r} of {value.metric}", f"One of {', '.join(right)}."
        )
    if value.value is None:
        require(value.reason, f"{value.metric} has no number and no reason", "Say why.")
    else:
        require(
            np.isfinite(value.value),
            f"{value.metric} is {value.value}",
            "Where there is no number, value=None and a reason.",
        )
