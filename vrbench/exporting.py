"""Exports: a run's takes, as they are scored, in the files of other tools."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from vrbench.errors import DataError, EstimationError
from vrbench.evaluation import Tell, calibrated
from vrbench.protocols.body import body_shapes, usable
from vrbench.protocols.protocol import Protocol
from vrbench.results.bundle import Bundle
from vrbench.results.export import evo, samples, tum
from vrbench.results.export.layout import write_layout
from vrbench.results.export.part import Part
from vrbench.results.files import new_folder
from vrbench.results.tables import parse_rows
from vrbench.scoring.preparing import prepared
from vrbench.scoring.rules import Rules

WRITERS: dict[str, Callable[[Part, Path], list[Path]]] = {
    "tum": tum.write_part,
    "evo": evo.write_part,
    "csv": samples.write_part,
}
# Told of what is left out, and why.
Complain = Callable[[str], None]


def export(
    bundle: Bundle, form: str, protocol: Protocol, folder: Path, tell: Tell, complain: Complain
) -> list[Path]:
    """Writes a run's takes into a folder.

    Args:
        bundle: a complete run; an evaluated one for `parquet`, which takes the metrics along.
        form: one of `vrbench.results.export.FORMATS`.
        protocol: how takes are made ready.
        folder: a new or an empty one.
        tell: told of each take.
        complain: told of what is left out.

    Returns:
        the files written.

    Raises:
        ConfigError: the folder holds files, or a library is missing.
        DataError: a take is gone, altered or unreadable, or nothing could be exported.
    """
    new_folder(folder)
    if form == "foxglove":
        return [write_layout(_streams(bundle), folder)]
    parts = ready(bundle, protocol, tell, complain)
    if form == "parquet":
        table = f"metrics/{protocol.name}.csv"
        rows = parse_rows(bundle.content(table), bundle.folder / table)
        return samples.write_parquet(parts, rows, folder, complain)
    written: list[Path] = []
    for part in parts:
        try:
            written += WRITERS[form](part, folder)
        except EstimationError as error:
            complain(f"{part.stem}: {error}")
    if not written:
        raise DataError("nothing can be exported", file=bundle.folder)
    return written


def ready(bundle: Bundle, protocol: Protocol, tell: Tell, complain: Complain) -> Iterator[Part]:
    """The takes of a run as evaluation scores them, each world frame by itself."""
    suite = bundle.record.resolved_suite()
    done, total = 0, len(bundle.record.takes) * len(bundle.record.references)
    for reference in bundle.record.references:
        rules = Rules(bundle.record, suite, (), protocol, reference)
        mounts = sorted({take.mount for take in bundle.record.takes})
        calibrations = {mount: calibrated(bundle, protocol, reference, mount) for mount in mounts}
        for take in bundle.record.takes:
            tell(take.name, done, total)
            done += 1
            if take.status != "ok":
                complain(f"{take.name}: {take.reason}")
                continue
            columns = bundle.columns(take)
            own = replace(rules, reference=protocol.reference(columns, reference))
            good, _ = usable(*calibrations[take.mount], body_shapes(columns, reference))
            try:
                found = prepared(own, take, columns, good)
            except (EstimationError, DataError) as error:
                complain(f"{take.name}: {error}")
                continue
            device = bundle.record.device.headset
            for name, part in found.parts.items():
                if isinstance(part, str):
                    complain(f"{take.name} {name}: {part}")
            for part in (found.ready or {"all": found.whole}).values():
                yield Part(device, take.name, own.reference, part)


def _streams(bundle: Bundle) -> list[str]:
    """The pose streams of the takes, the headset's first; what was planned is left out."""
    streams: dict[str, None] = {}
    for take in bundle.record.takes:
        if take.status == "ok":
            streams |= dict.fromkeys(bundle.columns(take).poses)
    kept = [stream for stream in streams if not stream.endswith("/target")]
    return sorted(kept, key=lambda stream: (not stream.startswith("headset"), stream))
