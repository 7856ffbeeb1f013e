"""Evaluation: it finds what the simulator hides, sees nothing else, and says what it can't say."""

from __future__ import annotations

import json
import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import evaluated, recorded
from vrbench.config.suite import Suite
from vrbench.geometry import Transform, relative_angle
from vrbench.recording.take import TakeWriter, read_take
from vrbench.results.bundle import Bundle
from vrbench.results.files import file_digest
from vrbench.results.tables import Row, read_rows
from vrbench.streams import Columns, Joints

TABLE = "metrics/vrbench-1.csv"


def truth(run: Path, take: str) -> dict:
    return json.loads((run / "truth" / f"{take}.json").read_text())["headset"]


def one(rows: list[Row], **wanted: str) -> Row:
    """The only row with these cells."""
    found = [row for row in rows if all(getattr(row, k) == v for k, v in wanted.items())]
    assert len(found) == 1, (wanted, len(found))
    return found[0]


EYE = {
    "case": "replay",
    "metric": "ape.translation.aligned",
    "point": "eye",
    "statistic": "rmse",
    "variant": "main",
    "band": "all",
    "segment": "all",
}


def forget(run: Path, case: str, repeat: int) -> Bundle:
    """The run without one of its takes."""
    record = json.loads((run / "run.json").read_text())
    record["takes"] = [t for t in record["takes"] if (t["case"], t["repeat"]) != (case, repeat)]
    (run / "run.json").write_text(json.dumps(record))
    return Bundle.open(run)


def rewrite(run: Path, name: str, change) -> Bundle:
    """The run with one take's columns changed."""
    path = run / "takes" / f"{name}.mcap"
    columns = read_take(path)
    path.unlink()
    changed = change(columns)
    with TakeWriter(path, changed.metadata) as writer:
        writer.write(changed)
    record = json.loads((run / "run.json").read_text())
    next(t for t in record["takes"] if t["file"].endswith(path.name))["sha256"] = file_digest(path)
    (run / "run.json").write_text(json.dumps(record))
    return Bundle.open(run)


def test_the_calibration_finds_the_mounting(run: Path) -> None:
    content = json.loads((run / "calibration.json").read_text())
    for found in content["protocols"]["vrbench-1"]["robot"]:
        x = Transform.of(found["tcp_eye"]["p_m"], found["tcp_eye"]["q_xyzw"])
        true = truth(run, found["take"])["tcp_eye"]
        assert np.linalg.norm(x.p - true["p_m"]) < 2.5e-3  # half a minute, 1.2 mm of slow noise
        assert np.degrees(relative_angle(x.q, np.array(true["q_xyzw"]))) < 0.15


def test_the_clock_finds_the_offset(run: Path) -> None:
    rows = read_rows(run / TABLE)
    for repeat in "12":
        row = one(rows, case="replay", repeat=repeat, metric="clock.offset", variant="main")
        true = truth(run, f"replay.default.m1.r{repeat}")["clock_offset_s"]
        assert row.value == pytest.approx(true * 1e3, abs=2.0)


def test_the_error_found_is_the_error_made(run: Path) -> None:
    """1.2 mm rms on each axis is 2.1 mm; half a minute's alignment takes some of the slow part."""
    rows = read_rows(run / TABLE)
    row = one(rows, repeat="1", **EYE)
    assert 1.2 < row.value < 2.4
    assert row.unit == "mm"
    assert row.samples > 1500


def test_evaluation_never_reads_the_truth(run: Path) -> None:
    before = (run / TABLE).read_bytes()
    shutil.rmtree(run / "truth")
    evaluated(Bundle.open(run))
    assert (run / TABLE).read_bytes() == before


def test_no_row_is_without_a_number_or_a_reason(run: Path) -> None:
    rows = read_rows(run / TABLE)
    assert len(rows) > 200
    for row in rows:
        assert (row.value is None) <= (row.status != "ok"), row
        assert row.value is None or math.isfinite(row.value)
        assert row.status == "ok" or row.reason, row
    keys = [row.key for row in rows]
    assert len(set(keys)) == len(keys)


def test_intervals_are_whole_and_say_what_they_speak_for(run: Path) -> None:
    rows = read_rows(run / TABLE)
    for row in rows:
        assert (row.ci_low is None) == (row.ci_high is None) == (row.ci_scope == "")
        if row.ci_low is not None and row.ci_high is not None:
            assert row.ci_low <= row.value <= row.ci_high, row
            assert row.ci_low < row.ci_high, row
            assert row.ci_scope == "take"  # one mount, two repeats
    assert sum(row.ci_low is not None for row in rows) >= 40


def test_repeats_are_pooled_over_their_samples(run: Path) -> None:
    rows = read_rows(run / TABLE)
    cells = {
        "case": "replay",
        "metric": "ape.translation.aligned",
        "point": "eye",
        "variant": "main",
        "band": "all",
    }
    parts = [one(rows, repeat=r, statistic="sse", **cells) for r in "12"]
    pooled = one(rows, repeat="all", mount="all", statistic="rmse", **cells)
    n = sum(part.samples for part in parts)
    assert pooled.value == pytest.approx(math.sqrt(sum(part.value for part in parts) / n))
    assert pooled.samples == n


def test_in_sample_numbers_are_labelled_and_never_worse_by_much(run: Path) -> None:
    rows = read_rows(run / TABLE)
    cells = {
        "case": "replay",
        "repeat": "1",
        "metric": "ape.translation.aligned",
        "point": "tcp",
        "statistic": "rmse",
        "band": "all",
    }
    own, held_out = (one(rows, variant=v, **cells).value for v in ("in-sample", "main"))
    assert own < held_out * 1.05


def test_without_a_calibration_after_it_is_unbracketed(run: Path) -> None:
    rows = evaluated(forget(run, "calibrate", 2))
    row = one(rows, repeat="1", **EYE)
    assert row.status == "unbracketed"
    assert row.reason == "no calibration after"
    assert row.value > 0


def test_without_any_calibration_what_needs_it_is_invalid(run: Path) -> None:
    forget(run, "calibrate", 1)
    rows = evaluated(forget(run, "calibrate", 2))
    ape = [r for r in rows if r.metric.startswith("ape.") and r.variant == "main"]
    assert {row.status for row in ape} == {"invalid"}
    assert {row.reason for row in ape} == {"no calibration in this mount"}
    assert {row.value for row in ape} == {None}
    rate = one(rows, case="replay", repeat="1", metric="timing.rate", statistic="value")
    assert rate.status == "ok"


def test_a_gate_that_is_missed_makes_takes_invalid(
    run: Path, short_suite: Suite, tmp_path: Path
) -> None:
    suite = short_suite.canonical()
    suite["gate"]["handeye.translation"] = 1e-4
    record = json.loads((run / "run.json").read_text())
    record["suite"] = suite
    (run / "run.json").write_text(json.dumps(record))
    rows = evaluated(Bundle.open(run))
    ape = [r for r in rows if r.metric == "ape.translation.aligned" and r.variant == "main"]
    assert {row.status for row in ape} == {"invalid"}
    assert all("the gate is 0.1 mm" in row.reason for row in ape)


def test_a_motion_that_leaves_the_calibration_is_extrapolated(
    tmp_path: Path, short_suite: Suite
) -> None:
    suite = short_suite.model_copy(
        update={"motions": {"head": "saturate-1", "calibration": "saturate-30s-1"}}
    )
    rows = evaluated(recorded(suite, tmp_path / "run"))
    row = one(rows, repeat="1", **EYE)
    assert row.status == "extrapolated"
    assert "lies outside the calibration" in row.reason


def test_streams_that_share_no_time_fail_with_both_spans(run: Path) -> None:
    def late(columns: Columns) -> Columns:
        from dataclasses import replace

        head = columns.poses["headset/eye"]
        day = 86_400 * 10**9
        moved = replace(head, pose_t=head.pose_t + day, receive_t=head.receive_t + day)
        return replace(columns, poses={**columns.poses, "headset/eye": moved})

    rows = evaluated(rewrite(run, "replay.default.m1.r1", late))
    failed = [r for r in rows if r.case == "replay" and r.repeat == "1"]
    assert {row.status for row in failed} == {"failed"}
    assert "do not overlap in time" in failed[0].reason
    sound = one(rows, repeat="2", **EYE)
    assert sound.status == "ok"


def test_a_clock_that_counts_from_the_device_s_start_is_found(run: Path) -> None:
    def since_start(columns: Columns) -> Columns:
        from dataclasses import replace

        head = columns.poses["headset/eye"]
        moved = replace(head, pose_t=head.pose_t - head.pose_t[0] + 5_000_000_000)
        return replace(columns, poses={**columns.poses, "headset/eye": moved})

    first = {r.key: r.value for r in read_rows(run / TABLE) if r.metric.startswith("ape.")}
    rows = evaluated(rewrite(run, "replay.default.m1.r1", since_start))
    for row in rows:
        if row.case == "replay" and row.metric == "ape.translation.aligned" and row.value:
            assert row.value == pytest.approx(first[row.key], rel=1e-3), row.key


def recentred(columns: Columns, after_s: float) -> Columns:
    """The headset's world made another one, so long after the first sample."""
    from dataclasses import replace

    head = columns.poses["headset/eye"]
    late = head.pose_t - head.pose_t[0] > after_s * 1e9
    moved = Transform.of((0.3, -0.1, 0.7), (0.0, 0.6, 0.0, 0.8)) @ head.pose
    pose = Transform(
        np.where(late[:, None], moved.p, head.pose.p), np.where(late[:, None], moved.q, head.pose.q)
    )
    epoch = head.epoch + late.astype(np.uint32)
    return replace(
        columns, poses={**columns.poses, "headset/eye": replace(head, pose=pose, epoch=epoch)}
    )


def test_each_epoch_is_scored_in_its_own_world(run: Path) -> None:
    rows = evaluated(rewrite(run, "replay.default.m1.r1", lambda c: recentred(c, 16.0)))
    parts = [one(rows, repeat="1", **{**EYE, "segment": f"epoch:{k}"}) for k in (0, 1)]
    whole = one(rows, repeat="1", **EYE)
    assert all(0.3 < part.value < 2.4 for part in parts)
    square = sum(part.value**2 * part.samples for part in parts)
    assert whole.value == pytest.approx(math.sqrt(square / whole.samples))
    assert whole.samples == sum(part.samples for part in parts)
    epochs = one(rows, case="replay", repeat="1", metric="coverage.epochs")
    assert epochs.value == 2
    variant = [
        r for r in rows if r.variant == "in-sample" and r.case == "replay" and r.repeat == "1"
    ]
    assert {row.status for row in variant} == {"skipped"}


def test_an_epoch_too_short_to_score_leaves_no_number_for_the_take(run: Path) -> None:
    rows = evaluated(rewrite(run, "replay.default.m1.r1", lambda c: recentred(c, 31.0)))
    failed = [row for row in rows if row.segment == "epoch:1" and row.repeat == "1"]
    assert {row.status for row in failed} == {"failed"}
    whole = one(rows, repeat="1", **EYE)
    assert (whole.value, whole.status) == (None, "failed")
    assert whole.reason.startswith("segment epoch:1: ")
    pooled = one(rows, repeat="all", **EYE)
    assert (pooled.value, pooled.status) == (None, "failed")


def test_a_calibration_that_recentred_is_not_used(run: Path) -> None:
    rows = evaluated(rewrite(run, "calibrate.default.m1.r2", lambda c: recentred(c, 16.0)))
    row = one(rows, repeat="1", **EYE)
    assert row.status == "unbracketed"
    assert "the headset recentred within the calibration" in row.reason


def with_joints(columns: Columns) -> Columns:
    """The take of a robot that tells its joints too."""
    from dataclasses import replace

    t = columns.poses["robot/tcp"].pose_t[:50]
    turned = np.linspace(0.0, 0.5, 100).reshape(50, 2)
    return replace(columns, joints={"robot/joints": Joints(t, t, turned, turned, ("a", "b"))})


def test_a_metric_that_fails_costs_its_own_rows_only_and_one_may_need_joints(run: Path) -> None:
    from vrbench.evaluation import evaluate
    from vrbench.metrics.registry import Family, Value
    from vrbench.plugin.manager import Plugins
    from vrbench.protocols.vrbench_1 import PROTOCOL

    def crash(_take):
        raise ZeroDivisionError("of a plugin")

    def nan(_take):
        yield Value("odd.nan", "value", math.nan, "mm", 1)

    def turned(take):
        for joints in take.columns.joints.values():
            yield Value("joints.span", "max", np.degrees(np.ptp(joints.position)), "deg", 50)

    odd = [
        Family("joints", "", {"joints.span": "deg"}, turned, needs=frozenset({"joints"})),
        Family("odd", "", {"odd.value": "mm"}, crash),
        Family("nan", "", {"odd.nan": "mm"}, nan),
    ]
    families = [*odd, Plugins().metrics["ape"]]
    bundle = rewrite(run, "replay.default.m1.r1", with_joints)
    rows = evaluate(bundle, families, PROTOCOL, lambda *_: None)
    assert one(rows, repeat="1", **EYE).status == "ok"
    span = one(rows, case="replay", repeat="1", metric="joints.span")
    assert span.value == pytest.approx(np.degrees(0.5))
    for metric, told in (("odd.value", "ZeroDivisionError: of a plugin"), ("odd.nan", "is nan")):
        row = one(rows, case="replay", repeat="1", metric=metric)
        assert (row.status, row.value) == ("failed", None)
        assert told in row.reason


def test_a_take_that_was_changed_is_refused(run: Path) -> None:
    path = run / "takes" / "replay.default.m1.r1.mcap"
    path.write_bytes(path.read_bytes() + b"\0")
    before = (run / TABLE).read_bytes()
    with pytest.raises(Exception, match="was changed after it was recorded"):
        evaluated(Bundle.open(run))
    assert (run / TABLE).read_bytes() == before


def test_a_take_that_failed_while_it_was_recorded_is_told_and_not_opened(run):
    bundle = Bundle.open(run)
    lost = bundle.record.takes[1]
    lost.status, lost.reason = "failed", "the headset was lost"
    (run / lost.file).unlink()
    rows = [row for row in evaluated(bundle) if row.case == "replay"]
    own = [row for row in rows if row.repeat == "1"]
    assert own
    assert {(row.status, row.reason, row.value) for row in own} == {
        ("failed", "the headset was lost", None)
    }
    other = [r for r in rows if r.repeat == "2" and r.metric == "ape.translation.aligned"]
    assert {row.status for row in other} == {"ok"}
    pooled = [r for r in rows if r.mount == "all" and r.metric == "ape.translation.aligned"]
    assert {row.status for row in pooled} == {"failed"}
