"""The curves of a take agree with its numbers, however they are thinned."""

import json
from base64 import b64decode
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vrbench.errors import ConfigError, DataError
from vrbench.exporting import ready
from vrbench.protocols.vrbench_1 import PROTOCOL
from vrbench.results.bundle import Bundle
from vrbench.results.plot_curves import take_curves
from vrbench.results.plot_data import (
    BINS_OF_RUN,
    BINS_OF_TAKE,
    LARGEST_FILE,
    MISSING,
    Packed,
    bins_for,
    curves_file,
    parse_curves,
    write_curves,
)
from vrbench.results.spectrum import spectrum
from vrbench.results.tables import read_rows
from vrbench.streams import Event
from vrbench.trajectory import NS

CURVES = curves_file("vrbench-1")


def unpacked(column):
    codes = np.frombuffer(b64decode(column.data), dtype="<u2")
    values = column.lo + codes / (MISSING - 1) * (column.hi - column.lo)
    return np.where(codes == MISSING, np.nan, values)


def curves_of(run):
    return parse_curves(Bundle.open(run).content(CURVES), run / CURVES)


def number(run, take, metric, point, statistic):
    (row,) = [
        row
        for row in read_rows(run / "metrics/vrbench-1.csv")
        if (row.case, row.mount, row.repeat) == (take.case, str(take.mount), str(take.repeat))
        and (row.metric, row.point, row.statistic) == (metric, point, statistic)
        and (row.variant, row.band, row.segment) == ("main", "all", "all")
    ]
    return row.value


@given(st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), min_size=1, max_size=50))
def test_a_column_keeps_its_values_to_sixteen_bits(values):
    values = np.array(values)
    column = Packed.of(values)
    known = np.isfinite(values)
    back = unpacked(column)
    assert np.array_equal(np.isfinite(back), known)
    step = (column.hi - column.lo) / (MISSING - 1)
    assert np.all(np.abs(back[known] - values[known]) <= 0.51 * step + 1e-9)


def test_every_take_has_curves_and_they_are_the_metrics_own(run):
    found = curves_of(run)
    assert [take.take for take in found.takes] == [t.name for t in Bundle.open(run).record.takes]
    for take in found.takes:
        for name, metric, point in (
            ("eye", "ape.translation.aligned", "eye"),
            ("tcp", "ape.translation.aligned", "tcp"),
            ("rotation", "ape.rotation.aligned", "eye"),
        ):
            error = take.errors[name]
            assert error.quantiles[-1] == pytest.approx(
                number(run, take, metric, point, "max"), rel=1e-4
            )
            assert error.quantiles[50] == pytest.approx(
                number(run, take, metric, point, "median"), rel=1e-4
            )
            assert np.nanmax(unpacked(error.max)) == pytest.approx(error.quantiles[-1], rel=1e-3)
            # bins hold nearly equally many samples
            rmse = np.sqrt(np.nanmean(unpacked(error.rms) ** 2))
            assert rmse == pytest.approx(number(run, take, metric, point, "rmse"), rel=0.01)


def test_what_is_missing_is_what_coverage_lacks(run):
    for take in curves_of(run).takes:
        missing_s = sum(end - start for start, end in take.missing)
        valid = number(run, take, "coverage.valid", "", "value")
        lacking_s = (1 - valid / 100) * take.duration_s
        # coverage credits each gap with one period
        assert missing_s == pytest.approx(lacking_s + len(take.missing) / 72, abs=0.02)


def test_the_path_is_the_true_one(run):
    bundle = Bundle.open(run)
    part = next(p for p in ready(bundle, PROTOCOL, lambda *_: None, pytest.fail))
    take = curves_of(run).takes[0]
    eye = (part.scored.truth @ part.scored.x).p
    assert take.point == "eye"
    for column, axis in zip(take.truth, eye.T, strict=True):
        assert column.lo >= axis.min() - 1e-9
        assert column.hi <= axis.max() + 1e-9
    length = np.linalg.norm(np.diff(eye, axis=0), axis=1).sum()
    assert take.travelled.hi == pytest.approx(length, rel=0.01)


def sine(hz, seconds, rate=72.0, amplitude=2.0):
    t = np.arange(0, seconds, 1 / rate)
    error = np.zeros((len(t), 3))
    error[:, 1] = amplitude * np.sin(2 * np.pi * hz * t)
    return np.rint(t * NS).astype(np.int64), error


def test_a_sine_stands_at_its_frequency():
    found = spectrum(*sine(5.0, 120.0))
    assert found.hz[int(np.argmax(found.density))] == pytest.approx(5.0, rel=0.05)


def test_the_spectrum_holds_the_power_of_white_noise():
    rng = np.random.default_rng(1)
    t, error = sine(5.0, 300.0, amplitude=0.0)
    error += rng.normal(0.0, 1.5, error.shape)
    found = spectrum(t, error)
    # three axes, from 0 Hz to half the rate
    expected = np.sqrt(3 * 1.5**2 / 36.0)
    assert np.median(found.density) == pytest.approx(expected, rel=0.1)


def test_a_take_of_a_second_has_no_spectrum():
    assert spectrum(*sine(5.0, 1.0)) is None
    assert spectrum(np.zeros(0, dtype=np.int64), np.zeros((0, 3))) is None


@pytest.mark.parametrize("behind_ns", [0, 4000 * NS])
def test_first_and_last_loop_are_told_from_events(run, behind_ns):
    """Also where the reference has a clock of its own, far from the recorder's."""
    bundle = Bundle.open(run)
    part = next(p for p in ready(bundle, PROTOCOL, lambda *_: None, pytest.fail)).scored
    start = int(part.reference.t[0])
    events = [
        Event(start + round(s * NS) - behind_ns, "loop", {"number": k, "at": at})
        for k in (1, 2, 3)
        for s, at in ((8.0 * k - 7.0, "start"), (8.0 * k, "end"))
    ]
    events.append(Event(start + 8 * NS - behind_ns, "gap", {"at": "start"}))
    columns = replace(part.columns, events=events)
    looped = replace(part, columns=columns, recorder_behind_ns=behind_ns)
    record = bundle.record.takes[0]
    curves = take_curves(record, looped, {"all": looped}, "robot", 500)
    assert [loop.name for loop in curves.loops] == ["loop 1", "loop 3"]
    assert [loop.duration_s for loop in curves.loops] == pytest.approx([7.0, 7.0])
    assert all(np.isfinite(unpacked(axis)).mean() > 0.9 for axis in curves.loops[0].axes)
    assert [(mark.t, mark.kind) for mark in curves.marks] == [(8.0, "way back")]
    assert take_curves(record, part, {"all": part}, "robot", 500).loops == []


def test_a_take_without_x_has_a_path_and_no_errors(run):
    part = next(p for p in ready(Bundle.open(run), PROTOCOL, lambda *_: None, pytest.fail)).scored
    bare = replace(part, x=None)
    curves = take_curves(Bundle.open(run).record.takes[0], bare, {"all": bare}, "robot", 500)
    assert curves.point == "tcp"
    assert curves.errors == {}
    assert curves.spectrum is None


def test_bins_are_shared_among_takes():
    assert bins_for(1) == BINS_OF_TAKE
    assert 50 * bins_for(50) <= BINS_OF_RUN


def test_takes_beyond_the_room_are_left_out_and_counted(run, tmp_path):
    takes = curves_of(run).takes
    write_curves([takes[0]] * 230, "vrbench-1", tmp_path / "many.json")
    found = parse_curves((tmp_path / "many.json").read_bytes(), tmp_path)
    assert (len(found.takes), found.left_out) == (200, 30)


def test_what_is_no_file_of_curves_is_refused(run, tmp_path):
    with pytest.raises(DataError, match="JSON"):
        parse_curves(b"{", tmp_path)
    with pytest.raises(DataError, match="bytes"):
        parse_curves(b" " * (LARGEST_FILE + 1), tmp_path)
    content = json.loads((run / CURVES).read_bytes())
    content["takes"][0]["speed"]["data"] = "<script>"
    with pytest.raises(ConfigError, match="data"):
        parse_curves(json.dumps(content).encode(), tmp_path)
