"""The decoder on real packets, field by field against what independent clients decode."""

import json
import re

import pytest
from vrbench_optitrack.bodies import decode_bodies
from vrbench_optitrack.encode import encode_frame, encode_models
from vrbench_optitrack.frame import VALID
from vrbench_optitrack.frames import decode_frame
from vrbench_optitrack.handshake import (
    decode_echo_request,
    decode_echo_response,
    decode_greeting,
    decode_serverinfo,
    encode_serverinfo,
)
from vrbench_optitrack.models import BodyModel, MarkerSetModel, decode_models
from vrbench_optitrack.wire import NatNetError, message_of

V3 = (3, 0)
OLD = {"1.5.0": (2, 5), "1.7.2": (2, 7)}
MADE = [(3, 1), (4, 0), (4, 1), (4, 2)]


@pytest.fixture(scope="module")
def natnet(shared):
    return shared / "natnet"


def expected(natnet, name):
    return json.loads((natnet / "expected" / f"{name}.json").read_text(encoding="utf-8"))["value"]


def real(natnet, name):
    return (natnet / "mje-nz" / f"{name}.bin").read_bytes()


def triples(rows):
    return [tuple(row) for row in rows]


def test_a_frame_of_3_0(natnet):
    frame = decode_frame(real(natnet, "mocapframe_packet_v3"), V3)
    want = expected(natnet, "mocapframe_packet_v3")
    assert frame.number == want["frame_number"]
    for body, x in zip(frame.bodies, want["rigid_bodies"], strict=True):
        assert (body.id, body.params, body.mean_error) == (x["id_"], x["_params"], x["mean_error"])
        assert (body.position, body.orientation) == (tuple(x["position"]), tuple(x["orientation"]))
    for marker, x in zip(frame.labeled_markers, want["labelled_markers"], strict=True):
        assert divmod(marker.id, 1 << 16) == (x["model_id"], x["marker_id"])
        assert marker.position == tuple(x["position"])
        got = (marker.size, marker.params, marker.residual)
        assert got == (x["size"], x["_params"], x["residual"])
    times = want["timing_info"]
    suffix = frame.suffix
    assert suffix.timestamp == times["timestamp"]
    assert suffix.mid_exposure == times["camera_mid_exposure_timestamp"]
    assert suffix.data_received == times["camera_data_received_timestamp"]
    assert suffix.transmit == times["transmit_timestamp"]
    assert (suffix.timecode, suffix.timecode_sub, suffix.params) == (0, 0, want["_params"])
    assert not (frame.marker_sets or frame.skeletons or frame.force_plates or frame.devices)


def test_model_definitions_of_3_0(natnet):
    models = decode_models(real(natnet, "modeldef_packet_v3"), V3)
    for model, x in zip(models, expected(natnet, "modeldef_packet_v3")["models"], strict=True):
        assert model.name == x["name"]
        if isinstance(model, MarkerSetModel):
            assert list(model.markers) == x["marker_names"]
            continue
        assert isinstance(model, BodyModel)
        assert (model.id, model.parent) == (x["id_"], x["parent_id"])
        assert model.offset == tuple(x["offset_from_parent"])
        assert list(model.markers) == triples(x["marker_positions"])
        assert list(model.labels) == x["required_active_labels"]


def test_the_handshake_of_3_0(natnet):
    packet = real(natnet, "serverinfo_packet_v3")
    info, want = decode_serverinfo(packet), expected(natnet, "serverinfo_packet_v3")
    assert info.application == want["app_name"]
    assert list(info.application_version) == want["app_version"]
    assert list(info.natnet_version) == want["natnet_version"]
    assert info.frequency == want["high_resolution_clock_frequency"]
    assert info.data_port == want["connection_info"]["data_port"]
    assert info.multicast == want["connection_info"]["multicast"]
    assert info.group == want["connection_info"]["multicast_address"]
    # behind the name's NUL stands what happened to be in the sender's memory
    assert decode_serverinfo(encode_serverinfo(info)) == info
    for name in ("connect_packet_v3", "discovery_packet_v3"):
        greeting, want = decode_greeting(real(natnet, name)), expected(natnet, name)
        assert greeting.name == want["payload"]
        assert [list(greeting.version), list(greeting.natnet)] == [
            want["version1"],
            want["version2"],
        ]
    stamp = expected(natnet, "echorequest_packet_v3")["timestamp"]
    assert decode_echo_request(real(natnet, "echorequest_packet_v3")) == stamp
    want = expected(natnet, "echoresponse_packet_v3")
    both = want["request_timestamp"], want["received_timestamp"]
    assert decode_echo_response(real(natnet, "echoresponse_packet_v3")) == both


@pytest.mark.parametrize("number", ["001", "002"])
@pytest.mark.parametrize("motive", OLD)
def test_frames_of_2_x(natnet, motive, number):
    version = OLD[motive]
    name = f"frame-motive-{motive}-{number}"
    frame = decode_frame((natnet / "nordmoen" / f"{name}.bin").read_bytes(), version)
    want = expected(natnet, name)
    assert frame.number == want["frameno"]
    sets = {markers.name: markers.positions for markers in frame.marker_sets}
    assert sets == {key: triples(rows) for key, rows in want["sets"].items()}
    assert frame.other_markers == triples(want["other_markers"])
    for body, x in zip(frame.bodies, want["rigid_bodies"], strict=True):
        assert (body.id, body.position) == (x["id"], tuple(x["position"]))
        assert body.orientation == tuple(x["orientation"])
        assert [m.position for m in body.markers] == triples(x["markers"])
        assert [m.id for m in body.markers] == x["mrk_ids"]
        assert [m.size for m in body.markers] == x["mrk_sizes"]
        assert body.mean_error == x["mrk_mean_error"]
        if version >= (2, 6):
            assert bool(body.params & VALID) == x["tracking_valid"]
    for marker, x in zip(frame.labeled_markers, want["labeled_markers"], strict=True):
        assert (marker.id, marker.size) == (x["id"], x["size"])
        assert marker.position == tuple(x["position"])
        if version >= (2, 6):
            bits = marker.params & 1, marker.params >> 1 & 1, marker.params >> 2 & 1
            assert bits == (x["occluded"], x["point_cloud_solved"], x["model_solved"])
    assert frame.suffix.latency == want["latency"]


@pytest.mark.parametrize("motive", OLD)
def test_servers_of_2_x(natnet, motive):
    name = f"frame-motive-{motive}-000"
    info = decode_serverinfo((natnet / "nordmoen" / f"{name}.bin").read_bytes())
    want = expected(natnet, name)
    assert (info.application, info.version) == (want["appname"], OLD[motive])
    assert list(info.application_version) == want["version"]
    assert (info.frequency, info.multicast) == (0, None)


@pytest.mark.parametrize("version", MADE, ids=lambda v: f"{v[0]}.{v[1]}")
def test_frames_of_later_versions(natnet, version):
    stem = natnet / "made" / f"frame_{version[0]}.{version[1]}"
    frame = decode_frame(stem.with_suffix(f"{stem.suffix}.bin").read_bytes(), version)
    said = stem.with_suffix(f"{stem.suffix}.packetclient41.txt").read_text(encoding="utf-8")
    assert f"Frame #:   {frame.number}\n" in said
    ids = [int(x) for x in re.findall(r"RB:\s+\d+ ID :\s+(\d+)", said)]
    assert [body.id for body in frame.bodies] == ids
    tracked = [x == "True" for x in re.findall(r"Tracking Valid: (\w+)", said)]
    assert [bool(body.params & VALID) for body in frame.bodies] == tracked
    places = re.findall(r"Position    : \[([^]]*)\]", said)
    assert [", ".join(f"{x:.2f}" for x in body.position) for body in frame.bodies] == places
    turns = re.findall(r"Orientation : \[([^]]*)\]", said)
    assert [", ".join(f"{x:.2f}" for x in body.orientation) for body in frame.bodies] == turns
    markers = re.findall(r"\[MarkerID: (\d+)\] \[ModelID: (\d+)\]", said)
    got = [(str(m.id & 0xFFFF), str(m.id >> 16)) for m in frame.labeled_markers]
    assert got == markers
    # the sample prints the residual in thousandths
    residuals = [float(x) / 1e3 for x in re.findall(r"err:\s+\[([^]]*)\]", said)]
    assert [m.residual for m in frame.labeled_markers] == pytest.approx(residuals)
    ticks = {
        "Mid-exposure": frame.suffix.mid_exposure,
        "Camera data received": frame.suffix.data_received,
        "Transmit": frame.suffix.transmit,
    }
    for what, value in ticks.items():
        assert re.search(rf"{what} timestamp\s*: {value}\n", said)
    assert f"Timestamp : {frame.suffix.timestamp:.3f}\n" in said
    if version >= (4, 1):
        assert f"Precision timestamp seconds : {frame.suffix.ptp_seconds}\n" in said
        fraction = int(re.search(r"fractional seconds : (-?\d+)", said)[1])
        assert frame.suffix.ptp_fraction == fraction % 2**32


@pytest.mark.parametrize("version", MADE, ids=lambda v: f"{v[0]}.{v[1]}")
def test_model_definitions_of_later_versions(natnet, version):
    stem = natnet / "made" / f"modeldef_{version[0]}.{version[1]}"
    models = decode_models(stem.with_suffix(f"{stem.suffix}.bin").read_bytes(), version)
    assert [(type(m).__name__, m.name) for m in models] == [
        ("BodyModel", "HMD"),
        ("MarkerSetModel", "HMD"),
        ("BodyModel", "Ctrl_é"),
        ("MarkerSetModel", "Ctrl_é"),
    ]
    assert [(m.id, len(m.markers)) for m in (models[0], models[2])] == [(2, 3), (7, 4)]
    assert models[0].marker_names == (("Marker1", "Marker2", "Marker3") if version[0] > 3 else ())


def packets(natnet):
    """Every real or made frame and model definition, with its version."""
    for path in sorted(natnet.glob("*/*.bin")):
        raw = path.read_bytes()
        old = next((v for motive, v in OLD.items() if motive in path.name), V3)
        made = re.search(r"_(\d)\.(\d)$", path.stem)
        version = (int(made[1]), int(made[2])) if made else old
        if message_of(raw) in (5, 7):
            yield path.name, raw, version


def test_the_encoder_writes_every_packet_again_byte_for_byte(natnet):
    for name, raw, version in packets(natnet):
        if message_of(raw) == 7:
            assert encode_frame(decode_frame(raw, version), version) == raw, name
        else:
            assert encode_models(decode_models(raw, version), version) == raw, name


def test_the_quick_path_agrees_with_the_whole_frame(natnet):
    for name, raw, version in packets(natnet):
        if message_of(raw) == 7:
            frame, quick = decode_frame(raw, version), decode_bodies(raw, version)
            assert (quick.number, quick.suffix) == (frame.number, frame.suffix), name
            whole = [
                (b.id, *b.position, *b.orientation, b.mean_error, b.params) for b in frame.bodies
            ]
            assert quick.bodies == whole, name


def test_a_packet_one_byte_short_or_long_is_refused(natnet):
    for _, raw, version in packets(natnet):
        decoders = (decode_frame, decode_bodies) if message_of(raw) == 7 else (decode_models,)
        for decode in decoders:
            for spoilt in (raw[:-1], raw + b"\0"):
                with pytest.raises(NatNetError):
                    decode(spoilt, version)
                mended = spoilt[:2] + (len(spoilt) - 4).to_bytes(2, "little") + spoilt[4:]
                with pytest.raises(NatNetError):
                    decode(mended, version)
