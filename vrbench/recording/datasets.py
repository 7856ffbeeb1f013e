"""Published recordings that vrbench knows: where they are, and whether they are whole.

Datasets aren't part of vrbench: each lies in a folder of its own name, laid out as upstream, inside
the folder that the environment variable VRBENCH_DATA names, or else in the user's cache, where
`vrbench data fetch` puts them.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from vrbench.errors import ConfigError, DataError

VARIABLE = "VRBENCH_DATA"


@dataclass(frozen=True, slots=True)
class Dataset:
    """A published set of recordings.

    Attributes:
        name: its folder, and what recordings files call it in `dataset`.
        title: what it holds, for people.
        licence: SPDX identifier.
        doi: of the paper it belongs to.
        upstream: where it is published.
        commit: the version there.
        files: sha256 of each file, by path within the folder.
    """

    name: str
    title: str
    licence: str
    doi: str
    upstream: str
    commit: str
    files: Mapping[str, str]

    @property
    def how_to_get(self) -> str:
        """What to do to have it, in a sentence."""
        return (
            f"vrbench data fetch {self.name}; or set {VARIABLE} to the folder that holds"
            f" {self.name}/, a copy of {self.upstream} at commit {self.commit}"
        )

    @property
    def files_url(self) -> str:
        """What the path of a file is put behind, to have its address."""
        return f"{self.upstream}/raw/{self.commit}/"


class State(StrEnum):
    """Of a file of a dataset."""

    PRESENT = "present"
    MISSING = "missing"
    ALTERED = "altered"


@dataclass(frozen=True, slots=True)
class FileStatus:
    """A file of a dataset, by its path within the dataset's folder."""

    path: str
    state: State


HEAD_MOTION = "real_world_head_movement_example_0.bag"
BANASZCZYK2024 = {
    "data/experiments/quest2/center_eye_data": {
        "calib.txt": "d5a4e76df67eebf6a4eaab01541138d4653281f1569bfc595fa7eaed876011a6",
        "traj1.txt": "7e6f30f73c84ebdee62a502283bda584852f523c48698cf1551e7eac0b351641",
        "traj2.txt": "4c9ce19b56124bc985d811e990fc0f81c3f8856ea2ae7695de459e4218ca1783",
    },
    "data/experiments/quest2/tcp_bags": {
        "calib.bag": "8ec723c355c54afc68df0bd1399e73fc76f51e240d6b85d0361ca55b1ba58caa",
        "traj1.bag": "844edeff3fd0229ae1ab9f6a614521e1e8e8e78d765b09ecdedab0c05d5545a5",
        "traj2.bag": "2608d89f375fda1191ebfeb97c57c8ffab1e48e802d595442bbc61f00835f183",
    },
    "data/experiments/quest_pro/center_eye_data": {
        "calib.txt": "44e8083608c2b88dac8da247312b2e0e927661608cb5697b045c794582fb4392",
        "traj1.txt": "39defd32561b25462d71acf93bfdeaabd5ba60bcf60f4ee0f802716cc3f68770",
        "traj2.txt": "393174c7ac269fe45092246f2462affc6bb5566586bc03f1850b045ca7380a10",
    },
    "data/experiments/quest_pro/tcp_bags": {
        "calib.bag": "4c5186f150f473d8e47814882421087cd075ce7b5f681846c2d503ff71ad7d2b",
        "traj1.bag": "354c405ec34b6b915ef9b1654ef69465615fe5c79e555cf0a10cc35a5e03c89e",
        "traj2.bag": "07715de52681a92a8318d3a4d870c572fa1b294b797caceae10407c40b95eed3",
    },
    "data/real_world_head_trajectories": {
        HEAD_MOTION: "9c5c0609aa7eadfff8dd8a8b0aecbddc1768d4d65149c8dc8fb3b84e03f7beda",
    },
}
"""sha256 of the files, by folder and name."""

DATASETS: Mapping[str, Dataset] = {
    dataset.name: dataset
    for dataset in (
        Dataset(
            name="banaszczyk2024",
            title="Quest 2 and Quest Pro on a UR5e, and head motion of Space Pirate Trainer DX",
            licence="MIT",
            doi="10.1109/ISMAR-Adjunct64951.2024.00027",
            upstream="https://github.com/AdamBanaszczyk/head_trajectory",
            commit="c28d77a",
            files={
                f"{folder}/{file}": sha256
                for folder, files in BANASZCZYK2024.items()
                for file, sha256 in files.items()
            },
        ),
    )
}


def known(name: str) -> Dataset:
    """The dataset of that name.

    Raises:
        ConfigError: there is none.
    """
    if name not in DATASETS:
        raise ConfigError(
            f"no dataset is called {name!r}",
            field="dataset",
            fix=f"known: {', '.join(sorted(DATASETS))}",
        )
    return DATASETS[name]


def cache() -> Path:
    """The folder that datasets are kept in where VRBENCH_DATA names none."""
    from platformdirs import user_cache_path

    return user_cache_path("vrbench", appauthor=False)


def folder_of(name: str) -> Path:
    """The folder of a dataset, whether it is there or not: below VRBENCH_DATA, or in the cache."""
    root = os.environ.get(VARIABLE, "").strip()
    return (Path(root).expanduser() if root else cache()) / known(name).name


def find(name: str) -> Path:
    """The folder of a dataset; which of its files are there is for `status` to say.

    Raises:
        ConfigError: no such dataset, or its folder isn't there.
    """
    dataset, folder = known(name), folder_of(name)
    if not folder.is_dir() and not os.environ.get(VARIABLE, "").strip():
        raise ConfigError(
            f"dataset {name} is needed, was never fetched, and {VARIABLE} is not set",
            fix=dataset.how_to_get,
        )
    if not folder.is_dir():
        raise ConfigError("no such folder", file=folder, fix=dataset.how_to_get)
    return folder


def find_file(name: str, path: str) -> Path:
    """A file of a dataset, by its path within the dataset's folder; its digest is checked.

    Raises:
        ConfigError: as `find`; or the dataset has no such file.
        DataError: the file is missing or altered.
    """
    dataset = known(name)
    if path not in dataset.files:
        raise ConfigError(
            f"dataset {name} has no file {path!r}", fix=f"it has: {', '.join(dataset.files)}"
        )
    file = find(name) / path
    match _state(file, dataset.files[path]):
        case State.MISSING:
            raise DataError(f"missing from dataset {name}", file=file, fix=dataset.how_to_get)
        case State.ALTERED:
            raise DataError(
                f"is not the file of dataset {name}: its sha256 differs",
                file=file,
                fix=f"fetch it again: {dataset.how_to_get}",
            )
    return file


def status(name: str) -> list[FileStatus]:
    """Of every file of a dataset, whether it is there and unaltered; without a folder, all missing.

    Raises:
        ConfigError: no such dataset.
    """
    dataset = known(name)
    try:
        folder = find(name)
    except ConfigError:
        return [FileStatus(path, State.MISSING) for path in dataset.files]
    return [FileStatus(path, _state(folder / path, sha)) for path, sha in dataset.files.items()]


def _state(file: Path, sha256: str) -> State:
    if not file.is_file():
        return State.MISSING
    with file.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return State.PRESENT if digest == sha256 else State.ALTERED
