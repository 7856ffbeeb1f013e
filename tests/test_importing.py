"""Imports: recordings become takes, or nothing at all is left behind."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import SHORT, evaluated
from vrbench.errors import VrbenchError
from vrbench.importing import import_recordings
from vrbench.plugin.manager import Plugins
from vrbench.recording.take import read_take
from vrbench.results.bundle import Bundle
from vrbench.trajectory import write_tum

TAKES = {"calibrate": ("m1.r1", "m1.r2"), "replay": ("m1.r1", "m1.r2")}


@pytest.fixture
def lab(run: Path, tmp_path: Path) -> Path:
    """A folder of TUM logs of a simulated run, and the recordings.yaml that says what they are."""
    folder = tmp_path / "lab"
    folder.mkdir()
    (folder / "short.yaml").write_text(SHORT)
    takes = []
    for case, places in TAKES.items():
        for place in places:
            columns = read_take(run / "takes" / f"{case}.default.{place}.mcap")
            for name, stream in (("headset", "headset/eye"), ("robot", "robot/tcp")):
                write_tum(columns.poses[stream].trajectory(), folder / f"{case}.{place}.{name}.tum")
            takes.append(
                f"  - case: {case}\n    repeat: {place[-1]}\n    motion: saturate-30s-1\n"
                f"    headset: {{format: tum, path: {case}.{place}.headset.tum}}\n"
                f"    robot: {{format: tum, path: {case}.{place}.robot.tum}}\n"
            )
    (folder / "recordings.yaml").write_text(
        f"suite: {folder / 'short.yaml'}\nlab: test\ndevice: {{headset: my-headset}}\ntakes:\n"
        + "".join(takes)
    )
    return folder


def bring(lab: Path, folder: Path) -> Bundle:
    return import_recordings(str(lab / "recordings.yaml"), folder, Plugins(), lambda *_: None)


def change(lab: Path, old: str, new: str) -> None:
    path = lab / "recordings.yaml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def test_imported_recordings_score_as_the_run_they_came_from(
    lab: Path, run: Path, tmp_path: Path
) -> None:
    from vrbench.results.tables import read_rows

    bundle = bring(lab, tmp_path / "imported")
    found = {row.key[3:]: row for row in evaluated(bundle)}
    first = {row.key[3:]: row for row in read_rows(run / "metrics" / "vrbench-1.csv")}
    same = [
        key
        for key, row in first.items()
        if row.metric == "ape.translation.aligned" and row.statistic == "rmse" and row.value
    ]
    assert len(same) >= 8
    for key in same:
        # The logs hold no poses that were lost, and stamps to 0.1 us; all else is the same.
        assert found[key].value == pytest.approx(first[key].value, rel=2e-3), key


def test_stamps_since_a_device_s_start_are_told_and_scored(lab: Path, tmp_path: Path) -> None:
    for log in lab.glob("*.headset.tum"):
        rows = [line.split(" ", 1) for line in log.read_text().splitlines()]
        origin = Decimal(rows[0][0]) - 100
        log.write_text("".join(f"{Decimal(t) - origin} {rest}\n" for t, rest in rows))
    bundle = bring(lab, tmp_path / "imported")
    told = [repair for take in bundle.record.takes for repair in take.repairs]
    assert len(told) == 4
    assert all("of another epoch" in repair for repair in told)
    found = [
        row
        for row in evaluated(bundle)
        if (row.metric, row.statistic, row.variant) == ("ape.translation.aligned", "rmse", "main")
        and (row.case, row.point, row.band, row.repeat) == ("replay", "eye", "all", "1")
    ]
    assert [row.status for row in found] == ["ok"]
    assert found[0].value < 3.0


def test_takes_of_one_world_are_scored_in_it(lab: Path, tmp_path: Path) -> None:
    text = (lab / "recordings.yaml").read_text()
    (lab / "recordings.yaml").write_text(
        text.replace("    motion: ", "    world: evening\n    motion: ")
    )
    bundle = bring(lab, tmp_path / "imported")
    assert {bundle.columns(take).metadata["world"] for take in bundle.record.takes} == {"evening"}


def test_a_run_says_what_it_was_made_of(lab: Path, tmp_path: Path) -> None:
    bundle = bring(lab, tmp_path / "imported")
    record = Bundle.open(bundle.folder).record
    assert record.kind == "imported"
    assert record.device.headset == "my-headset"
    assert len(record.takes) == 4
    assert record.files.keys() == {"suite.yaml", "recordings.yaml"}
    assert {len(take.sha256) for take in record.takes} == {64}


def test_a_further_log_of_the_robot_is_a_stream_and_no_reference(lab: Path, tmp_path: Path) -> None:
    log = "{format: tum, path: replay.m1.r2.robot.tum}"
    change(lab, "    robot: ", f"    robot_paper: {log}\n    robot: ")
    bundle = bring(lab, tmp_path / "imported")
    first, second, *_ = (bundle.columns(take) for take in bundle.record.takes)
    assert list(first.poses) == ["headset/eye", "robot/tcp", "robot_paper/tcp"]
    assert list(second.poses) == ["headset/eye", "robot/tcp"]
    assert bundle.record.references == ["robot"]
    assert first.metadata["headset"] == "my-headset"
    assert first.metadata["role"] == "calibration"


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("    robot: ", "    robot_paper: {path: x.tum}\n    robot: ", "robot_paper.format"),
        ("    robot: ", "    robot_Paper: {format: tum, path: x}\n    robot: ", "robot_Paper"),
        ("    robot: ", "    robot_paper: ", r"no reference \(give robot or mocap\)"),
        ("format: tum", "format: tumm", "no format is called 'tumm'"),
        ("calibrate.m1.r1.headset.tum", "gone.tum", "no such file"),
        ("case: calibrate", "case: calibration", "has no case 'calibration'"),
        ("format: tum,", "format: tum, topic: /x,", "topic"),
        ("lab: test", "lab: test\nlabb: 2", "labb"),
        (
            "case: replay\n    repeat: 1\n    motion: saturate-30s-1",
            "case: replay\n    repeat: 1",
            "doesn't say which motion it is|differ in motion",
        ),
        ("suite: ", "suite: gone-", "no such file"),
        ("repeat: 2", "repeat: 1", "two takes are case calibrate mount 1 repeat 1"),
        ("repeat: 2", "repeat: 0", "greater than or equal to 1"),
        ("takes:", "dataset: unheard-of\ntakes:", "no dataset is called 'unheard-of'"),
    ],
)
def test_what_is_wrong_is_told_and_no_folder_is_left(
    lab: Path, tmp_path: Path, old: str, new: str, told: str
) -> None:
    change(lab, old, new)
    with pytest.raises(VrbenchError, match=told):
        bring(lab, tmp_path / "imported")
    assert not (tmp_path / "imported").exists()


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda text: "", "holds no poses"),
        (lambda text: text[: len(text) // 2], ""),
        (lambda text: "\n".join(reversed(text.splitlines())) + "\n", "stamps go back or repeat"),
        (lambda text: text.replace("\n", " 5\n", 1), "not TUM text"),
        (lambda text: "a b c\n" + text, "not TUM text"),
        (lambda text: "nan 0 0 0 0 0 0 1\n" + text, "stamp"),
    ],
)
def test_a_log_that_is_wrong_is_told_or_cut_short(
    lab: Path, tmp_path: Path, spoil, told: str
) -> None:
    log = lab / "replay.m1.r2.headset.tum"
    log.write_text(spoil(log.read_text()))
    try:
        bring(lab, tmp_path / "imported")
    except VrbenchError as error:
        assert told in str(error)
        assert str(log) in str(error)
        assert not (tmp_path / "imported").exists()
    else:
        assert not told


def test_a_folder_that_exists_is_left_alone(lab: Path, tmp_path: Path) -> None:
    folder = tmp_path / "imported"
    folder.mkdir()
    (folder / "mine.txt").write_text("precious")
    with pytest.raises(VrbenchError, match="is there already"):
        bring(lab, folder)
    assert (folder / "mine.txt").read_text() == "precious"


def test_an_interrupted_import_leaves_nothing(
    lab: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("vrbench.results.bundle.Bundle.add", stop)
    with pytest.raises(KeyboardInterrupt):
        bring(lab, tmp_path / "imported")
    assert not (tmp_path / "imported").exists()


@pytest.mark.parametrize("headset", ["quest-2", "quest-pro"])
def test_the_paper_s_recordings_go_all_the_way(paper: Path, tmp_path: Path, headset: str) -> None:
    """Numbers of the joint fit that the paper's recordings are known to give; see the changelog."""
    bundle = import_recordings(
        f"banaszczyk2024-{headset}", tmp_path / "run", Plugins(), lambda *_: None
    )
    rows = evaluated(bundle)
    offset = {"quest-2": (-264.0, -260.2), "quest-pro": (-23.9, -16.3)}[headset]
    rmse = {}
    for case, expected in zip(("calibrate", "replay"), offset, strict=True):
        found = next(
            r for r in rows if r.case == case and r.metric == "clock.offset" and r.variant == "main"
        )
        assert found.value == pytest.approx(expected, abs=2.5)
    for row in rows:
        if row.metric == "ape.translation.aligned" and row.statistic == "rmse":
            rmse[row.case, row.point, row.variant, row.band] = row
    tcp = rmse["replay", "tcp", "main", "all"]
    assert tcp.value < 1.95
    assert tcp.status == "extrapolated"
    assert "no calibration after" in tcp.reason
    assert rmse["replay", "eye", "main", "all"].value < 1.8
    assert np.isfinite(rmse["calibrate", "tcp", "in-sample", "all"].value)
    assert [repair for take in bundle.record.takes for repair in take.repairs]
