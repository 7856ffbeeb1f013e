"""Conformance of what sends poses live: what headsets and motion capture have in common."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from vrbench.config.rig import SIMULATED
from vrbench.devices.rehearsal import LOST_EVERY_S, LOST_FROM_S, LOST_UNTIL_S, RECENTRE_EVERY_S
from vrbench.geometry import Bools, Floats
from vrbench.plugin.testing.child import check_without_device
from vrbench.plugin.testing.offered import WithStandIn
from vrbench.plugin.testing.opening import Recorded, median_rate, options_of, record
from vrbench.plugin.testing.stamps import check_times
from vrbench.plugin.testing.twist import Match, diagnosis, match
from vrbench.plugin.testing.verdicts import NotCheckedError, given, require
from vrbench.streams import GOOD, Flag
from vrbench.trajectory import NS

# Measured against declared, relative.
RATE_TOLERANCE = 0.1
# About a loss or a recentre, what is right depends on the stamps: not looked at [s].
MARGIN_S = 0.06
FUTURE_NS = 200_000_000
# A `read` that waits holds all other devices up.
READ_S = 0.1


class SourceConformance(WithStandIn):
    """What headsets and motion capture have in common.

    A stand-in plays known movements by the vendor's protocol: `spec.stand_in`, or a method
    `stand_in(rehearsal)` of the test class, for those whose stand-in is no part of the package.

    Attributes:
        stream: what the stream is called in a take, or how its name begins.
        rate_hz: at which the stand-in sends, where it isn't the declared rate.
    """

    stream: ClassVar[str]
    rate_hz: ClassVar[float | None] = None

    @classmethod
    def live(cls) -> Any:
        """The spec of a device that can be opened here.

        Raises:
            NotCheckedError: it has no live route.
        """
        spec = cls.thing()
        if cls.name == SIMULATED:
            raise NotCheckedError(
                "simulated devices move on a stage, in virtual time", "their own tests check them"
            )
        if spec.open is None:
            raise NotCheckedError(
                f"{cls.name} is a model without a live route", "check the route it is used with"
            )
        return spec

    @classmethod
    def recorded(cls) -> Recorded:
        """What came of a rehearsal, recorded once for all tests of the class."""
        spec = cls.live()
        found = cls.kept("recorded", lambda: _kept_error(lambda: cls._record(spec)))
        if isinstance(found, BaseException):
            raise found
        recorded: Recorded = found
        return recorded

    @classmethod
    def _record(cls, spec: Any) -> Recorded:
        return record(cls.kind, spec, cls.stand_in, cls.stream, cls.rate_hz)

    @classmethod
    def came(cls) -> Recorded:
        """The same, for checks of what came: where nothing did, another check tells."""
        return given(cls.recorded, "nothing was recorded")

    @classmethod
    def matched(cls) -> tuple[Floats, Match]:
        """Times of the samples since the rehearsal began (n,) [s], and how they match it."""
        recorded = cls.came()
        samples, rehearsal = recorded.samples, recorded.rehearsal
        given(lambda: check_times(recorded), "the stamps aren't times")
        s = rehearsal.seconds(samples.pose_t)
        # where the source's clock isn't followed, arrivals tell about when it was
        around = float(np.median(samples.pose_t - samples.receive_t)) / NS
        around = 0.0 if abs(around) < 0.2 else around
        keep = samples.good & clear_of(s - around, recentred=cls.kind == "headset")
        require(keep.sum() > 20, *_none_good(samples.flags))

        def shown(t: Floats) -> Any:
            return rehearsal.pose(rehearsal.began + np.rint(t * NS).astype(np.int64))

        pose = samples.pose[keep]
        found = match(shown, s[keep], pose, around)
        if not found.good:
            require(
                False,
                f"what was shown comes back {found.distance_m * 1e3:.0f} mm and "
                f"{np.degrees(found.angle_rad):.0f} deg off: "
                + diagnosis(shown, s[keep], pose, around),
                "Convert at the plugin's border: vrbench.geometry.Axes(up, forward, handedness, "
                "unit_m).to_openxr(pose); quaternions are x y z w, poses T_world_eye.",
            )
        return s - found.offset_s, found

    @classmethod
    def timed(cls) -> Floats:
        """Times of the samples since the rehearsal began (n,) [s], as the movements tell."""
        return given(cls.matched, "the movement that came isn't the one that was shown")[0]

    def test_opening_without_a_device_fails_cleanly(self) -> None:
        """With no device there, opening ends soon, in one error that says what to do."""
        check_without_device(self.kind, self.name, self._options())

    def _options(self) -> dict[str, Any]:
        spec = self.live()
        try:
            return self.recorded().options
        except NotCheckedError:
            raise
        except Exception:  # what is wrong with it, another check tells
            return options_of(spec, self.stand_in, self.rate_hz)

    def test_poses_arrive(self) -> None:
        """Between start and stop poses arrive, one stream of them, arrays of one length."""
        samples = self.recorded().samples
        n = len(samples)
        shapes = {
            "source_t": samples.source_t.shape == (n,),
            "receive_t": samples.receive_t.shape == (n,),
            "pose.p": samples.pose.p.shape == (n, 3),
            "pose.q": samples.pose.q.shape == (n, 4),
            "flags": samples.flags.shape == (n,),
            "epoch": samples.epoch.shape == (n,),
        }
        wrong = [name for name, right in shapes.items() if not right]
        require(not wrong, f"of {n} samples {', '.join(wrong)} have another shape", "See Samples.")
        require(
            samples.pose_t.dtype == np.int64 and samples.receive_t.dtype == np.int64,
            f"stamps are {samples.pose_t.dtype}",
            "Times are int64 nanoseconds; float64 seconds since 1970 are 240 ns coarse.",
        )

    def test_reading_returns_at_once(self) -> None:
        """`read` returns at once with what has arrived: the recorder has other devices."""
        took = self.came().read_s
        require(
            took < READ_S,
            f"read() takes {took * 1e3:.0f} ms",
            "Wait in `start` or in a thread of your own; `read` takes what is there.",
        )

    def test_stamps_are_times(self) -> None:
        """Stamps are nanoseconds and go as time does; arrivals are on the recorder's clock."""
        check_times(self.came())

    def test_stamps_never_go_back(self) -> None:
        """Stamps and arrivals come in order, and no pose is told before it was made."""
        samples = self.came().samples
        for what, t in (("source", samples.source_t), ("receive", samples.receive_t)):
            back = np.flatnonzero(np.diff(t) < 0)
            require(
                not len(back),
                f"{what} times go back at {len(back)} of {len(t)} samples, first at {_first(back)}",
                "Stamp by a monotonic clock of the device, and pass samples on in their order.",
            )
        if self.came().followed:
            early = samples.receive_t + FUTURE_NS < samples.pose_t
            require(
                not early.any(),
                "poses arrive long before the time they are of",
                "With clock exchanges, pose_t is on the recorder's clock: map it by them.",
            )

    def test_quaternions_are_of_unit_length(self) -> None:
        """Every pose is finite, and every quaternion of unit length, lost ones too."""
        pose = self.came().samples.pose
        finite = np.isfinite(pose.p).all() and np.isfinite(pose.q).all()
        length = np.abs(np.linalg.norm(pose.q, axis=1) - 1.0)
        require(
            finite and length.max() < 1e-3,
            f"quaternions are off unit length by {length.max():.3g}" if finite else "NaN in poses",
            "Pass poses as the headset tells them through vrbench.streams.believed(p, q, flags).",
        )

    def test_known_twist(self) -> None:
        """Known movements come back as they were shown: handedness, axes, order and unit."""
        self.matched()

    def test_rate_is_as_declared(self) -> None:
        """Poses come as often as the device makes them, and none is left out."""
        recorded = self.came()
        given(lambda: check_times(recorded), "the stamps aren't times")
        declared = recorded.rehearsal.rate_hz
        measured = median_rate(recorded.samples)
        t = recorded.samples.source_t
        mean = (len(t) - 1) / max(float(t.max() - t.min()) / NS, 1e-9)
        require(
            abs(measured / declared - 1.0) < RATE_TOLERANCE,
            f"{measured:.1f} poses a second by their stamps, {declared:g} declared",
            "Say in the profile (or spec) what it does: rate_hz.",
        )
        require(
            mean > declared * (1.0 - RATE_TOLERANCE),
            f"{mean:.1f} poses a second arrive of {declared:g}: some are dropped",
            "Read all that waits at each `read`, receive in a thread of its own, and pass on what "
            "isn't tracked too, with its flags cleared.",
        )

    def test_loss_is_told(self) -> None:
        """While tracking is lost no pose counts as good; while it isn't, nearly all do."""
        s, samples = self.timed(), self.came().samples
        into = s % LOST_EVERY_S
        lost = (into > LOST_FROM_S + MARGIN_S) & (into < LOST_UNTIL_S - MARGIN_S)
        seen = (into < LOST_FROM_S - MARGIN_S) | (into > LOST_UNTIL_S + MARGIN_S)
        require(
            not samples.good[lost].any(),
            f"{int(samples.good[lost].sum())} poses count as good while tracking was lost",
            f"Clear the flags of poses that aren't tracked: flags == {GOOD} is a good one.",
        )
        share = float(samples.good[seen].mean()) if seen.any() else 0.0
        require(
            share > 0.95,
            f"only {share:.0%} of poses are good while it was tracked",
            f"A pose that is valid and tracked has all four flags: {GOOD}.",
        )

    def test_closing_twice(self) -> None:
        """Closing what is closed already does nothing."""
        error = self.came().closed_again
        require(
            error is None,
            f"closing a second time raises {type(error).__name__}: {error}",
            "Release in __exit__ what is held, and forget it: ExitStack.close does.",
        )


def clear_of(s: Floats, *, recentred: bool) -> Bools:
    """Times (n,) [s] that no recentre is near."""
    if not recentred:
        return np.ones(len(s), dtype=bool)
    into = s % RECENTRE_EVERY_S
    return np.asarray((into > MARGIN_S) & (into < RECENTRE_EVERY_S - MARGIN_S))


def _none_good(flags: npt.NDArray[np.uint32]) -> tuple[str, str]:
    """What to say of flags (n,) of which hardly any is good."""
    lacking = [flag.name or "" for flag in Flag if np.mean((flags & flag) != 0) < 0.5]
    names = ", ".join(name.lower().replace("_", " ") for name in lacking)
    return (
        f"of {len(flags)} poses that came {int(np.sum(flags == GOOD))} count as good: "
        f"most lack the flags {names}",
        f"A pose that is valid and tracked has all four flags, {GOOD}. `believed` clears those of "
        "what can't be true: positions that aren't finite, quaternions that aren't of unit length.",
    )


def _first(index: Any) -> str:
    return f"sample {int(index[0]) + 1}" if len(index) else ""


def _kept_error(make: Any) -> Any:
    """What is made, or why it can't be: so that it is tried once."""
    try:
        return make()
    except Exception as error:
        return error
