"""Leaderboards: devices side by side, where and only where their numbers can be compared."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from vrbench.errors import ConfigError, DataError, VrbenchError
from vrbench.results.board import STATISTICS, Board, BoardKey, Entry, Leaderboard, LeftOut
from vrbench.results.bundle import Bundle
from vrbench.results.collection import without_collection
from vrbench.results.published import Published, published, published_entries
from vrbench.results.scatter import measured
from vrbench.results.standing import Standing, baseline_of, is_change, standings
from vrbench.results.tables import pool
from vrbench.statistics.bootstrap import scope_of
from vrbench.statistics.ranks import Measured, interval, rank, told_apart


def leaderboard(folders: Iterable[Path], protocol: str) -> Leaderboard:
    """All boards of these runs: one for each thing that must be the same.

    A run that can't be read stands on no board; the others do.

    Raises:
        ConfigError: one run is given twice.
    """
    by_key: dict[BoardKey, list[Standing]] = defaultdict(list)
    left_out: list[LeftOut] = []
    seen: set[Path] = set()
    every = list(folders)
    for folder in every:
        where = folder.resolve()
        if where in seen:
            raise ConfigError("the run is given twice", file=folder)
        seen.add(where)
    with without_collection():
        for folder in every:
            found = _read(protocol, folder)
            if isinstance(found, VrbenchError):
                left_out.append(LeftOut(str(folder), found))
                continue
            for standing in found:
                by_key[standing.key].append(standing)
    printed = published()
    with without_collection():
        boards = [_board(key, by_key[key], printed) for key in sorted(by_key)]
    return Leaderboard(boards, left_out)


def _read(protocol: str, folder: Path) -> Sequence[Standing] | VrbenchError:
    """What a run says, or why it can't be read."""
    try:
        return standings(Bundle.open(folder), protocol)
    except VrbenchError as error:
        return error
    except OSError as error:
        return DataError("can't be read", file=folder, fix=error.strerror)


def _board(
    key: BoardKey, standings: Sequence[Standing], publications: Sequence[Published]
) -> Board:
    suite = standings[0].suite
    change = is_change(suite, key.condition)
    metric = f"{suite.rank.metric} {suite.rank.statistic} at the {suite.rank.point}"
    if change:
        metric = f"change of {metric} against {baseline_of(suite)}"
    rows: dict[tuple[str, ...], list[Standing]] = defaultdict(list)
    for standing in sorted(standings, key=lambda s: (s.record.created, s.run)):
        rows[standing.identity].append(standing)
    sound: list[tuple[Entry, Sequence[Standing]]] = []
    others: list[Entry] = []
    for group in rows.values():
        for sittings, why in _told(group):
            entry = _entry(sittings, why)
            if entry.status == "ok":
                sound.append((entry, sittings))
            else:
                others.append(entry)
    entries = sorted(_ranked(sound, _same_recordings(standings)), key=_by_value)
    entries += sorted(others, key=_by_value)
    entries += published_entries(publications, key, change=change)
    return Board(key, metric, entries, change)


def _by_value(entry: Entry) -> tuple[bool, float, tuple[str, ...], Sequence[str]]:
    return entry.value is None, entry.value or 0.0, entry.identity, entry.runs


def _told(group: Sequence[Standing]) -> Iterable[tuple[Sequence[Standing], str]]:
    """The runs of one row, oldest first: its sittings together, and apart what is no new sitting.

    Returns:
        runs that make an entry together, and why the entry is a duplicate, if it is one.
    """
    sittings: dict[str, Standing] = {}
    takes: dict[str, str] = {}
    for standing in group:
        copied = next((takes[t.sha256] for t in standing.takes if t.sha256 in takes), None)
        takes |= {take.sha256: standing.run for take in standing.takes if take.sha256}
        if copied is not None:
            yield [standing], f"it holds recordings of {copied}"
        elif standing.status != "ok":
            yield [standing], ""
        elif standing.record.sitting in sittings:
            first = sittings[standing.record.sitting]
            yield (
                [standing],
                f"{first.run} is of sitting {first.record.sitting} too, and is older",
            )
        elif sittings and standing.suite.rank.statistic not in ("rmse", "mean"):
            yield [standing], f"{standing.suite.rank.statistic} of several sittings can't be pooled"
        else:
            sittings[standing.record.sitting] = standing
    if sittings:
        yield list(sittings.values()), ""


def _entry(sittings: Sequence[Standing], duplicate: str) -> Entry:
    """The entry of runs in several sittings, or in one."""
    first = sittings[0]
    row, rank = first.row, first.suite.rank
    places = [(s.record.sitting, str(take.mount)) for s in sittings for take in s.takes]
    value, low, high = (row.value, row.ci_low, row.ci_high) if row else (None, None, None)
    if len(sittings) > 1:
        together = measured(sittings)
        value, (low, high) = together.value, interval(together)
    scope = "" if low is None else scope_of(places)
    status, reason = first.status, first.reason
    if duplicate:
        status, reason = "duplicate", duplicate
    elif status == "ok" and scope not in ("mount", "sitting"):
        status = "take scope"
        reason = "it speaks for these takes only: a rank takes two mounts of three repeats each"
        if low is None:
            status, reason = "no interval", f"no interval of {rank.metric} was computed"
    device, numbers = first.record.device, [s.numbers for s in sittings]
    epochs = _known(max, [n.epochs for n in numbers])
    return Entry(
        device=device.headset,
        firmware=device.firmware,
        logger=device.logger,
        logger_version=device.logger_version,
        prediction=device.prediction,
        lab=first.record.lab,
        value=value,
        unit=row.unit if row else "",
        low=low,
        high=high,
        scope=scope,
        statistics=_statistics(sittings),
        floor=_known(max, [n.floor for n in numbers]),
        takes=len(places),
        mounts=len(set(places)),
        sittings=len(sittings),
        failed=sum(n.troubled("failed") for n in numbers),
        invalid=sum(n.troubled("invalid") for n in numbers),
        coverage=_known(min, [n.coverage for n in numbers]),
        epochs=None if epochs is None else int(epochs),
        cameras=first.cameras,
        status=status,
        reason=reason,
        runs=[s.run for s in sittings],
    )


def _statistics(sittings: Sequence[Standing]) -> dict[str, float | None]:
    """The paper's four numbers of the ranking metric, over all sittings."""
    known = [s for s in sittings if s.status not in ("failed", "invalid")]
    rows = [row for s in known for row in s.numbers.pooled.values()]
    if len(sittings) > 1:
        rows = pool(rows, ("sitting",), {(s.record.sitting,): "" for s in sittings})
    found = {row.statistic: row.value for row in rows}
    return {name: found.get(name) for name in STATISTICS}


def _known(
    choose: Callable[[Iterable[float]], float], values: Sequence[float | None]
) -> float | None:
    """The least or the largest; None where one isn't known."""
    known = [value for value in values if value is not None]
    return choose(known) if len(known) == len(values) else None


def _same_recordings(standings: Sequence[Standing]) -> dict[str, str]:
    """For a run that holds recordings of a run of another row: which that is."""
    owners: dict[str, Standing] = {}
    found: dict[str, str] = {}
    for standing in standings:
        for take in standing.takes:
            owner = owners.setdefault(take.sha256, standing)
            if take.sha256 and owner.identity != standing.identity:
                found[standing.run] = f"it holds the same recordings as {owner.run}"
                found.setdefault(owner.run, f"it holds the same recordings as {standing.run}")
    return found


def _ranked(
    sound: Sequence[tuple[Entry, Sequence[Standing]]], copies: Mapping[str, str]
) -> list[Entry]:
    """The entries with their places, each among those of the labs that it can be compared with."""
    if len(sound) == 1:
        entry, _ = sound[0]
        return [replace(entry, rank=1, last_rank=1, ranked_among=(entry.lab,))]
    numbers = [measured(sittings, floor=entry.floor) for entry, sittings in sound]
    ranked = []
    entries = [entry for entry, _ in sound]
    differing = _differing_labs(entries, numbers)
    for labs in _comparable_labs(entries):
        mine = [i for i, (entry, _) in enumerate(sound) if entry.lab in labs]
        for i, (best, last) in zip(mine, rank([numbers[i] for i in mine]), strict=True):
            entry, sittings = sound[i]
            why = next((copies[s.run] for s in sittings if s.run in copies), differing.get(i, ""))
            ranked.append(
                replace(entry, rank=best, last_rank=last, ranked_among=tuple(labs), reason=why)
            )
    return ranked


def _comparable_labs(entries: Sequence[Entry]) -> list[list[str]]:
    """The labs in groups whose entries are ranked together.

    Two labs are comparable if they ran one device, the same in firmware, logger and prediction
    mode.
    """
    groups = {entry.lab: {entry.lab} for entry in entries}
    for shared in _by_device(entries).values():
        for i in shared[1:]:
            first, second = groups[entries[shared[0]].lab], groups[entries[i].lab]
            if first is not second:
                first |= second
                groups |= dict.fromkeys(second, first)
    return sorted(sorted(labs) for labs in {id(g): g for g in groups.values()}.values())


def _differing_labs(entries: Sequence[Entry], numbers: Sequence[Measured]) -> dict[int, str]:
    """By entry: which labs found otherwise of its device, where they can be told apart."""
    found = {}
    for shared in _by_device(entries).values():
        told = told_apart([numbers[i] for i in shared])
        for i, row in zip(shared, told, strict=True):
            others = [entries[j] for j, differs in zip(shared, row, strict=True) if differs]
            if others:
                labs = ", ".join(f"{other.lab} ({other.value:.4g})" for other in others)
                found[i] = f"of the same device other labs found otherwise: {labs}"
    return found


def _by_device(entries: Sequence[Entry]) -> dict[tuple[str, ...], list[int]]:
    """Which entries are of one device, in whatever lab."""
    found: dict[tuple[str, ...], list[int]] = defaultdict(list)
    for i, entry in enumerate(entries):
        found[entry.identity].append(i)
    return found
