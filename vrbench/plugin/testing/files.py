"""Conformance of importers: what they read of a sample, and of what is no such file."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from vrbench.config.recordings import RecordedTake, Recordings, load_recordings
from vrbench.config.rig import SIMULATED
from vrbench.config.shipped import find_file
from vrbench.errors import EstimationError, VrbenchError
from vrbench.geometry import quat_rotate
from vrbench.plugin.manager import check_options, pick
from vrbench.plugin.testing.logs import mistake
from vrbench.plugin.testing.offered import WithOptions
from vrbench.plugin.testing.opening import median_rate
from vrbench.plugin.testing.sources import RATE_TOLERANCE
from vrbench.plugin.testing.verdicts import NonconformityError, NotCheckedError, given, require
from vrbench.protocols import vrbench_1
from vrbench.recording import datasets
from vrbench.recording.importer import Imported
from vrbench.streams import Columns, Samples

STREAMS = {"headset": "headset/eye", "robot": "robot/tcp", "mocap": "mocap/body"}
# What an axis that is up looks like from the reference: a robot's base has z up, mocap y.
UP = {"robot": (0.0, 0.0, 1.0), "mocap": (0.0, 1.0, 0.0)}
# A headset is off by a few mm; half a unit or a mirrored axis by much more.
MOST_M, MOST_RAD, MOST_TILT_RAD = 0.03, np.radians(3.0), np.radians(15.0)
FIX = (
    "Convert what is read: vrbench.geometry.Axes(up, forward, handedness, unit_m).to_openxr(pose) "
    "for a headset; stamps are in ns, quaternions x y z w."
)
JUNK = {
    "an empty file": b"",
    "binary junk": bytes(range(256)) * 8,
    "a text of no numbers": b"hello\nworld\n" * 5,
}


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """A file of the format, with what the recordings say of it.

    Attributes:
        stream: `headset`, `robot` or `mocap`.
        path: the file.
        options: of the format.
        imported: what the importer made of it.
        take: that it belongs to.
    """

    stream: str
    path: Path
    options: Any
    imported: Imported
    take: RecordedTake


class ImporterConformance(WithOptions):
    """What an importer is held to.

    Attributes:
        recordings: a recordings file, or the name of a shipped one, with takes of this format; one
            of a calibration tells most, for it proves the axes against the reference beside it.
    """

    kind = "importer"
    recordings: ClassVar[Path | str | None] = None

    @classmethod
    def samples(cls) -> list[Sample]:
        """All files of the format that the recordings list, read once."""
        if cls.recordings is None:
            raise NotCheckedError(
                f"no recordings with {cls.name} were given", "--recordings recordings.yaml"
            )
        samples: list[Sample] = cls.kept("samples", lambda: list(cls._samples()))
        require(
            samples,
            f"{cls.recordings} has no take of format {cls.name}",
            f"Name a recordings file with format: {cls.name}.",
        )
        return samples

    @classmethod
    def _samples(cls) -> Iterator[Sample]:
        path = find_file("recordings", str(cls.recordings))
        recordings = load_recordings(path)
        for take in recordings.takes:
            for stream, source in take.sources.items():
                if source.format == cls.name:
                    yield cls._read(stream, take, recordings, path)

    @classmethod
    def _read(cls, stream: str, take: RecordedTake, recordings: Recordings, path: Path) -> Sample:
        source = take.sources[stream]
        importer = pick(
            cls.plugins().importers, source.format, "format", field=stream, file=str(path)
        )
        options = check_options(source.options, importer.options, field=stream, file=str(path))
        if recordings.dataset is None:
            file = path.parent / source.path
        else:
            try:
                file = datasets.find_file(recordings.dataset, source.path.as_posix())
            except VrbenchError as error:
                raise NotCheckedError(error.what, error.fix or "vrbench data fetch") from None
        imported = importer.read(file, options)
        require(
            isinstance(imported, Imported) and isinstance(imported.samples, Samples),
            f"read() of {source.format} returns a {type(imported).__name__}",
            "Return vrbench.recording.importer.Imported, as imported_poses(...) makes it.",
        )
        return Sample(stream, file, options, imported, take)

    @classmethod
    def there(cls) -> list[Sample]:
        """The same, for checks of what was read: where nothing can be, another check tells."""
        return given(cls.samples, "the samples can't be read")

    def test_samples_are_read(self) -> None:
        """Every file of the format that the recordings list is read."""
        self.samples()

    def test_the_rate_is_the_models(self) -> None:
        """A headset's log has the rate that its model declares, where that is installed."""
        logs = [sample for sample in self.there() if sample.stream == "headset"]
        declared = self._declared()
        if declared is None:
            return
        for sample in logs:
            measured = median_rate(sample.imported.samples)
            require(
                abs(measured / declared - 1.0) < RATE_TOLERANCE,
                f"{sample.path.name} holds {measured:.4g} poses a second, {declared:g} declared",
                "Say in the model's profile what it does: rate_hz; or mend the stamps' unit.",
            )

    def _declared(self) -> float | None:
        recordings = load_recordings(find_file("recordings", str(self.recordings)))
        spec = self.plugins().things("headset").get(recordings.device.headset)
        profile = None if spec is None or spec.name == SIMULATED else spec.profile
        return None if profile is None else float(profile.rate_hz)

    def test_what_is_no_such_file_is_refused(self) -> None:
        """What isn't of the format is refused in one sentence, a file that isn't there too."""
        importer = self.thing()
        options = self._some_options(importer)
        with tempfile.TemporaryDirectory() as folder:
            there = {"a file that isn't there": Path(folder) / "none"}
            for what, content in JUNK.items():
                there[what] = Path(folder) / f"{what.replace(' ', '-')}.csv"
                there[what].write_bytes(content)
            for what, path in there.items():
                try:
                    importer.read(path, options)
                except (VrbenchError, FileNotFoundError):
                    continue
                except Exception as error:
                    raise NonconformityError(
                        f"{what} makes it raise {type(error).__name__}: {error}",
                        "Raise vrbench.errors.DataError(what, file=path) in its place.",
                    ) from None
                raise NonconformityError(
                    f"{what} is read as if it were one of its own",
                    "Raise vrbench.errors.DataError; imported_poses does where there are no poses.",
                )

    def _some_options(self, importer: Any) -> Any:
        try:
            return importer.options()
        except ValueError:
            return self.samples()[0].options

    def test_a_file_cut_short_is_told(self) -> None:
        """A log that was cut short is read as far as it goes, or refused; never as something else.

        What is left may lack digits, so the last pose is let be.
        """
        sample = self.there()[0]
        content = sample.path.read_bytes()
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / sample.path.name
            path.write_bytes(content[: len(content) * 2 // 3])
            try:
                cut = self.thing().read(path, sample.options).samples
            except VrbenchError:
                return
            except Exception as error:
                raise NonconformityError(
                    f"a file cut short makes it raise {type(error).__name__}: {error}",
                    "Raise vrbench.errors.DataError in its place.",
                ) from None
        whole = sample.imported.samples
        n = min(len(cut), len(whole)) - 1
        same = np.array_equal(cut.pose_t[:n], whole.pose_t[:n])
        require(
            len(cut) <= len(whole) and same and np.allclose(cut.pose.p[:n], whole.pose.p[:n]),
            "what is read of a file cut short isn't what stands in the whole",
            "Read it from its beginning, and stop where it is cut.",
        )

    def test_stamps_go_forward(self) -> None:
        """Stamps increase, in int64 nanoseconds."""
        for sample in self.there():
            t = sample.imported.samples.pose_t
            require(
                t.dtype == np.int64 and np.all(np.diff(t) > 0),
                f"{sample.path.name}: stamps of {t.dtype} that don't increase",
                "Pass what was read through vrbench.recording.checks.imported_poses.",
            )

    def test_quaternions_are_of_unit_length(self) -> None:
        """Every pose is finite and every quaternion of unit length."""
        for sample in self.there():
            pose = sample.imported.samples.pose
            off = np.abs(np.linalg.norm(pose.q, axis=1) - 1.0)
            require(
                np.isfinite(pose.p).all() and np.all(off < 1e-6),
                f"{sample.path.name}: quaternions are off unit length by {np.max(off):.3g}",
                "Pass what was read through vrbench.recording.checks.imported_poses.",
            )

    def test_known_twist(self) -> None:
        """Beside the reference that moved it, a calibration proves handedness, axes and unit."""
        calibrations = [x for x in self.there() if x.take.case.startswith("calib")]
        if not calibrations:
            raise NotCheckedError(
                "the recordings hold no calibration of this format", "add a case calibrate"
            )
        self._prove(calibrations[0])

    def _prove(self, sample: Sample) -> None:
        path = find_file("recordings", str(self.recordings))
        recordings = load_recordings(path)
        reference = (
            sample.stream
            if sample.stream in UP
            else next(name for name in UP if getattr(sample.take, name) is not None)
        )
        wanted = {name: name in sample.take.sources for name in ("headset", reference)}
        if not all(wanted.values()):
            raise NotCheckedError("the calibration has no headset", "record one beside it")
        poses = {
            STREAMS[name]: self._read(name, sample.take, recordings, path).imported.samples
            for name in wanted
        }
        tested = STREAMS[sample.stream]
        (beside,) = set(poses) - {tested}

        def fits(samples: Samples) -> bool:
            try:
                found = vrbench_1.calibrate(Columns(poses | {tested: samples}), reference, "")
            except EstimationError:
                return False
            return _near(found)

        try:
            found = vrbench_1.calibrate(Columns(poses), reference, sample.path.name)
        except EstimationError as error:
            why = mistake(poses[tested], poses[beside], fits) or str(error)
            raise NonconformityError(
                f"{sample.path.name} doesn't fit the {reference} beside it: {why}", FIX
            ) from None
        if not _near(found):
            unit = mistake(poses[tested], poses[beside], fits)
            raise NonconformityError(
                f"{sample.path.name} differs from the {reference} beside it by "
                f"{found.translation_residual_m * 1e3:.0f} mm, "
                f"{np.degrees(found.rotation_residual_rad):.1f} deg"
                + (f": {unit}" if unit else ""),
                FIX,
            )
        up = quat_rotate(found.y.q, np.array([0.0, 1.0, 0.0]))
        tilt = float(np.arccos(np.clip(np.dot(up, UP[reference]), -1.0, 1.0)))
        require(
            tilt < MOST_TILT_RAD,
            f"the headset's y axis is {np.degrees(tilt):.0f} deg off the {reference}'s up",
            f"A headset's y is up; a robot's base has z up, motion capture y. {FIX}",
        )


def _near(found: Any) -> bool:
    """Whether a calibration leaves over as little as a headset errs."""
    return bool(found.translation_residual_m < MOST_M and found.rotation_residual_rad < MOST_RAD)
