"""The cache's files: whole, checked, and kept to a size; nothing in them is run."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from vrbench.cache.packing import UnpackableError, pack, unpack
from vrbench.cache.store import DIGEST_BYTES, Store
from vrbench.errors import ConfigError
from vrbench.geometry import Transform
from vrbench.recording.take import read_take
from vrbench.results.tables import Row

KEY = "ab" * 32
VALUE = {("a", 1): [None, True, 2, 0.1, float("inf"), "x", (np.float64(3.5),), frozenset("yx")]}


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def store(tmp_path: Path, told: list[str]) -> Store:
    return Store(tmp_path / "cache", 10**6, told.append)


def entry(store: Store) -> Path:
    (path,) = store.folder.rglob("*.entry")
    return path


def test_what_is_kept_comes_back(store: Store) -> None:
    store.put(KEY, *pack(VALUE))
    found = store.get(KEY)
    assert found is not None
    assert unpack(*found) == VALUE
    assert store.get("cd" * 32) is None


def test_a_take_comes_back_as_it_was(store: Store, run: Path) -> None:
    columns = read_take(next((run / "takes").glob("replay*.mcap")))
    store.cap = 10**9
    store.put(KEY, *pack(columns))
    found = store.get(KEY)
    assert found is not None
    back = unpack(*found)
    assert back.events == columns.events
    assert back.metadata == columns.metadata
    for name, samples in columns.poses.items():
        assert back.poses[name].pose_t.tobytes() == samples.pose_t.tobytes()
        assert back.poses[name].pose.q.tobytes() == samples.pose.q.tobytes()
        assert back.poses[name].flags.dtype == samples.flags.dtype


def test_arrays_are_contiguous_shared_and_of_their_own_shape() -> None:
    wide = np.arange(12.0).reshape(3, 4)
    pose = Transform(wide[:, :3], wide)
    first, second, scalar, empty = unpack(*pack([pose, pose, np.array(2.0), np.zeros((0, 3))]))
    assert first.p.flags.c_contiguous
    assert first.p is second.p
    assert (first.p == wide[:, :3]).all()
    assert scalar.shape == ()
    assert empty.shape == (0, 3)


@pytest.mark.parametrize("value", [object(), np.array(["x"]), np.array([None]), {1, 2}, 1j, Path()])
def test_what_could_be_anything_is_not_kept(value: object) -> None:
    with pytest.raises(UnpackableError):
        pack([value])


@pytest.mark.parametrize(
    "tree",
    [
        {"class": "os:system", "of": ["true"]},
        {"class": "vrbench.cli:main", "of": []},
        {"class": "vrbench.results.bundle:Bundle", "of": ["a", "b"]},
        {"class": "vrbench.recording.take:os.system", "of": ["true"]},
        {"model": "vrbench.results.tables:Row", "json": "{}"},
        {"anything": 1},
    ],
)
def test_nothing_but_data_comes_out(tree: object) -> None:
    assert unpack({"class": f"{Row.__module__}:Row", "of": [""] * len(fields(Row))}, [])
    with pytest.raises(ValueError, match=r"no such|not of vrbench"):
        unpack(tree, [])


@pytest.mark.parametrize("at", [0, 20, 200, -DIGEST_BYTES - 1, -1])
def test_a_damaged_entry_is_told_and_gone(store: Store, told: list[str], at: int) -> None:
    store.put(KEY, *pack([np.arange(100.0)]))
    path = entry(store)
    content = bytearray(path.read_bytes())
    content[at] ^= 1
    path.write_bytes(content)
    assert store.get(KEY) is None
    assert "the cache's entry is damaged" in told[0]
    assert not path.exists()
    store.put(KEY, *pack(1))
    assert store.get(KEY) is not None


@pytest.mark.parametrize("length", [0, 10, 40, 300])
def test_so_is_one_that_is_cut_short(store: Store, told: list[str], length: int) -> None:
    store.put(KEY, *pack([np.arange(100.0)]))
    path = entry(store)
    path.write_bytes(path.read_bytes()[:length])
    assert store.get(KEY) is None
    assert len(told) == 1


def test_the_longest_unused_go_first(store: Store) -> None:
    import os

    for n in range(4):
        store.put(f"{n}0" * 32, *pack([np.zeros(30_000)]))
        os.utime(next((store.folder / f"{n}0").iterdir()), (n, n))
    store.cap = 500_000
    assert store.get("00" * 32) is not None  # and so it is the one used last
    store.trim()
    assert [store.get(f"{n}0" * 32) is None for n in range(4)] == [False, True, True, False]


def test_what_is_as_large_as_the_cache_is_not_kept(store: Store) -> None:
    store.put(KEY, *pack([np.zeros(100_000)]))
    assert not store.folder.exists()


def test_a_folder_that_cannot_be_written_is_told_once(tmp_path: Path, told: list[str]) -> None:
    (tmp_path / "file").touch()
    store = Store(tmp_path / "file", 10**6, told.append)
    for _ in range(2):
        assert store.get(KEY) is None
        store.put(KEY, *pack(1))
    assert len(told) == 1
    assert "the cache can't be written" in told[0]


def test_a_size_that_is_none_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VRBENCH_CACHE_GB", "much")
    with pytest.raises(ConfigError, match="'much' is no size"):
        Store.usual()
