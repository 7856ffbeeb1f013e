"""Whether a run is what it says: its files by digest, its numbers by evaluating it again."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from vrbench import __version__
from vrbench.errors import ConfigError, DataError, VrbenchError
from vrbench.evaluation import evaluate
from vrbench.plugin.manager import Plugins, families_of
from vrbench.protocols.registry import builtin_protocols
from vrbench.results.bundle import Bundle
from vrbench.results.differences import compared, differences
from vrbench.results.files import file_digest, inside
from vrbench.results.record import RECORD, RunRecord

# What a run that is handed in may have at most.
MAX_FILES = 10_000
MAX_FILE_BYTES = 2 << 30
MAX_RUN_BYTES = 8 << 30
# Of each file, so many differences are told one by one.
TOLD = 5
# Told of what is being done: a run, and what.
Tell = Callable[[str, str], None]


@dataclass(frozen=True, slots=True)
class Finding:
    """Something about a run that isn't as it should be: in which file, and what."""

    run: str
    file: str
    what: str

    def __str__(self) -> str:
        return ": ".join(part for part in (self.run, self.file, self.what) if part)


def verify_run(folder: Path, plugins: Plugins, tell: Tell) -> list[Finding]:
    """All that is wrong with a run; nothing where it is sound.

    Takes are opened only where every digest is right and no cap is passed.

    Args:
        folder: the run's.
        plugins: for their metrics.
        tell: told of what is done.

    Raises:
        ConfigError: no such folder.
    """
    run = str(folder)
    if not folder.is_dir():
        raise ConfigError("is not a run", file=folder, fix=f"a folder with {RECORD}")
    tell(run, "files")
    try:
        found = list(_unsafe(folder))
        if found:
            return found
        bundle = Bundle.open(folder)
        found = [*_suite(bundle), *_digests(bundle), *_missing(bundle)]
        if found:
            return found
        return list(_numbers(bundle, plugins, tell))
    except VrbenchError as error:
        told = error.what if error.file is None else str(error).removeprefix(f"{error.file}: ")
        fix = f" ({error.fix})" if error.file is None and error.fix else ""
        return [Finding(run, _relative(folder, error.file), told + fix)]
    except OSError as error:
        return [Finding(run, _relative(folder, error.filename), error.strerror or str(error))]


def verify_folder(root: Path, plugins: Plugins, tell: Tell) -> tuple[list[Path], list[Finding]]:
    """The runs of a folder that labs share, `LAB/SUITE/RUN`, and all that is wrong with them.

    Raises:
        DataError: no such folder, or no run in it.
    """
    runs = sorted(path.parent for path in root.glob(f"*/*/*/{RECORD}"))
    stray = sorted(set(root.rglob(RECORD)) - {run / RECORD for run in runs})
    bare = sorted({path.parent for path in root.glob("*/*/*/takes")} - set(runs))
    if not runs and not stray and not bare:
        raise DataError(
            "there is no run in it", file=root, fix=f"runs are at LAB/SUITE/RUN/{RECORD}"
        )
    found = [
        Finding(str(path.parent), "", "is not where runs belong: LAB/SUITE/RUN") for path in stray
    ]
    found += [Finding(str(path), RECORD, "is missing") for path in bare]
    takes: dict[str, Path] = {}
    for run in runs:
        own = verify_run(run, plugins, tell)
        found += own or _place(run, takes)
    return runs, found


def _place(run: Path, takes: dict[str, Path]) -> Iterator[Finding]:
    """Whether a sound run lies where its lab and suite say, and isn't there twice."""
    record = Bundle.open(run).record
    for what, folder, stated in (
        ("lab", run.parent.parent.name, record.lab),
        ("suite", run.parent.name, record.resolved_suite().label),
    ):
        if folder != stated:
            yield Finding(str(run), RECORD, f"{what} {stated!r} lies in the folder {folder!r}")
    for take in record.takes:
        other = takes.setdefault(take.sha256, run) if take.sha256 else run
        if other != run:
            yield Finding(str(run), take.file, f"is a take of {other} too")
            return


def _unsafe(folder: Path) -> Iterator[Finding]:
    """What a run must not hold: links that lead out, no files, too many, too large ones."""
    count = total = 0
    for place, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = Path(place) / name
            told = str(path.relative_to(folder))
            try:
                inside(folder, told)
            except DataError as error:
                yield Finding(str(folder), told, f"{error.what} ({error.fix})")
                continue
            if name in folders:
                continue
            if not path.is_file():
                yield Finding(str(folder), told, "is no file")
                continue
            size = path.stat().st_size
            count, total = count + 1, total + size
            if size > MAX_FILE_BYTES:
                yield Finding(str(folder), told, f"{size} bytes, of {MAX_FILE_BYTES} at most")
            if count > MAX_FILES:
                yield Finding(str(folder), "", f"holds more than {MAX_FILES} files")
                return
    if total > MAX_RUN_BYTES:
        yield Finding(str(folder), "", f"{total} bytes, of {MAX_RUN_BYTES} at most")


def _suite(bundle: Bundle) -> Iterator[Finding]:
    digest, stated = bundle.record.resolved_suite().digest, bundle.record.suite_digest
    if digest != stated:
        yield Finding(
            str(bundle.folder), RECORD, f"suite_digest is {stated[:12]}..., not {digest[:12]}..."
        )


def _digests(bundle: Bundle) -> Iterator[Finding]:
    """Files that are gone or changed, and names that lead out of the bundle."""
    run = str(bundle.folder)
    takes = {t.file: t.sha256 for t in bundle.record.takes if t.status == "ok" or t.sha256}
    for name, stated in (*bundle.record.files.items(), *takes.items()):
        try:
            path = inside(bundle.folder, name)
        except DataError as error:
            yield Finding(run, name, error.what)
            continue
        if not path.is_file():
            yield Finding(run, name, "is missing")
        elif file_digest(path) != stated:
            yield Finding(run, name, f"isn't the file that {RECORD} lists: its sha256 differs")


def _missing(bundle: Bundle) -> Iterator[Finding]:
    """What a run without which there is nothing to compare."""
    run = str(bundle.folder)
    if not bundle.record.takes:
        yield Finding(run, RECORD, "lists no takes")
    listed = {Path(take.file).name for take in bundle.record.takes}
    for path in sorted((bundle.folder / "takes").glob("*.mcap")):
        if path.name not in listed:
            yield Finding(run, f"takes/{path.name}", f"is a take that {RECORD} doesn't list")
    for path in sorted((bundle.folder / "metrics").glob("*")):
        if f"metrics/{path.name}" not in bundle.record.files:
            yield Finding(run, f"metrics/{path.name}", f"is not in {RECORD}")
    if not list(_protocols(bundle.record)):
        yield Finding(run, "metrics", "holds no numbers yet (vrbench evaluate RUN)")


def _protocols(record: RunRecord) -> Iterator[str]:
    for name in record.files:
        if name.startswith("metrics/") and name.endswith(".csv"):
            protocol = name.removeprefix("metrics/").removesuffix(".csv")
            if not protocol.endswith(".phase"):
                yield protocol


def _numbers(bundle: Bundle, plugins: Plugins, tell: Tell) -> Iterator[Finding]:
    """Where the tables differ from what the takes give here."""
    run = str(bundle.folder)
    known = {protocol.name: protocol for protocol in builtin_protocols()}
    suite = bundle.record.resolved_suite()
    with TemporaryDirectory(prefix="vrbench-verify-") as folder:
        copy = _copied(bundle, Path(folder))
        for name in _protocols(bundle.record):
            tell(run, name)
            if name not in known:
                there = ", ".join(known)
                yield Finding(run, f"metrics/{name}.csv", f"no such protocol here: {there}")
                continue
            protocol = known[name]
            families = protocol.families or families_of(suite, plugins, run)
            try:
                evaluate(copy, families, protocol, lambda *_: None)
            except VrbenchError as error:
                if error.file is not None:
                    error.file = str(bundle.folder / _relative(copy.folder, error.file))
                raise
            yield from _differing(bundle, copy, name)


def _differing(bundle: Bundle, copy: Bundle, protocol: str) -> Iterator[Finding]:
    """Where the files of a protocol differ from those that were evaluated again."""
    run = str(bundle.folder)
    for file, read in compared(protocol):
        if file not in bundle.record.files:
            if (copy.folder / file).is_file():
                yield Finding(run, file, "is missing: evaluation makes it")
            continue
        told = list(differences(read(bundle.folder / file), read(copy.folder / file)))
        for what in told[:TOLD]:
            yield Finding(run, file, what)
        if len(told) > TOLD:
            yield Finding(run, file, f"{len(told) - TOLD} more numbers differ")
        version = bundle.record.versions.get("vrbench")
        if told and version != __version__:
            yield Finding(run, file, f"it is of vrbench {version}, here is {__version__}")


def _copied(bundle: Bundle, folder: Path) -> Bundle:
    """The run's record and takes in another folder, to be evaluated there."""
    (folder / "takes").mkdir()
    for take in bundle.record.takes:
        if (bundle.folder / take.file).is_file():
            shutil.copyfile(bundle.folder / take.file, folder / take.file)
    return Bundle(folder, bundle.record.model_copy(deep=True, update={"files": {}}))


def _relative(folder: Path, file: str | None) -> str:
    if file is None:
        return ""
    path = Path(file)
    return str(path.relative_to(folder)) if path.is_relative_to(folder) else file


def summary(runs: Sequence[Path], found: Sequence[Finding]) -> str:
    """How many runs are sound."""
    bad = {finding.run for finding in found}
    return f"{len([run for run in runs if str(run) not in bad])} of {len(runs)} runs are sound"
