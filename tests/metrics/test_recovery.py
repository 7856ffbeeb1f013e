import numpy as np
import pytest

from vrbench.devices.simulated.noise import correlated
from vrbench.geometry import Transform
from vrbench.metrics import recovery


def lost(s):
    return (s < 8.0) | (s > 9.0)


def test_recovery_takes_the_loss_and_the_time_until_the_error_is_gone(values, make_take):
    def spoil(s, pose):
        off = ((s > 9) & (s < 11)) * 0.02
        return Transform(pose.p + np.outer(off, [1, 0, 0]), pose.q)

    found = values(recovery.FAMILY, make_take(keep=lost, spoil=spoil))
    assert found["recovery.time", "eye", "all", "max"].value == pytest.approx(3.0, abs=0.03)
    assert found["recovery.offset", "eye", "all", "max"].value == pytest.approx(20, abs=0.01)
    assert found["recovery.offset", "eye", "all", "max"].samples == 1


@pytest.mark.parametrize("name", ["BEFORE_S", "RECOVERED_M", "HELD_S"])
def test_the_time_does_not_hang_on_where_the_lines_were_drawn(values, make_take, monkeypatch, name):
    """A headset with ordinary noise is lost at 8 s, and jumps back into place at 11 s."""
    wander = correlated(np.random.default_rng(4), 0.0007, 2.0, 3)

    def spoil(s, pose):
        off = np.outer(((s > 9) & (s < 11)) * 0.03, [1, 0, 0])
        return Transform(pose.p + off + wander(s), pose.q)

    taken, usual = make_take(keep=lost, spoil=spoil), getattr(recovery, name)
    for factor in (0.5, 1.0, 2.0):
        monkeypatch.setattr(recovery, name, factor * usual)
        found = values(recovery.FAMILY, taken)["recovery.time", "eye", "all", "max"]
        assert found.value == pytest.approx(3.0, abs=0.03), factor


def test_an_offset_that_stays_never_recovers(values, make_take):
    def spoil(s, pose):
        return Transform(pose.p + np.outer((s > 8.5) * 0.02, [1, 0, 0]), pose.q)

    found = values(recovery.FAMILY, make_take(keep=lost, spoil=spoil))
    assert "1 of 1 losses never" in found["recovery.time", "eye", "all", "max"].reason
    assert found["recovery.offset", "eye", "all", "mean"].value == pytest.approx(20, abs=0.01)


def test_without_a_loss_there_is_nothing_to_recover_from(values, make_take):
    found = values(recovery.FAMILY, make_take())
    assert "never lost" in found["recovery.time", "eye", "all", "max"].reason
