"""Stages of an evaluation: each is computed once for all that it rests on.

A key holds everything that a result depends on: the run's record with its takes' digests, the suite
and the protocol in it, the code that computes, by its source, all that is installed, and the
processor. Whatever of it can't be told apart for certain isn't kept.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import sys
import time
from collections.abc import Callable, Iterable
from functools import cache, partial
from inspect import isfunction
from pathlib import Path
from typing import Any, TypeVar

from vrbench.cache.packing import UnpackableError, pack, unpack
from vrbench.cache.store import Store
from vrbench.errors import DataError
from vrbench.metrics.registry import Family
from vrbench.protocols.protocol import Protocol
from vrbench.recording.take import read_take
from vrbench.results.record import RunRecord
from vrbench.sources import code_of, digest_of
from vrbench.streams import Columns

T = TypeVar("T")
# Source that is younger than this process isn't for certain what the process runs.
STARTED = time.time()
# What of a run's record says nothing about its takes.
VOLATILE = {"files", "versions", "resumed", "reason"}
# Of the environment, what numerical libraries look at.
LIBRARIES = ("OPENBLAS_", "OMP_", "MKL_", "BLIS_", "VECLIB_", "NPY_")
DECODING = "vrbench.recording.take"
EVALUATION = "vrbench.evaluation"


class Stages:
    """The stages of one run's evaluation by one protocol.

    Attributes:
        computed: the names of those that were computed, in order; the others were known.
    """

    def __init__(
        self, store: Store | None = None, base: str | None = None, *, joints: bool = False
    ) -> None:
        self._store, self._base, self._joints = store, base, joints
        self._asked: set[tuple[str, ...]] = set()
        self.computed: list[str] = []

    @classmethod
    def of(
        cls, store: Store | None, record: RunRecord, protocol: Protocol, *, joints: bool = False
    ) -> Stages:
        """Those of a run; without a store nothing is kept. `joints`: as `read_take` has it."""
        if store is None:
            return cls(joints=joints)
        parts = (protocol.prepare, protocol.calibrate, protocol.given_x, protocol.reference)
        code = _code([EVALUATION, *(_module(part) for part in parts if part is not None)])
        facts = record.model_dump(mode="json", exclude=VOLATILE)
        return cls(store, code and _key(code, protocol.name, facts), joints=joints)

    def columns(self, path: Path, sha256: str) -> Columns:
        """A take, decoded: once for its content.

        Args:
            path: a take whose digest has been checked,
            sha256: and that digest.
        """
        code = _code([DECODING]) if self._store is not None else None
        key = code and _key(code, "columns", sha256, self._joints)
        compute = partial(read_take, path, joints=self._joints)
        found: Columns = self._kept("columns", compute, key)
        return found

    def kept(
        self,
        stage: str,
        compute: Callable[[], T],
        *facts: str,
        code: str | None = "",
        given: object = None,
    ) -> T:
        """What `compute` returns, now or before.

        Args:
            stage: its name.
            compute: a function without effects, of what the run's record says and of `facts` only.
            facts: which one of the stages of this name it is.
            code: digest of code that it uses beside evaluation's own; None where it has none.
            given: a part of the result that the caller has anyway.

        Raises:
            DataError: two results would have one name.
        """
        # two results of one name would be taken for each other
        if (stage, *facts) in self._asked:
            raise DataError(
                f"{stage} of {' '.join(facts)} is asked for twice",
                fix="a run lists each of its takes and references once",
            )
        self._asked.add((stage, *facts))
        known = self._base is not None and code is not None
        key = _key(self._base, stage, facts, code) if known else None
        found: T = self._kept(stage, compute, key, given)
        return found

    def _kept(
        self, stage: str, compute: Callable[[], Any], key: str | None, given: object = None
    ) -> Any:
        if self._store is not None and key is not None:
            found = self._store.get(key)
            if found is not None:
                try:
                    return unpack(*found, given)
                except (ValueError, TypeError, IndexError) as error:
                    self._store.drop(key, error)
        self.computed.append(stage)
        value = compute()
        try:
            packed = pack(value, given)
        except UnpackableError:
            return value
        if self._store is not None and key is not None:
            self._store.put(key, *packed)
        return unpack(*packed, given)

    def trim(self) -> None:
        """Keeps the store to its cap."""
        if self._store is not None:
            self._store.trim()


def family_code(family: Family) -> str | None:
    """Digest of a family's code; None where the code can't be told from its source alone."""
    functions = [f for f in (family.of_take, family.of_repeats) if f is not None]
    for function in functions:
        module = sys.modules.get(_module(function))
        plain = isfunction(function) and not function.__closure__
        if not plain or getattr(module, function.__name__, None) is not function:
            return None
    code = _code([_module(function) for function in functions])
    stated = (family.name, dict(family.units), sorted(family.needs))
    return code and _key(code, stated, [function.__qualname__ for function in functions])


def _module(function: Any) -> str:
    return str(getattr(function, "__module__", None))


def _key(*parts: object) -> str:
    text = json.dumps([_computer(), *parts], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _code(modules: Iterable[str]) -> str | None:
    """Digest of modules and all that they import; None where it isn't certain what runs."""
    return _code_of(tuple(sorted(set(modules))))


@cache
def _code_of(modules: tuple[str, ...]) -> str | None:
    try:
        files = code_of(modules)
        if any(path.stat().st_mtime >= STARTED for path in files):
            return None
        return digest_of(files)
    except (OSError, SyntaxError, ValueError):
        return None


@cache
def _computer() -> str:
    """All that is installed, each with when it was; the processor; the threads that compute."""
    places = [Path(place or ".") for place in dict.fromkeys(sys.path)]
    infos = [info for place in places for info in place.glob("*.dist-info")]
    found = [f"{info.name} {info.stat().st_mtime_ns}" for info in infos]
    threads = {k: v for k, v in os.environ.items() if k.startswith(LIBRARIES)}
    facts = (sys.version, platform.machine(), _processor(), sorted(threads.items()), sorted(found))
    return hashlib.sha256(repr(facts).encode()).hexdigest()


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor()
    wanted = ("model name", "flags", "Features", "CPU part")
    return "\n".join(sorted({line for line in lines if line.startswith(wanted)}))
