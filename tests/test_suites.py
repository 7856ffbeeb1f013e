"""The suites on the simulated rig, held against what only the simulator knows."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import Quiet, evaluated
from vrbench.config.rig import load_rig
from vrbench.config.suite import load_suite
from vrbench.geometry import Transform, quat_to_rotvec, rotvec_to_quat
from vrbench.motion.files import Header, write_motion
from vrbench.motion.generators import generate
from vrbench.plugin.manager import Plugins
from vrbench.results.bundle import Bundle
from vrbench.results.tables import Row
from vrbench.runner import record_suite
from vrbench.trajectory import Trajectory

RIG = """
lab: simulated
headset: {{plugin: sim, device: quest-pro, options: {headset}}}
robot: {{plugin: sim, options: {robot}, accuracy: {{value: 0.03 mm, source: simulated}}}}
"""
MOCAP = "mocap: {plugin: sim, options: {body: headset, lost_per_minute: 0.0}}\n"
HEAD = """
version: 1
title: A short one
mover: robot
references: [robot, mocap]
metrics: [ape, drift, clock, coverage, recovery, jitter]
gate: {handeye.translation: 15 mm, handeye.rotation: 0.5 deg, max_age: 60 min, bracket: 1 mm}
rank: {metric: ape.translation.aligned, point: eye, statistic: rmse, min_coverage: 95 %}
"""
COVERED = """
suite: short-covered
motions: {head: saturate-30s-1, calibration: saturate-30s-1}
cases:
  - {id: calibrate, motion: calibration, role: calibration}
  - {id: check, motion: head, role: check}
  - {id: replay, motion: head, needs: [x, clock, y]}
conditions:
  - {id: none, baseline: true}
  - {id: two, occlude: two}
  - {id: five, occlude: five}
order: abba
compare: paired
"""
LOOPS = """
suite: short-loops
motions: {head: saturate-30s-1, opening: opening.tum, calibration: saturate-30s-1}
cases:
  - {id: calibrate, motion: calibration, role: calibration}
  - {id: loop, motion: head, duration: 11 min, needs: [x, clock, y], exclude: [opening, gap]}
"""
FOUND = """
suite: short-found
motions: {head: saturate-30s-1, opening: opening.tum, calibration: saturate-30s-1}
cases:
  - {id: calibrate, motion: calibration, role: calibration}
  - id: lose
    motion: head
    loops: 3
    hold: 6 s
    needs: [x, clock, y]
    events: [{after: 1, do: occlude, level: all}, {after: 2, do: uncover}]
"""


def opening() -> Trajectory:
    """Half a minute of a player's motion, from rest to rest."""
    path = generate("shooter-1").trajectory.between(0, 30 * 10**9)
    rise = np.clip((30.0 - path.seconds(0)) / 5.0, 0.0, 1.0)[:, None] ** 2
    turn = rotvec_to_quat(rise * quat_to_rotvec(path.pose.q))
    return Trajectory(path.t, Transform(rise * path.pose.p, turn))


class Run:
    """A suite, recorded on a simulated rig and evaluated."""

    def __init__(
        self, folder: Path, suite: str, *, headset: str = "{}", robot: str = "{}", more: str = ""
    ) -> None:
        header = Header(motion="opening", version=1, up="y", rate_hz=120.0, source="generated")
        write_motion(folder / "opening.tum", header, opening())
        (folder / "suite.yaml").write_text(suite + HEAD)
        rig = folder / "rig.yaml"
        rig.write_text(RIG.format(headset=headset, robot=robot) + more)
        self.folder = folder / "run"
        self.bundle = record_suite(
            *(load_suite(str(folder / "suite.yaml")), load_rig(str(rig)), str(rig), self.folder),
            Plugins(),
            seed=7,
            watcher=Quiet(),
        )
        self.rows: list[Row] = evaluated(Bundle.open(self.folder))

    def truth(self, take: str) -> dict:
        return json.loads((self.folder / "truth" / f"{take}.json").read_text())["headset"]

    def find(self, metric: str, **wanted: str) -> list[Row]:
        wanted = {"metric": metric, "variant": "main", "band": "all", "reference": "robot"} | wanted
        return [row for row in self.rows if all(getattr(row, k) == v for k, v in wanted.items())]

    def one(self, metric: str, **wanted: str) -> Row:
        (row,) = self.find(metric, **wanted)
        return row


@pytest.fixture(scope="module")
def covered(tmp_path_factory) -> Run:
    return Run(tmp_path_factory.mktemp("covered"), COVERED)


@pytest.fixture(scope="module")
def slipped(tmp_path_factory) -> Run:
    """Whoever covers cameras pushes the headset by centimetres."""
    suite = COVERED.replace("  - {id: five, occlude: five}\n", "")
    return Run(tmp_path_factory.mktemp("slipped"), suite, headset="{handling_slip_m: 0.02}")


@pytest.fixture(scope="module")
def loops(tmp_path_factory) -> Run:
    """Twenty loops on a clock that gains, and gains more and less."""
    clock = "{clock_skew_ppm: 80.0, clock_wander_ppm: 40.0}"
    return Run(tmp_path_factory.mktemp("loops"), LOOPS, headset=clock)


@pytest.fixture(scope="module")
def drifting(tmp_path_factory) -> Run:
    """Three loops in a world that drifts, on a mount that vibrates unfelt."""
    world = "{tracking: {drift_m_per_min: 0.02, drift_rad_per_min: 0.01}}"
    suite = LOOPS.replace("duration: 11 min", "loops: 3")
    folder = tmp_path_factory.mktemp("drifting")
    return Run(folder, suite, headset=world, robot="{vibration_m: 0.0003}", more=MOCAP)


@pytest.fixture(scope="module")
def found(tmp_path_factory) -> Run:
    jump = "{tracking: {relocalisation_m: 0.02, lost_per_minute: 0.0}}"
    return Run(tmp_path_factory.mktemp("found"), FOUND, headset=jump)


EYE = {"point": "eye", "statistic": "rmse"}


# occluded cameras


def test_covered_cameras_make_errors_larger_as_much_as_the_simulator_made_them(covered):
    base, two = (
        covered.one("ape.translation.aligned", case="replay", condition=c, repeat="all", **EYE)
        for c in ("none", "two")
    )
    grown = 1.0 + covered.truth("replay.two.m1.r1")["occlusion_growth"] * 0.5
    assert two.value / base.value == pytest.approx(grown, rel=0.25)
    compared = covered.one("ape.translation.aligned", condition="two", variant="vs-baseline", **EYE)
    assert compared.value == pytest.approx(two.value - base.value, rel=0.05)
    assert compared.ci_low < compared.value < compared.ci_high
    assert compared.ci_scope == "take"  # one mount, two repeats


def test_a_level_that_the_headset_lacks_is_skipped_with_the_reason(covered):
    takes = [take for take in covered.bundle.record.takes if take.condition == "five"]
    assert {take.status for take in takes} == {"skipped"}
    assert not any((covered.folder / take.file).exists() for take in takes)
    rows = [row for row in covered.rows if row.condition == "five"]
    assert {row.status for row in rows} == {"skipped"}
    assert {row.value for row in rows} == {None}
    assert all("no occlusion level 'five': it has none, two, three, all" in r.reason for r in rows)


def test_nothing_that_stayed_in_place_is_said_to_have_moved(covered):
    assert not [row for row in covered.rows if "the headset moved" in row.reason]
    scored = covered.find("ape.translation.aligned", case="replay", mount="1", **EYE)
    assert {row.status for row in scored if row.condition != "five"} == {"ok"}


def test_the_take_says_what_was_covered(covered):
    take = next(t for t in covered.bundle.record.takes if t.name == "replay.two.m1.r1")
    events = [e for e in covered.bundle.columns(take).events if e.kind == "occlusion"]
    assert [event.detail for event in events] == [{"level": "two", "cameras": [0, 3]}]


def test_a_headset_that_was_pushed_is_scored_with_the_x_found_since(slipped):
    first, pushed = (
        slipped.truth(take)["tcp_eye"]["p_m"] for take in ("replay.none.m1.r1", "replay.two.m1.r1")
    )
    moved = float(np.linalg.norm(np.subtract(first, pushed)))
    assert moved > 0.01
    rows = slipped.find("ape.translation.aligned", case="replay", condition="two", mount="1", **EYE)
    rows = [row for row in rows if row.repeat != "all"]
    assert rows
    for row in rows:
        assert "between calibrate.default.m1.r1 and check.two.m1.r1" in row.reason
        assert row.status in ("ok", "unbracketed", "extrapolated")
    # at the tcp, X that is centimetres off would make the error some millimetres larger
    base, two = (
        slipped.one("ape.translation.aligned", condition=c, repeat="1", case="replay", **TCP)
        for c in ("none", "two")
    )
    assert two.value < 3.0 * base.value


TCP = {"point": "tcp", "statistic": "rmse"}


# long loop


def loop_rows(run: Run, metric: str, **wanted: str) -> list[Row]:
    rows = [row for row in run.find(metric, case="loop", **wanted) if row.segment != "all"]
    return sorted(rows, key=lambda row: int(row.segment.removeprefix("loop:")))


def test_with_a_drifting_clock_alone_the_error_does_not_grow(loops):
    rows = loop_rows(loops, "ape.translation.aligned", **EYE)
    assert len(rows) == 20
    first, last = rows[0], rows[-1]
    assert first.ci_low < last.value < first.ci_high or last.ci_low < first.value < last.ci_high
    both = loops.one("ape.translation.aligned", point="eye", statistic="last-first")
    assert both.ci_low < 0.0 < both.ci_high
    slope = loops.one("ape.translation.aligned", point="eye", statistic="slope", case="loop")
    assert slope.ci_low < 0.0 < slope.ci_high


def test_the_offset_of_every_loop_is_the_true_one(loops):
    from vrbench.devices.simulated.headset import WANDER_S

    true = loops.truth("loop.default.m1.r1")
    take = next(t for t in loops.bundle.record.takes if t.case == "loop")
    events = [e for e in loops.bundle.columns(take).events if e.kind == "loop"]
    rows = loop_rows(loops, "clock.offset", statistic="value")
    off = []
    for row, start, end in zip(rows, events[::2], events[1::2], strict=True):
        since = ((start.t + end.t) / 2 - true["clock_epoch_ns"]) / 1e9
        swing = np.sin(np.pi * since / WANDER_S) ** 2 * WANDER_S / np.pi
        gained = 1e-3 * (true["clock_skew_ppm"] * since + true["clock_wander_ppm"] * swing)
        off.append(row.value - 1e3 * true["clock_offset_s"] - gained)
        assert row.ci_low < row.value < row.ci_high
    assert loops.truth("loop.default.m1.r1")["clock_skew_ppm"] == 80.0
    assert np.abs(off).max() < 1.5  # of 65 ms that the clock has gained by the end


def test_a_world_that_stands_still_has_no_drift(loops):
    for metric in ("drift.translation", "drift.tilt"):
        assert loops.one(metric, case="loop", statistic="slope").ci_low == 0.0
    yaw = loops.one("drift.yaw", case="loop", statistic="slope")
    assert yaw.ci_low < 0.0 < yaw.ci_high
    assert loops.one("drift.translation", case="loop", statistic="max").value < 2.5


def test_the_drift_of_every_loop_is_the_worlds(drifting):
    true = drifting.truth("loop.default.m1.r1")
    yaw = loop_rows(drifting, "drift.yaw", statistic="value")
    shift = loop_rows(drifting, "drift.translation", statistic="value")
    assert [row.segment for row in yaw] == ["loop:1", "loop:2", "loop:3"]
    take = next(t for t in drifting.bundle.record.takes if t.case == "loop")
    starts = [e.t for e in drifting.bundle.columns(take).events if e.kind == "loop"][::2]
    apart = (starts[2] - starts[0]) / 1e9
    # the estimate turns with the drift: its frame turns back, and yaw about up has that sign
    turned = -np.degrees(true["drift_yaw_rad_per_s"] * apart)
    assert yaw[2].value == pytest.approx(turned, abs=0.15)
    along = np.linalg.norm(true["drift_m_per_s"]) * 1e3 * apart
    assert shift[2].value == pytest.approx(along, rel=0.35)
    assert (
        drifting.one("drift.translation", case="loop", statistic="last-first").value
        == shift[2].value
    )


def test_gaps_and_the_opening_are_not_scored(loops):
    take = next(t for t in loops.bundle.record.takes if t.case == "loop")
    columns = loops.bundle.columns(take)
    spans = [e.t for e in columns.events if e.kind == "loop"]
    moving = sum(b - a for a, b in zip(spans[::2], spans[1::2], strict=True)) / 1e9
    scored = loops.one("ape.translation.aligned", case="loop", segment="all", **EYE)
    assert scored.samples / 72.0 == pytest.approx(moving, rel=0.01)
    every = len(columns.poses["headset/eye"]) / 72.0
    assert every > moving + 30.0


# two references


def test_motion_capture_sees_the_vibration_that_the_encoders_cannot(drifting):
    rows = drifting.find("references.translation", case="loop", band=">2Hz", statistic="rmse")
    white = np.sqrt(3) * 1e-4  # of the simulated cameras
    assert rows[0].value == pytest.approx(1e3 * np.hypot(3e-4, white), rel=0.1)
    slow = drifting.find("references.translation", case="loop", band="<2Hz", statistic="rmse")
    assert slow[0].value < 0.06
    offset = drifting.find("references.offset", case="loop")[0]
    assert abs(offset.value) < 0.1  # both are on the host's clock
    both = {row.reference for row in drifting.rows if row.metric == "ape.translation.aligned"}
    assert both == {"robot", "mocap"}


# relocalisation, and rest


def test_what_relocalisation_leaves_behind_is_found(found):
    true = found.truth("lose.default.m1.r1")
    jump = 1e3 * np.linalg.norm(true["relocated_m"][0])
    assert found.one("recovery.offset", case="lose", **EYE).value == pytest.approx(jump, rel=0.2)
    again = found.one("recovery.found", case="lose", **EYE)
    assert again.value == pytest.approx(1.2, abs=0.1)  # relocalisation_s of the profile
    assert found.one("recovery.time", case="lose", point="eye").reason.startswith("1 of 1 losses")


def test_rests_that_the_suite_asks_for_are_scored(found):
    jitter = found.one("jitter.position", case="lose", **EYE)
    # of three rests of 6 s, one is blind
    assert jitter.samples / 72.0 > 10.0
