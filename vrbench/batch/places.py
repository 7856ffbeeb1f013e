"""Where runs are: in a folder, or behind a URL from which they are fetched and to which results go.

fsspec opens URLs (`s3://`, `gs://`, `sftp://`, ...), each scheme with the library that it names.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from vrbench.errors import ConfigError, DataError, VrbenchError
from vrbench.results.bundle import Bundle
from vrbench.results.calibrations import CALIBRATIONS
from vrbench.results.files import inside
from vrbench.results.record import RECORD, RunRecord

if TYPE_CHECKING:
    from fsspec import AbstractFileSystem

READ_ONLY = ("http://", "https://", "data:", "github://")


def is_url(run: str) -> bool:
    """Whether a run is named by a URL."""
    return "://" in run


@contextmanager
def at_hand(run: str) -> Iterator[Path]:
    """A run's folder: its own, or for a URL a copy, whose new results are put back at the end.

    `run.json` goes last: until it is there, tables that are newer than it are told by their digest.

    Raises:
        ConfigError: no such scheme, or its library isn't installed.
        DataError: the run can't be had, was changed in the meantime, or takes no results.
    """
    if not is_url(run):
        yield Path(run)
        return
    files, root = _opened(run)
    if "file" in _schemes(files):
        yield Path(root)
        return
    with TemporaryDirectory(prefix="vrbench-run-") as name:
        folder = Path(name)
        with _told(run):
            before = _fetch(files, root, folder)
        yield folder
        with _told(run):
            if files.cat_file(f"{root}/{RECORD}") != before:
                raise DataError("the run was changed in the meantime", file=run, fix="try again")
            _put_back(files, root, folder, before)


def _opened(run: str) -> tuple[AbstractFileSystem, str]:
    if run.startswith(READ_ONLY):
        raise ConfigError("results can't be put there", file=run, fix="download the run")
    try:
        from fsspec.core import url_to_fs
    except ImportError:
        fix = "pip install 'vrbench[cluster]'"
        raise ConfigError("URLs need fsspec, which is not installed", file=run, fix=fix) from None
    try:
        files, root = url_to_fs(run)
    except ImportError as error:
        raise ConfigError("its library is not installed", file=run, fix=str(error)) from None
    except ValueError as error:
        raise ConfigError("no such kind of URL", file=run, fix=str(error)) from None
    return files, root.rstrip("/")


def _schemes(files: AbstractFileSystem) -> tuple[str, ...]:
    return (files.protocol,) if isinstance(files.protocol, str) else tuple(files.protocol)


@contextmanager
def _told(run: str) -> Iterator[None]:
    """Whatever a library of a scheme raises, as an error that names the run."""
    try:
        yield
    except VrbenchError:
        raise
    except FileNotFoundError as error:
        raise DataError("is not a run, or not whole", file=run, fix=f"{error}") from None
    except Exception as error:
        raise DataError(f"{type(error).__name__}: {error}", file=run) from None


def _fetch(files: Any, root: str, folder: Path) -> bytes:
    """What evaluation needs of a run; returns the record as it was."""
    before: bytes = files.cat_file(f"{root}/{RECORD}")
    (folder / RECORD).write_bytes(before)
    (folder / "takes").mkdir()
    for take in Bundle.begun(folder).record.takes:
        if take.status == "ok":
            files.get_file(f"{root}/{take.file}", str(inside(folder, take.file)))
    if files.exists(f"{root}/{CALIBRATIONS}"):
        files.get_file(f"{root}/{CALIBRATIONS}", str(folder / CALIBRATIONS))
    return before


def _put_back(files: Any, root: str, folder: Path, before: bytes) -> None:
    known = RunRecord.model_validate_json(before).files
    files.makedirs(f"{root}/metrics", exist_ok=True)
    for name, digest in Bundle.begun(folder).record.files.items():
        if known.get(name) != digest:
            files.put_file(str(inside(folder, name)), f"{root}/{name}")
    files.put_file(str(folder / RECORD), f"{root}/{RECORD}")
