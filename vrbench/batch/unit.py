"""A unit of work: one run, evaluated by one protocol, wherever that is done."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from platform import node

from vrbench.batch.build import build, differences
from vrbench.batch.places import at_hand, is_url
from vrbench.cache.store import Store
from vrbench.errors import ConfigError, DataError, VrbenchError
from vrbench.evaluation import evaluate
from vrbench.plugin.manager import Plugins, families_of, pick
from vrbench.protocols.registry import builtin_protocols
from vrbench.results.bundle import Bundle
from vrbench.results.lock import locked
from vrbench.results.tables import Row

# Set to anything, errors of vrbench itself end in a traceback.
TRACEBACK = "VRBENCH_TRACEBACK"
# Told of what is being done, and which part of it is done, 0..1.
Tell = Callable[[str, float], None]


@dataclass(frozen=True, slots=True)
class Unit:
    """What is to be done.

    Attributes:
        name: the run, as its user calls it.
        run: its folder, or a URL.
        protocol: the name of the protocol.
        cached: whether what was found before may be used.
        build: what it is to be evaluated with, where that is another computer.
        takes: digest of its takes as they were seen when the unit was made; empty if they weren't.
    """

    name: str
    run: str
    protocol: str
    cached: bool = True
    build: Mapping[str, str] = field(default_factory=dict)
    takes: str = ""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a unit: rows, or the error that ended it."""

    unit: Unit
    rows: Sequence[Row] = field(default_factory=list)
    error: VrbenchError | None = None


def perform(unit: Unit, tell: Tell, plugins: Plugins | None = None) -> Outcome:
    """Evaluates a run; an error is an outcome too."""
    try:
        _check_build(unit)
        with at_hand(unit.run) as folder:
            _check_takes(unit, folder)
            with locked(folder):
                bundle = Bundle.open(folder)
                store = Store.usual() if unit.cached else None
                rows = evaluate_bundle(bundle, unit.protocol, tell, plugins, store)
        return Outcome(unit, rows)
    except VrbenchError as error:
        return Outcome(unit, error=error)
    except OSError as error:
        return Outcome(unit, error=DataError(error.strerror or str(error), file=error.filename))
    except MemoryError:
        return Outcome(unit, error=DataError("memory ran out", file=unit.run))
    except Exception as error:
        if os.environ.get(TRACEBACK):
            raise
        told = f"vrbench itself failed: {type(error).__name__}: {error}"
        return Outcome(unit, error=DataError(told, file=unit.run, fix=f"{TRACEBACK}=1 tells where"))


def _check_build(unit: Unit) -> None:
    told = differences(unit.build, build()) if unit.build else []
    if told:
        raise ConfigError(
            f"worker {node()} has {'; '.join(told)}", file=unit.run, fix="install the same there"
        )


def _check_takes(unit: Unit, folder: Path) -> None:
    """Refuses a folder that isn't there, or isn't the one that was meant."""
    try:
        found = takes_digest(Bundle.begun(folder))
    except ConfigError:
        if not unit.build or is_url(unit.run):
            raise
        raise DataError(
            f"worker {node()} sees no run there",
            file=unit.run,
            fix="all workers must see the run's folder at this path; or give a URL",
        ) from None
    if unit.takes not in ("", found):
        raise DataError(f"worker {node()} sees other takes there", file=unit.run)


def as_seen_here(unit: Unit, build: Mapping[str, str]) -> Unit:
    """The unit as another computer is to have it: by its whole path, and with its takes' digest."""
    if is_url(unit.run):
        return replace(unit, build=build)
    folder = Path(unit.run).resolve()
    try:
        takes = takes_digest(Bundle.begun(folder))
    except VrbenchError:  # workers may see what isn't seen here, and tell what is wrong with it
        takes = ""
    return replace(unit, run=str(folder), build=build, takes=takes)


def takes_digest(bundle: Bundle) -> str:
    """sha256 over the takes that a run lists."""
    listed = sorted((take.file, take.sha256) for take in bundle.record.takes)
    return sha256(json.dumps(listed).encode()).hexdigest()


def evaluate_bundle(
    bundle: Bundle,
    protocol: str,
    tell: Tell,
    plugins: Plugins | None = None,
    store: Store | None = None,
) -> list[Row]:
    """Evaluates a bundle by its own suite.

    Raises:
        ConfigError: no such protocol, or a metric that nobody here has.
        DataError: a take is gone, altered or unreadable.
    """
    plugins = plugins or Plugins()
    protocols = {found.name: found for found in builtin_protocols()}
    chosen = pick(protocols, protocol, "protocol", field="--protocol", file=None)
    suite = bundle.record.resolved_suite()
    families = chosen.families or families_of(suite, plugins, str(bundle.folder))
    return evaluate(bundle, families, chosen, lambda name, i, total: tell(name, i / total), store)


def cores() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def check_jobs(jobs: int) -> None:
    """Refuses more processes than cores.

    Raises:
        ConfigError: there are fewer cores.
    """
    if jobs > cores():
        raise ConfigError(
            f"{jobs} processes on {cores()} cores would wait for each other",
            field="--jobs",
            fix=f"{cores()} at most",
        )
