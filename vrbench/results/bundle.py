"""The bundle: a folder that holds one execution of a suite, whole or marked incomplete."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from stat import S_ISDIR, S_ISREG
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, StringConstraints, model_validator

from vrbench.config.suite import Suite
from vrbench.config.yaml_file import validate
from vrbench.errors import ConfigError, DataError
from vrbench.motion.files import given
from vrbench.recording.take import read_take
from vrbench.streams import Columns

SCHEMA_VERSION = 1
RECORD = "run.json"
# More than any run has; what others hand in isn't read beyond it.
MAX_RECORD_BYTES = 16 << 20
MAX_TABLE_BYTES = 256 << 20
# While somebody records: see `vrbench.results.lock`.
LOCK = "run.lock"


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid")


class DeviceRecord(_Record):
    """The headset that was measured, and how its poses were had."""

    UNKNOWN: ClassVar[str] = "unknown"

    headset: str
    firmware: str = UNKNOWN
    logger: str = UNKNOWN
    logger_version: str = UNKNOWN
    prediction: str = UNKNOWN


class AccuracyRecord(_Record):
    """How accurate a reference is over the motion's box, and who says so."""

    metres: float
    source: str


class OcclusionRecord(_Record):
    """The headset's cameras, name by id, and those that each level of the suite covers."""

    cameras: dict[int, str]
    levels: dict[str, list[int]]


class TakeRecord(_Record):
    """One take of the run."""

    file: Annotated[str, StringConstraints(pattern=r"^takes/[^/\\]+$")]
    sha256: str
    case: str
    condition: str = "default"
    mount: int
    repeat: int
    role: Literal["calibration", "check", "scored"]
    motion: str
    motion_digest: str
    speed: float = 1.0
    stretch: float = 1.0
    fraction: float = 1.0
    repairs: list[str] = []
    status: Literal["ok", "failed", "skipped"] = "ok"
    reason: str = ""
    # Of a calibration that an earlier run recorded: `run/take`.
    origin: str = ""

    @property
    def name(self) -> str:
        """What the take is called; that of one which failed stands in a `.mcap.part`."""
        return Path(self.file).name.partition(".mcap")[0]


class RunRecord(_Record):
    """`run.json`: what was run, with what, and what came of it."""

    schema_version: Literal[1] = 1
    # incomplete: interrupted or crashed; failed: a device ended it. Both can be gone on with.
    status: Literal["incomplete", "failed", "complete"] = "incomplete"
    reason: str = ""
    kind: Literal["recorded", "simulated", "imported"]
    created: str
    suite: dict[str, Any]
    suite_digest: str
    lab: str
    sitting: str
    device: DeviceRecord
    references: list[str]
    accuracy: dict[str, AccuracyRecord] = {}
    occlusion: OcclusionRecord | None = None
    seed: int | None = None
    # One hash over the plans that a real robot carries out, and when the run was gone on with.
    plans: str | None = None
    resumed: list[str] = []
    licence: str | None = None
    consent: str | None = None
    versions: dict[str, str]
    files: dict[str, str] = {}
    takes: list[TakeRecord] = []

    @model_validator(mode="after")
    def _permitted(self) -> RunRecord:
        """A run that carries a person's motion says under which licence, and by what consent."""
        if self.suite.get("mover") == "person" and self.kind != "simulated":
            for name in ("licence", "consent"):
                if not given(getattr(self, name)):
                    raise ValueError(f"a run with a person's motion needs {name}")
        return self

    def resolved_suite(self) -> Suite:
        """The suite as it was when the run was made."""
        return validate(self.suite, Suite, RECORD)


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
            ConfigError: something is in the folder, or it can't be made.
        """
        require_new(folder)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError("can't be made", file=folder, field="-o", fix=str(error)) from None
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
            size = _file_size(path)
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
            size = _file_size(path)
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


def inside(folder: Path, name: str) -> Path:
    """The path of a file of a bundle.

    Raises:
        DataError: the name, or a link on the way, leads out of the bundle.
    """
    path = folder / name
    if not path.resolve().is_relative_to(folder.resolve()):
        raise DataError(
            "leads out of the bundle", file=path, fix="a bundle holds its own files, no links"
        )
    return path


def _file_size(path: Path) -> int:
    """How many bytes a file has.

    Raises:
        DataError: a pipe or a device stands there, which could be read for ever.
    """
    found = path.stat()
    if not (S_ISREG(found.st_mode) or S_ISDIR(found.st_mode)):
        raise DataError("is no file", file=path, fix="a bundle holds files and folders only")
    return found.st_size


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


def replace_text(path: Path, text: str) -> None:
    """Writes a file so that it is, at any moment, the old one or the new one."""
    part = path.with_name(path.name + ".part")
    try:
        part.write_text(text, encoding="utf-8")
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def file_digest(path: Path) -> str:
    """sha256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def utc_now() -> datetime:
    """The time, to the second."""
    return datetime.now(UTC).replace(microsecond=0)


def default_folder(suite: str, device: str) -> Path:
    """`runs/<utc>-<suite>-<device>`; with -2, -3, ... where that is taken."""
    base = f"{utc_now():%Y%m%dT%H%M%SZ}-{suite}-{device}"
    folder, n = Path("runs") / base, 1
    while folder.exists():
        n += 1
        folder = Path("runs") / f"{base}-{n}"
    return folder


def versions(plugins: Mapping[str, str]) -> dict[str, str]:
    """Versions of Python and of what takes part in a result, by name."""
    from importlib.metadata import version

    import numpy
    import scipy

    return {
        "python": platform.python_version(),
        "numpy": numpy.__version__,
        "scipy": scipy.__version__,
        "mcap": version("mcap"),
        **plugins,
    }
