"""Fetches published recordings: each file by its digest, and on from where a download broke off."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from vrbench.errors import DataError
from vrbench.recording.datasets import VARIABLE, Dataset, State, folder_of, known, status

TRIES, TIMEOUT_S = 3, 20.0
# What a broken connection loses of what came [bytes].
CHUNK = 1 << 13
# Told of each file: its path, and what is done with it.
Tell = Callable[[str, str], None]


def fetch(name: str, tell: Tell) -> Path:
    """All files of a dataset, those that are there and whole left alone.

    They go below the folder that VRBENCH_DATA names, or to the user's cache.

    Returns:
        the dataset's folder.

    Raises:
        ConfigError: no dataset has the name.
        DataError: the server isn't reached, sends something else than was published, or the folder
            can't be written to. What came of a file is kept, and gone on from the next time.
    """
    dataset, folder = known(name), folder_of(name)
    for file in status(name):
        if file.state is State.PRESENT:
            tell(file.path, "there")
            continue
        missing = file.state is State.MISSING
        tell(file.path, "is fetched" if missing else "altered: is fetched anew")
        _fetch(dataset, folder, file.path)
    return folder


def _fetch(dataset: Dataset, folder: Path, path: str) -> None:
    import pooch

    url = dataset.files_url + path
    kept = pooch.create(
        path=folder,
        base_url=dataset.files_url,
        registry={path: f"sha256:{dataset.files[path]}"},
    )
    pooch.get_logger().setLevel("WARNING")
    part = folder / f"{path}.part"
    try:
        kept.fetch(path, downloader=Resuming(part))
    except ValueError as error:
        if "hash" not in str(error).lower():
            raise
        raise DataError(
            f"what {url} sends is not the published file: its sha256 differs",
            file=folder / path,
            field=dataset.name,
            fix=f"nothing was kept of it; try again, or copy it from {dataset.upstream}",
        ) from None
    except OSError as error:
        if isinstance(error, DataError) or not _of_disk(error):
            raise
        raise DataError(
            f"can't be written: {error.strerror}",
            file=folder / path,
            fix=f"set {VARIABLE} to a folder of yours, or make room",
        ) from None


def _of_disk(error: OSError) -> bool:
    """Whether an error is the disk's; those of the network are requests' own."""
    return error.errno is not None and type(error).__module__ == "builtins"


class Resuming:
    """A downloader for pooch that keeps what has come in a file beside, and goes on from there.

    Args:
        part: that file.
    """

    def __init__(self, part: Path) -> None:
        self._part = part

    def __call__(self, url: str, output_file: Any, _pooch: Any, **_more: Any) -> None:
        """Downloads `url` to `output_file`.

        Raises:
            DataError: the server isn't reached, refuses, or breaks off again and again.
        """
        import requests

        self._part.parent.mkdir(parents=True, exist_ok=True)
        why = ""
        for _ in range(TRIES):
            try:
                self._go_on(url)
            except requests.exceptions.HTTPError as error:
                told = error.response.status_code if error.response is not None else "no"
                raise DataError(
                    f"the server says {told} to {url}",
                    fix="look whether it has moved",
                ) from None
            except (requests.exceptions.RequestException, ConnectionError) as error:
                why = type(error).__name__
                continue
            self._part.replace(output_file)
            return
        came = self._came
        raise DataError(
            f"{url} is not reached ({why})" if not came else f"{url} broke off after {came} bytes",
            fix="are you online? Call it again"
            + ("" if not came else ": it goes on from where it broke off"),
        )

    @property
    def _came(self) -> int:
        return self._part.stat().st_size if self._part.exists() else 0

    def _go_on(self, url: str) -> None:
        """Asks for what is missing, and adds it."""
        import requests

        came = self._came
        headers = {"Range": f"bytes={came}-"} if came else {}
        # compressed on the way, the bytes that came would not be the file's
        headers["Accept-Encoding"] = "identity"
        with requests.get(url, headers=headers, stream=True, timeout=TIMEOUT_S) as answer:
            if answer.status_code == requests.codes.requested_range_not_satisfiable:
                return  # there is no more of it
            answer.raise_for_status()
            goes_on = answer.status_code == requests.codes.partial_content
            with self._part.open("ab" if goes_on else "wb") as file:
                for chunk in answer.iter_content(CHUNK):
                    file.write(chunk)
