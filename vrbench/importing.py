"""Imports: recordings that exist already -> takes in a bundle."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from vrbench.config.recordings import RecordedTake, Recordings, Source, load_recordings
from vrbench.config.shipped import find_file
from vrbench.config.suite import DEFAULT, Case, Suite, load_suite, take_name
from vrbench.config.yaml_file import as_yaml, located
from vrbench.errors import ConfigError, DataError, VrbenchError
from vrbench.motion.files import given
from vrbench.motion.generators import GENERATORS, generate
from vrbench.motion.motion import digest_of_name
from vrbench.plugin.manager import Plugins, check_options, families_of, pick
from vrbench.protocols.synchrony import other_epochs
from vrbench.recording import datasets
from vrbench.recording.importer import Imported
from vrbench.recording.take import TakeWriter
from vrbench.results.bundle import Bundle, default_folder
from vrbench.results.files import file_digest
from vrbench.results.record import (
    AccuracyRecord,
    DeviceRecord,
    RunRecord,
    TakeRecord,
    utc_now,
    versions,
)
from vrbench.streams import Columns, Event, Samples

# What each stream is called in a take; a second robot's `robot_paper` is `robot_paper/tcp`.
TAKE_STREAMS = {"headset": "headset/eye", "mocap": "mocap/body"}
# The motion of a calibration that doesn't say which it is.
UNSTATED = "unstated"
# Told of each take as it begins: its name, its place in the list, how many there are.
Tell = Callable[[str, int, int], None]


def import_recordings(name: str, folder: Path | None, plugins: Plugins, tell: Tell) -> Bundle:
    """A bundle of the takes that a recordings file lists.

    Args:
        name: path of the file, or the name of a shipped one.
        folder: the new bundle's folder; one below `runs` where None.
        plugins: for their importers and suites.
        tell: told of each take as it begins.

    Raises:
        ConfigError: the recordings file, the suite, a format or an option is wrong, or the
            folder exists.
        DataError: a file is missing or isn't what it should be. No folder is left behind.
    """
    path = find_file("recordings", name)
    recordings = load_recordings(path)
    suite = load_suite(recordings.suite, dict(plugins.suites), beside=path.parent)
    families_of(suite, plugins, str(path))
    cases = [
        _case_of(take, suite, path, f"takes.{index}") for index, take in enumerate(recordings.takes)
    ]
    folder = folder or default_folder(suite.suite, recordings.device.headset)
    _check_permission(recordings, suite, path)
    record = RunRecord(
        kind="imported",
        created=utc_now().isoformat(),
        suite=suite.canonical(),
        suite_digest=suite.digest,
        lab=recordings.lab,
        sitting=recordings.sitting,
        device=DeviceRecord(**recordings.device.model_dump()),
        references=_references(recordings, suite, path),
        licence=recordings.licence,
        consent=recordings.consent,
        accuracy={
            name: AccuracyRecord(metres=stated.value, source=stated.source)
            for name, stated in recordings.accuracy.items()
        },
        versions=versions(plugins.versions()),
    )
    inputs = {
        "suite.yaml": as_yaml(suite.canonical()),
        "recordings.yaml": path.read_text(encoding="utf-8"),
    }
    bundle = Bundle.create(folder, record, inputs)
    try:
        for index, (take, case) in enumerate(zip(recordings.takes, cases, strict=True)):
            where = f"takes.{index}"
            tell(_name_of(take), index, len(cases))
            _import_take(bundle, take, case, recordings, path, plugins, where)
        bundle.finish()
    except BaseException:
        # The sources are still there: half an import is worth nothing.
        shutil.rmtree(folder)
        raise
    return bundle


def _check_permission(recordings: Recordings, suite: Suite, path: Path) -> None:
    """A person's motion is nobody else's to publish."""
    for name in ("licence", "consent"):
        if suite.mover == "person" and not given(getattr(recordings, name)):
            raise ConfigError(
                f"suite {suite.label} records a person's motion: it needs {name}",
                file=path,
                field=name,
                fix="say what was agreed with the person",
            )


def _case_of(take: RecordedTake, suite: Suite, path: Path, where: str) -> Case:
    field = f"{where}.case"
    try:
        case = suite.case(take.case)
    except ConfigError as error:
        place = located(path, field)
        raise ConfigError(error.what, file=place, field=field, fix=error.fix) from None
    if take.headset is None and suite.mover != "person":
        raise ConfigError("a take has no headset", file=path, field="takes.headset")
    if case.role == "scored" and take.motion is None:
        raise ConfigError(
            f"a take of case {case.id} doesn't say which motion it is",
            file=path,
            field="takes.motion",
            fix="name it, the same name for the same motion: results are compared by it",
        )
    return case


def _references(recordings: Recordings, suite: Suite, path: Path) -> list[str]:
    """The suite's references that every take has."""
    there: list[str] = [
        name
        for name in suite.references
        if all(getattr(take, name) is not None for take in recordings.takes)
    ]
    if not there:
        wanted = " or ".join(suite.references)
        raise ConfigError(
            f"suite {suite.label} needs {wanted} in every take", file=path, field="takes"
        )
    return there


def _name_of(take: RecordedTake) -> str:
    return take_name(take.case, DEFAULT, take.mount, take.repeat)


def _import_take(
    bundle: Bundle,
    take: RecordedTake,
    case: Case,
    recordings: Recordings,
    path: Path,
    plugins: Plugins,
    where: str,
) -> None:
    poses: dict[str, Samples] = {}
    repairs: list[str] = []
    bodies: list[dict[str, object]] = []
    for name, source in take.sources.items():
        imported = _read(source, recordings, path, plugins, f"{where}.{name}")
        stream = TAKE_STREAMS.get(name, f"{name}/tcp")
        poses[stream] = imported.samples
        if imported.markers is not None:
            markers = (imported.markers * 1e3).round(3).tolist()
            bodies.append({"stream": stream, "markers_mm": markers})
        repairs += [f"{name}: {repair}" for repair in imported.repairs]
    repairs += _told_epochs(poses)
    motion = take.motion or UNSTATED
    record = TakeRecord(
        file=f"takes/{_name_of(take)}.mcap",
        sha256="",
        case=case.id,
        mount=take.mount,
        repeat=take.repeat,
        role=case.role,
        motion=motion,
        motion_digest=generate(motion).digest if motion in GENERATORS else digest_of_name(motion),
        speed=take.speed,
        repairs=repairs,
    )
    metadata = {**record.facts(bundle.record.device), "headset": recordings.device.headset}
    if take.world is not None:
        metadata["world"] = take.world
    # a person's capture may have no headset
    headset = TAKE_STREAMS["headset"]
    begin = int(poses[headset if headset in poses else next(iter(poses))].receive_t[0])
    events = [Event(begin, "repair", {"what": repair}) for repair in repairs]
    events += [Event(begin, "body", body) for body in bodies]
    take_path = bundle.take_path(_name_of(take))
    with TakeWriter(take_path, metadata) as writer:
        writer.write(Columns(poses, events=events))
    record.sha256 = file_digest(take_path)
    bundle.add(record)


def _told_epochs(poses: Mapping[str, Samples]) -> Iterator[str]:
    """Sentences on references whose stamps are of another epoch than the headset's."""
    headset = poses.get(TAKE_STREAMS["headset"])
    for stream, samples in poses.items():
        apart_s = None if headset is None else other_epochs(headset, samples)
        if apart_s is not None:
            yield (
                f"headset: its stamps begin {apart_s:.6g} s from those of {stream}: of another "
                "epoch, so their clocks are searched about where both begin"
            )


def _read(
    source: Source, recordings: Recordings, path: Path, plugins: Plugins, where: str
) -> Imported:
    importer = pick(
        plugins.importers, source.format, "format", field=f"{where}.format", file=str(path)
    )
    options = check_options(source.options, importer.options, field=where, file=str(path))
    if recordings.dataset is not None:
        file = datasets.find_file(recordings.dataset, source.path.as_posix())
    else:
        file = path.parent / source.path
    if not file.exists():
        field = f"{where}.path"
        raise DataError("no such file", file=file, field=f"{located(path, field)}: {field}")
    try:
        imported: object = importer.read(file, options)
    except (VrbenchError, OSError):
        raise
    except Exception as error:  # an importer of a plugin may raise anything
        raise DataError(
            f"importer {importer.name} failed: {type(error).__name__}: {error}", file=file
        ) from error
    if not isinstance(imported, Imported) or not isinstance(imported.samples, Samples):
        raise DataError(f"importer {importer.name} returned no poses", file=file)
    return imported
