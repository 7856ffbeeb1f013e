"""A unit of work: one run, evaluated by one protocol, wherever that is done."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from vrbench.errors import ConfigError, DataError, VrbenchError
from vrbench.evaluation import evaluate
from vrbench.plugin.manager import Plugins, families_of
from vrbench.protocols.registry import find_protocol
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
        run: its folder.
        protocol: the name of the protocol.
    """

    name: str
    run: str
    protocol: str


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a unit: rows, or the error that ended it."""

    unit: Unit
    rows: Sequence[Row] = field(default_factory=list)
    error: VrbenchError | None = None


def perform(unit: Unit, tell: Tell, plugins: Plugins | None = None) -> Outcome:
    """Evaluates a run; an error is an outcome too."""
    try:
        folder = Path(unit.run)
        Bundle.begun(folder)
        with locked(folder):
            bundle = Bundle.open(folder)
            return Outcome(unit, evaluate_bundle(bundle, unit.protocol, tell, plugins))
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


def evaluate_bundle(
    bundle: Bundle, protocol: str, tell: Tell, plugins: Plugins | None = None
) -> list[Row]:
    """Evaluates a bundle by its own suite.

    Raises:
        ConfigError: no such protocol, or a metric that nobody here has.
        DataError: a take is gone, altered or unreadable.
    """
    plugins = plugins or Plugins()
    chosen = find_protocol(protocol)
    suite = bundle.record.resolved_suite()
    families = chosen.families or families_of(suite, plugins, str(bundle.folder))
    return evaluate(bundle, families, chosen, lambda name, i, total: tell(name, i / total))


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
