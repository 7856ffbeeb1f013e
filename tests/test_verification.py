"""verify: a sound run passes; whatever is changed, missing or set as a trap is found."""

from __future__ import annotations

import json
import os
import re
import shutil
import struct
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
import zstandard

from vrbench.errors import ConfigError, DataError
from vrbench.plugin.manager import Plugins
from vrbench.recording.take import read_take
from vrbench.results.bundle import Bundle
from vrbench.results.files import file_digest
from vrbench.results.tables import read_rows, write_rows
from vrbench.verification import Finding, verify_folder, verify_run

TABLE = "metrics/vrbench-1.csv"
PLOTS = "metrics/vrbench-1.plots.json"
TAKE = "takes/replay.default.m1.r1.mcap"


def found(folder: Path) -> list[str]:
    return [str(finding) for finding in verify_run(folder, Plugins(), lambda *_: None)]


def edit(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    path = folder / "run.json"
    record = json.loads(path.read_text())
    change(record)
    path.write_text(json.dumps(record))


def test_a_sound_run_passes(run: Path) -> None:
    """What rounding does is allowed, and a link that stays in the bundle is no trap."""
    rows = [
        row if row.value is None else replace(row, value=row.value * (1 + 5e-7))
        for row in read_rows(run / TABLE)
    ]
    write_rows(rows, run / TABLE)
    Bundle.open(run).enter(TABLE)
    (run / "again.yaml").symlink_to("suite.yaml")
    assert found(run) == []


def test_numbers_that_the_takes_do_not_give_are_found(run: Path) -> None:
    """The digest fits, because who changed the table entered it anew."""

    def better(row):
        if row.metric == "ape.translation.aligned" and row.statistic == "rmse" and row.value:
            return replace(row, value=row.value - 0.001)
        return row

    rows = [better(row) for row in read_rows(run / TABLE) if row.metric != "scale"]
    write_rows([*rows, replace(rows[0], metric="ape.invented")], run / TABLE)
    Bundle.open(run).enter(TABLE)
    lines = found(run)
    told = "\n".join(lines)
    assert "ape.translation.aligned eye all rmse: value is" in told
    assert "more numbers differ" in told
    assert len(lines) <= 7


def entered(run: Path, name: str, change: Callable[[str], str]) -> None:
    """Changes a file, and its digest too."""
    (run / name).write_text(change((run / name).read_text()))
    Bundle.open(run).enter(name)


def test_a_calibration_and_curves_that_the_takes_do_not_give_are_found(run: Path) -> None:
    def nearer(text: str) -> str:
        found = json.loads(text)
        (first, *_) = found["protocols"]["vrbench-1"]["robot"]
        first["tcp_eye"]["p_m"][0] += 1e-6
        first["tcp_eye_covariance"][5][5] *= 4.0
        return json.dumps(found)

    def flatter(text: str) -> str:
        found = json.loads(text)
        found["takes"][0]["errors"]["eye"]["rms"]["hi"] *= 0.9
        found["takes"][0]["errors"]["eye"]["quantiles"][-1] *= 0.9
        del found["takes"][1]
        return json.dumps(found)

    entered(run, "calibration.json", nearer)
    entered(run, PLOTS, flatter)
    told = [re.sub(r" is [^m].*", "", line.removeprefix(f"{run}: ")) for line in found(run)]
    calibration, replay = "calibrate.default.m1.r1", "replay.default.m1.r1"
    assert told == [
        f"calibration.json: robot {calibration}: tcp_eye x",
        f"calibration.json: robot {calibration}: covariance",
        f"{PLOTS}: {calibration} robot: errors.eye.rms",
        f"{PLOTS}: {calibration} robot: errors.eye.quantiles",
        f"{PLOTS}: {replay} robot: is missing",
    ]


def test_a_file_that_evaluation_makes_must_be_there(run: Path) -> None:
    edit(run, lambda r: r["files"].pop("calibration.json"))
    assert found(run) == [f"{run}: calibration.json: is missing: evaluation makes it"]


def flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda run: flip(run / TABLE), f"{TABLE}: isn't the file that run.json lists"),
        (lambda run: flip(run / TAKE), f"{TAKE}: isn't the file that run.json lists"),
        (lambda run: (run / TAKE).unlink(), f"{TAKE}: is missing"),
        (lambda run: (run / TABLE).unlink(), f"{TABLE}: is missing"),
        (lambda run: (run / "run.json").unlink(), "is not a run"),
        (lambda run: edit(run, lambda r: r.update(schema_version=2)), "schema version 2"),
        (lambda run: edit(run, lambda r: r.update(schema_version=None)), "schema version None"),
        (lambda run: edit(run, lambda r: r.update(status="incomplete")), "incomplete"),
        (lambda run: edit(run, lambda r: r["suite"].update(title="t", version=2)), "suite_digest"),
        (lambda run: edit(run, lambda r: r["device"].update(headset="x")), "device is "),
        (lambda run: edit(run, lambda r: r["takes"].pop()), "is a take that run.json doesn't list"),
        (lambda run: edit(run, lambda r: r["files"].pop(TABLE)), f"{TABLE}: is not in run.json"),
        (
            lambda run: edit(run, lambda r: r["files"].update({"../../secret": "0"})),
            "../../secret: leads out of the bundle",
        ),
        (
            lambda run: edit(run, lambda r: r["files"].update({"/etc/passwd": "0"})),
            "/etc/passwd: leads out of the bundle",
        ),
        (lambda run: edit(run, lambda r: r["takes"][0].update(file="takes/../x")), "takes.0.file"),
        (lambda run: (run / "link").symlink_to("/etc/passwd"), "link: leads out of the bundle"),
        (lambda run: (run / "up").symlink_to(".."), "up: leads out of the bundle"),
        (lambda run: os.mkfifo(run / "pipe"), "pipe: is no file"),
        (lambda run: (run / "run.json").write_text("{" * 100_000), "is not JSON"),
        (lambda run: (run / "run.json").write_text("[" * 100_000), "is not JSON"),
    ],
)
def test_what_is_wrong_is_named(run: Path, spoil: Callable[[Path], object], told: str) -> None:
    spoil(run)
    lines = found(run)
    assert any(told in line for line in lines), lines
    assert all(line.startswith(str(run)) for line in lines)


def bomb(path: Path, packed: bytes, stated: int) -> None:
    """Puts a chunk of its own at the start of a take."""
    compression = b"zstd"
    body = struct.pack("<QQQI", 0, 0, stated, 0)
    body += struct.pack("<I", len(compression)) + compression + struct.pack("<Q", len(packed))
    content = path.read_bytes()
    chunk = struct.pack("<BQ", 6, len(body) + len(packed)) + body + packed
    path.write_bytes(content[:8] + chunk + content[8:])


def zeros(size: int) -> bytes:
    """So many zeros, packed to next to nothing."""
    out = BytesIO()
    with zstandard.ZstdCompressor().stream_writer(out, closefd=False) as writer:
        for _ in range(size >> 20):
            writer.write(bytes(1 << 20))
    return out.getvalue()


@pytest.mark.parametrize(
    ("size", "stated", "told"),
    [
        (128 << 20, 128 << 20, "are allowed"),
        (32 << 20, 32 << 20, "times its size"),
        (128 << 20, 1 << 10, "doesn't unpack to the 1024 bytes"),
    ],
)
def test_a_take_that_unpacks_to_too_much_is_refused(
    run: Path, size: int, stated: int, told: str
) -> None:
    bomb(run / TAKE, zeros(size), stated)
    with pytest.raises(DataError, match=told):
        read_take(run / TAKE)
    edit(run, lambda r: r["takes"][1].update(sha256=file_digest(run / TAKE)))
    (line,) = found(run)
    assert told in line
    # where it was found in the run, not in the copy that is evaluated
    assert f"{run}: {TAKE}" in line


def test_a_shared_folder_of_labs(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run lies where its lab and suite say, and once; what it holds is checked as any run is."""
    checked: list[str] = []

    def seen(folder: Path, *_: object) -> list[Finding]:
        checked.append(folder.name)
        return [Finding(str(folder), "", "is broken")] if folder.name == "broken" else []

    monkeypatch.setattr("vrbench.verification.verify_run", seen)
    root = tmp_path / "results"
    for place in ("simulated/short@1/a", "simulated/short@1/broken"):
        shutil.copytree(run, root / place)
    (root / "README.md").write_text("ours")
    runs, wrong = verify_folder(root, Plugins(), lambda *_: None)
    assert checked == ["a", "broken"]
    assert [finding.what for finding in wrong] == ["is broken"]
    shutil.copytree(run, root / "mine/other@1/c")
    shutil.copytree(run, root / "stray")
    shutil.copytree(run / "takes", root / "mine/short@1/d/takes")
    runs, wrong = verify_folder(root, Plugins(), lambda *_: None)
    assert len(runs) == 3
    told = "\n".join(map(str, wrong))
    assert "lab 'simulated' lies in the folder 'mine'" in told
    assert "suite 'short@1' lies in the folder 'other@1'" in told
    assert "is a take of" in told
    assert "d: run.json: is missing" in told
    assert "stray: is not where runs belong: LAB/SUITE/RUN" in told


def test_a_folder_without_runs_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="there is no run in it"):
        verify_folder(tmp_path, Plugins(), lambda *_: None)
    with pytest.raises(ConfigError, match="is not a run"):
        verify_run(tmp_path / "gone", Plugins(), lambda *_: None)
