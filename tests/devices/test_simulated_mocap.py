import numpy as np
import pytest

from vrbench.clocks import fit_exchanges
from vrbench.config.rig import load_rig
from vrbench.config.suite import load_suite
from vrbench.devices.ports import Session
from vrbench.devices.simulated.mocap import MOCAP, Options, SimulatedMocap
from vrbench.devices.simulated.stage import Stage, VirtualClock
from vrbench.geometry import Transform, relative_angle, rotvec_to_quat
from vrbench.plugin.manager import Plugins
from vrbench.runner import record_suite
from vrbench.streams import Samples
from vrbench.trajectory import NS, Trajectory


@pytest.fixture
def session():
    stage, host = Stage(), VirtualClock()
    s = np.arange(0, 60, 0.05)
    swing = np.stack((0.2 * np.sin(s), 0.1 * np.cos(s), 0.05 * s), axis=1)
    stage.move(
        Trajectory(
            host.now() + np.rint(s * NS).astype(np.int64),
            Transform(swing, rotvec_to_quat(0.5 * swing)),
        )
    )
    return Session(host, Transform.identity(), 7, stage)


def recorded(session, *steps_s, **options):
    """Samples and exchanges of one take, read at these steps."""
    source = SimulatedMocap(Options(**options), session)
    parts = []
    with source:
        source.start("take")
        for step in steps_s:
            session.host.wait(step)
            parts.append(source.read())
        source.stop()
    return (
        Samples.concatenate([part.poses["mocap/body"] for part in parts]),
        type(parts[0].clocks["mocap"]).concatenate([part.clocks["mocap"] for part in parts]),
    )


def transform(content):
    return Transform.of(content["p_m"], content["q_xyzw"])


def test_the_body_rides_on_the_flange(session):
    samples, _ = recorded(session, 10.0, noise_m=0.0, noise_rad=0.0, lost_per_minute=0.0)
    truth = session.stage.truth["mocap"]
    body = transform(truth["mocap_base"]) @ session.stage.tcp(samples.pose_t)
    body = body @ transform(truth["tcp_body"])
    np.testing.assert_allclose(samples.pose.p, body.p, atol=1e-12)
    assert relative_angle(samples.pose.q, body.q).max() < 1e-9
    assert len(samples) == 2400
    assert samples.good.all()


def test_noise_is_as_asked_for_and_the_same_however_often_it_is_read(session):
    exact, _ = recorded(session, 10.0, noise_m=0.0, noise_rad=0.0)
    begin = session.host.now()
    session.host._now = begin - 10 * NS
    noisy, _ = recorded(session, 10.0)
    session.host._now = begin - 10 * NS
    again, _ = recorded(session, 0.5, 7.25, 2.25)
    assert np.std(noisy.pose.p - exact.pose.p) == pytest.approx(1e-4, rel=0.05)
    np.testing.assert_array_equal(noisy.pose.p, again.pose.p)
    np.testing.assert_array_equal(noisy.flags, again.flags)


def test_a_lost_body_is_invalid(session):
    samples, _ = recorded(session, 40.0, lost_per_minute=20.0, lost_s=0.5)
    lost = 1.0 - samples.good.mean()
    assert 0.05 < lost < 0.35
    assert not samples.flags[~samples.good].any()


def test_its_clock_can_be_had_from_the_exchanges(session):
    samples, exchanges = recorded(session, 50.0, clock_offset_s=3.25, clock_skew_ppm=40.0)
    fit = fit_exchanges(exchanges, skew_after_s=10.0)
    there = fit.clock.to_reference(samples.source_t)
    assert np.abs(there - samples.pose_t).max() < 100_000
    assert np.all(samples.receive_t > samples.pose_t)


class Quiet:
    def take(self, name, index, total):
        pass

    def moving(self, progress):
        pass

    def notice(self, text):
        pass


SUITE = """
suite: small
version: 1
title: small
references: [robot, mocap]
motions: {calibration: saturate-30s-1}
cases: [{id: calibrate, motion: calibration, role: calibration}]
metrics: [handeye]
rank: {metric: ape.translation.aligned}
"""
RIG = """
lab: simulated
headset: {plugin: sim, device: sim}
robot: {plugin: sim}
mocap: {plugin: sim, options: {body: head}}
"""


def test_a_rig_with_simulated_mocap_has_two_references(tmp_path):
    suite, rig = tmp_path / "small.yaml", tmp_path / "rig.yaml"
    suite.write_text(SUITE)
    rig.write_text(RIG)
    bundle = record_suite(
        load_suite(str(suite)),
        load_rig(str(rig)),
        str(rig),
        tmp_path / "run",
        Plugins(),
        seed=3,
        watcher=Quiet(),
    )
    assert bundle.record.references == ["robot", "mocap"]
    columns = bundle.columns(bundle.record.takes[0])
    assert len(columns.poses["mocap/head"]) == pytest.approx(240 * 33, rel=0.02)
    assert len(columns.clocks["mocap"]) == pytest.approx(4 * 33, rel=0.1)
    assert MOCAP.check is None
