import hashlib
import re

import pytest

from vrbench.errors import ConfigError, DataError
from vrbench.recording import datasets
from vrbench.recording.datasets import (
    DATASETS,
    VARIABLE,
    Dataset,
    FileStatus,
    State,
    find,
    find_file,
    known,
    status,
)

TINY = Dataset(
    name="tiny2000",
    title="Two files",
    licence="MIT",
    doi="10.0/none",
    upstream="https://example.org/tiny",
    commit="abc1234",
    files={
        "a/one.txt": hashlib.sha256(b"one").hexdigest(),
        "two.bag": hashlib.sha256(b"two").hexdigest(),
    },
)


@pytest.fixture
def tiny(tmp_path, monkeypatch):
    """A dataset whose files are both there."""
    monkeypatch.setattr(datasets, "DATASETS", {"tiny2000": TINY})
    monkeypatch.setenv(VARIABLE, str(tmp_path))
    folder = tmp_path / "tiny2000"
    (folder / "a").mkdir(parents=True)
    (folder / "a/one.txt").write_bytes(b"one")
    (folder / "two.bag").write_bytes(b"two")
    return folder


def test_every_known_dataset_says_what_it_is_and_how_to_get_it():
    for name, dataset in DATASETS.items():
        assert dataset.name == name
        assert dataset.upstream in dataset.how_to_get
        assert dataset.commit in dataset.how_to_get
        assert dataset.files
        for path, sha256 in dataset.files.items():
            assert re.fullmatch(r"[\w.]+(/[\w.]+)*", path)
            assert re.fullmatch(r"[0-9a-f]{64}", sha256)
        assert len(set(dataset.files.values())) == len(dataset.files)


def test_the_papers_dataset_lists_both_headsets_and_all_three_motions():
    files = known("banaszczyk2024").files
    for headset in ("quest2", "quest_pro"):
        for motion in ("calib", "traj1", "traj2"):
            assert f"data/experiments/{headset}/center_eye_data/{motion}.txt" in files
            assert f"data/experiments/{headset}/tcp_bags/{motion}.bag" in files
    assert len(files) == 13


def test_whole_files_are_present(tiny):
    assert find("tiny2000") == tiny
    assert find_file("tiny2000", "a/one.txt") == tiny / "a/one.txt"
    assert status("tiny2000") == [
        FileStatus("a/one.txt", State.PRESENT),
        FileStatus("two.bag", State.PRESENT),
    ]


def test_a_missing_and_an_altered_file_are_told_apart(tiny):
    (tiny / "a/one.txt").unlink()
    (tiny / "two.bag").write_bytes(b"too")
    assert [x.state for x in status("tiny2000")] == ["missing", "altered"]
    with pytest.raises(DataError, match=r"one\.txt: missing from dataset tiny2000.*abc1234"):
        find_file("tiny2000", "a/one.txt")
    with pytest.raises(
        DataError, match=r"two\.bag: is not the file.*sha256 differs.*data fetch tiny2000"
    ):
        find_file("tiny2000", "two.bag")


@pytest.mark.parametrize("value", [None, "", "  "])
def test_without_the_variable_the_error_says_what_to_set(tiny, monkeypatch, value):
    monkeypatch.setattr(datasets, "cache", lambda: tiny / "cache")
    if value is None:
        monkeypatch.delenv(VARIABLE)
    else:
        monkeypatch.setenv(VARIABLE, value)
    with pytest.raises(ConfigError, match=r"VRBENCH_DATA is not set \(.*data fetch"):
        find("tiny2000")
    assert {x.state for x in status("tiny2000")} == {State.MISSING}


def test_a_folder_that_is_not_there_is_named(tiny, monkeypatch):
    monkeypatch.setenv(VARIABLE, str(tiny / "nowhere"))
    with pytest.raises(ConfigError, match=r"nowhere.tiny2000: no such folder.*example\.org/tiny"):
        find("tiny2000")


def test_unknown_names_are_refused_with_those_that_are_known(tiny):
    with pytest.raises(ConfigError, match=r"no dataset is called 'tiny'.*known: tiny2000"):
        status("tiny")
    with pytest.raises(ConfigError, match=r"no file 'three'.*a/one\.txt, two\.bag"):
        find_file("tiny2000", "three")
