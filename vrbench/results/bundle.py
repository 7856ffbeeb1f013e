"""The bundle: a folder that holds one execution of a suite, whole or marked incomplete."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from vrbench.config.yaml_file import validate
from vrbench.errors import ConfigError, DataError
from vrbench.recording.take import read_take
from vrbench.results.files import file_digest, file_size, inside, replace_text
from vrbench.results.record import RECORD, SCHEMA_VERSION, RunRecord, TakeRecord, utc_now
from vrbench.streams import Columns

# More than any run has; what others hand in isn't read beyond it.
MAX_RECORD_BYTES = 16 << 20
MAX_TABLE_BYTES = 256 << 20
# While somebody records: see `vrbench.results.lock`.
LOCK = "run.lock"


class Bundle:
    """A run's folder.

    Attributes:
        folder: where it is.
        record: what `run.json` says.
    """

    def __init__(self, folder: Path, record: RunRecord) -> None:
        self.folder, self.record = folder, record

    @classmethod
    def create(cls, folder: Path, record: RunRecord, inputs: Mapping[str, str]) -> Bundle:
        """A new folder, marked incomplete, with the texts `inputs` by file name.

        Raises:
            ConfigError: something is in the folder.
        """
        require_new(folder)
        folder.mkdir(parents=True, exist_ok=True)
        bundle = cls(folder, record)
        bundle._save()
        (folder / "takes").mkdir(exist_ok=True)
        for name, text in inputs.items():
            (folder / name).write_text(text, encoding="utf-8")
            bundle.enter(name)
        return bundle

    def enter(self, *names: str) -> None:
        """Notes the sha256 of files of the bundle, so that a change of them is seen."""
        for name in names:
            self.record.files[name] = file_digest(self.folder / name)
        self._save()

    def content(self, name: str) -> bytes:
        """A file that was entered, whole.

        Raises:
            DataError: no such file, it lies outside the bundle or is beyond `MAX_TABLE_BYTES`, it
                was never entered, or it isn't the one that was.
        """
        path = inside(self.folder, name)
        try:
            size = file_size(path)
            if size > MAX_TABLE_BYTES:
                raise DataError(
                    f"{size} bytes", file=path, fix=f"a table has {MAX_TABLE_BYTES} at most"
                )
            content = path.read_bytes()
        except OSError as error:
            fix = "vrbench evaluate RUN" if isinstance(error, FileNotFoundError) else str(error)
            raise DataError("is not there", file=path, fix=fix) from None
        known = self.record.files.get(name)
        if hashlib.sha256(content).hexdigest() != known:
            what = "was changed since it was written" if known else f"is not in {RECORD}"
            raise DataError(what, file=path, field="sha256", fix="vrbench evaluate RUN")
        return content

    @classmethod
    def open(cls, folder: Path) -> Bundle:
        """A complete run.

        Raises:
            ConfigError: no run there, an incomplete one, or one of another schema.
        """
        bundle = cls.begun(folder)
        status, why = bundle.record.status, bundle.record.reason
        if status != "complete":
            raise ConfigError(
                f"the run is {status}: {why or 'it was interrupted'}",
                file=folder,
                fix="go on with it by --resume, or import it again",
            )
        return bundle

    @classmethod
    def begun(cls, folder: Path) -> Bundle:
        """A run, complete or not.

        Raises:
            ConfigError: no run there, or one of another schema.
        """
        path = inside(folder, RECORD)
        try:
            size = file_size(path)
            if size > MAX_RECORD_BYTES:
                raise ConfigError(f"{size} bytes", file=path, fix=f"{MAX_RECORD_BYTES} at most")
            content = json.loads(path.read_text(encoding="utf-8"))
        except (FileNotFoundError, NotADirectoryError, IsADirectoryError):
            raise ConfigError("is not a run", file=folder, fix=f"a folder with {RECORD}") from None
        except (ValueError, RecursionError) as error:
            raise ConfigError("is not JSON", file=path, fix=str(error)) from None
        if isinstance(content, dict) and content.get("schema_version") != SCHEMA_VERSION:
            raise ConfigError(
                f"schema version {content.get('schema_version')}",
                file=path,
                field="schema_version",
                fix=f"this vrbench reads version {SCHEMA_VERSION}",
            )
        return cls(folder, validate(content, RunRecord, path))

    def take_path(self, name: str) -> Path:
        """Where the take of this name belongs."""
        return self.folder / "takes" / f"{name}.mcap"

    def add(self, take: TakeRecord) -> None:
        """Enters a take that has been written; it replaces an earlier one of its name."""
        self.record.takes = [t for t in self.record.takes if t.name != take.name] + [take]
        self._save()

    def columns(self, take: TakeRecord) -> Columns:
        """A take's columns; raises what `sound` and `read_take` do."""
        return read_take(self.sound(take))

    def sound(self, take: TakeRecord) -> Path:
        """Where a take is, after it was checked.

        Raises:
            DataError: the file is gone, or isn't the one that was recorded.
        """
        path = inside(self.folder, take.file)
        if not path.is_file():
            raise DataError("the take is gone", file=path)
        if file_digest(path) != take.sha256:
            raise DataError(
                "the take was changed after it was recorded",
                file=path,
                field="sha256",
                fix=f"{RECORD} says {take.sha256[:12]}...",
            )
        return path

    def write_truth(self, take: str, truth: Mapping[str, Any]) -> None:
        """Keeps what a simulator knows beside the takes; there is no way to read it back here."""
        folder = self.folder / "truth"
        folder.mkdir(exist_ok=True)
        (folder / f"{take}.json").write_text(json.dumps(truth, indent=1), encoding="utf-8")

    def finish(self) -> None:
        """Marks the run complete."""
        self.end("complete")

    def end(self, status: Literal["incomplete", "failed", "complete"], reason: str = "") -> None:
        """Marks how the run ended."""
        self.record.status, self.record.reason = status, reason
        self._save()

    def _save(self) -> None:
        path = self.folder / RECORD
        text = self.record.model_dump_json(indent=1)
        replace_text(path, text)


def require_new(folder: Path) -> None:
    """Refuses a folder that a new run can't have.

    Raises:
        ConfigError: something is there; an empty folder, or one of a run that died before it began,
            is as good as none.
    """
    if folder.exists() and not (
        folder.is_dir() and {path.name for path in folder.iterdir()} <= {LOCK, f"{RECORD}.part"}
    ):
        raise ConfigError(
            "is there already",
            file=folder,
            field="-o",
            fix="name a folder that is not; --resume goes on with a run that was interrupted",
        )


def default_folder(suite: str, device: str) -> Path:
    """`runs/<utc>-<suite>-<device>`; with -2, -3, ... where that is taken."""
    base = f"{utc_now():%Y%m%dT%H%M%SZ}-{suite}-{device}"
    folder, n = Path("runs") / base, 1
    while folder.exists():
        n += 1
        folder = Path("runs") / f"{base}-{n}"
    return folder
