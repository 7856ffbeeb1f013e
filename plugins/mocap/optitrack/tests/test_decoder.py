"""The decoder on packets made here: what the encoder writes, and whatever else arrives."""

import struct
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from vrbench_optitrack.bodies import decode_bodies
from vrbench_optitrack.encode import encode_frame, encode_models
from vrbench_optitrack.frame import (
    UNSAID,
    Asset,
    BodyMarker,
    Channels,
    Frame,
    LabeledMarker,
    MarkerSet,
    RigidBody,
    Skeleton,
    Suffix,
)
from vrbench_optitrack.frames import decode_frame
from vrbench_optitrack.handshake import (
    Greeting,
    ServerInfo,
    decode_echo_request,
    decode_echo_response,
    decode_greeting,
    decode_number,
    decode_request,
    decode_serverinfo,
    decode_words,
    encode_echo_request,
    encode_echo_response,
    encode_greeting,
    encode_request,
    encode_serverinfo,
)
from vrbench_optitrack.models import (
    AssetMarkerModel,
    AssetModel,
    BodyModel,
    CameraModel,
    DeviceModel,
    MarkerSetModel,
    PlateModel,
    SkeletonModel,
    UnknownModel,
    bodies_of,
    decode_models,
)
from vrbench_optitrack.wire import Message, NatNetError, message_of, packed

from vrbench.errors import VrbenchError

VERSIONS = [(2, 5), (2, 6), (2, 7), (2, 9), (2, 10), (3, 0), (3, 1), (4, 0), (4, 1), (4, 2)]
FRAME_DECODERS = (decode_frame, decode_bodies)

f32 = st.floats(width=32, allow_nan=False)
i32 = st.integers(-(2**31), 2**31 - 1)
u64 = st.integers(0, 2**64 - 1)
i16 = st.integers(-(2**15), 2**15 - 1)
u32 = st.integers(0, 2**32 - 1)
texts = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=8)
vectors = st.tuples(f32, f32, f32)
quaternions = st.tuples(f32, f32, f32, f32)


def few(strategy):
    return st.lists(strategy, max_size=3)


@st.composite
def frames(draw, version):
    """Frames that hold all that the version has a place for, and no more."""
    new, params = version >= (3, 0), version >= (2, 6)
    sized = version >= (4, 1)
    carried = st.just(()) if new else st.tuples(*[st.builds(BodyMarker, vectors, i32, f32)] * 2)
    body_params = i16 if params else st.just(UNSAID)
    bodies = st.builds(RigidBody, i32, vectors, quaternions, f32, body_params, carried)
    markers = st.builds(
        LabeledMarker,
        i32,
        vectors,
        f32,
        i16 if params else st.just(0),
        f32 if new else st.just(0.0),
    )
    channels = st.builds(Channels, i32, few(few(f32).map(tuple)))
    zero = st.just(0)
    stamp = (f32 if version < (2, 7) else st.floats(allow_nan=False)) if params else st.just(0.0)
    suffix = st.builds(
        Suffix,
        timecode=u32,
        timecode_sub=u32,
        timestamp=stamp,
        latency=st.just(0.0) if new else f32,
        mid_exposure=u64 if new else zero,
        data_received=u64 if new else zero,
        transmit=u64 if new else zero,
        ptp_seconds=u32 if sized else zero,
        ptp_fraction=u32 if sized else zero,
        params=i16 if params else zero,
    )
    return Frame(
        number=draw(i32),
        marker_sets=draw(few(st.builds(MarkerSet, texts, few(vectors)))),
        other_markers=draw(few(vectors)),
        bodies=draw(few(bodies)),
        skeletons=draw(few(st.builds(Skeleton, i32, few(bodies)))),
        assets=draw(few(st.builds(Asset, i32, few(bodies), few(markers)))) if sized else [],
        labeled_markers=draw(few(markers)),
        force_plates=draw(few(channels)) if version >= (2, 9) else [],
        devices=draw(few(channels)) if new else [],
        suffix=draw(suffix),
    )


@settings(max_examples=60)
@given(st.sampled_from(VERSIONS).flatmap(lambda v: st.tuples(st.just(v), frames(v))))
def test_every_field_comes_back_in_every_version(case):
    version, frame = case
    packet = encode_frame(frame, version)
    assert decode_frame(packet, version) == frame
    quick = decode_bodies(packet, version)
    assert (quick.number, quick.suffix) == (frame.number, frame.suffix)
    assert [row[0] for row in quick.bodies] == [body.id for body in frame.bodies]
    assert [row[1:4] for row in quick.bodies] == [body.position for body in frame.bodies]
    assert [row[-1] for row in quick.bodies] == [body.params for body in frame.bodies]


def models_of(version):
    named = texts if version >= (4, 0) else st.nothing()

    @st.composite
    def body(draw):
        n = draw(st.integers(0, 3)) if version >= (3, 0) else 0
        return BodyModel(
            draw(texts),
            draw(i32),
            draw(i32),
            draw(vectors),
            draw(quaternions) if version >= (4, 2) else (0.0, 0.0, 0.0, 1.0),
            tuple(draw(vectors) for _ in range(n)),
            tuple(draw(i32) for _ in range(n)),
            tuple(draw(named) for _ in range(n)) if version >= (4, 0) else (),
        )

    names = few(texts).map(tuple)
    marker = st.builds(AssetMarkerModel, texts, i32, vectors, f32, i16)
    numbers = st.integers(-5, 5).map(float)
    plate = st.builds(
        PlateModel,
        i32,
        texts,
        f32,
        f32,
        vectors,
        numbers.map(lambda x: (x,) * 144),
        numbers.map(lambda x: (x,) * 12),
        i32,
        i32,
        names,
    )
    kinds = [
        st.builds(MarkerSetModel, texts, names),
        body(),
        st.builds(SkeletonModel, texts, i32, few(body()).map(tuple)),
        plate,
        st.builds(DeviceModel, i32, texts, texts, i32, i32, names),
        st.builds(CameraModel, texts, vectors, quaternions),
        st.builds(AssetModel, texts, i32, i32, few(body()).map(tuple), few(marker).map(tuple)),
    ]
    if version >= (4, 1):
        kinds.append(st.builds(UnknownModel, st.integers(7, 99), st.binary(max_size=9)))
    return few(st.one_of(kinds))


@settings(max_examples=60)
@given(st.sampled_from(VERSIONS).flatmap(lambda v: st.tuples(st.just(v), models_of(v))))
def test_every_model_definition_comes_back_in_every_version(case):
    version, models = case
    assert decode_models(encode_models(models, version), version) == models


@st.composite
def damaged(draw):
    """A good packet with bytes altered, cut or added; its header mended or not."""
    version = draw(st.sampled_from(VERSIONS))
    if draw(st.booleans()):
        packet = encode_frame(draw(frames(version)), version)
    else:
        packet = encode_models(draw(models_of(version)), version)
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, len(packet) - 1))
        what = draw(st.sampled_from([b"\xff\xff\xff\x7f", b"\xff" * 4, b"\0" * 4, b"", b"x"]))
        packet = packet[:at] + what + packet[at + draw(st.integers(0, 4)) :]
        packet = packet or b"\0"
    if draw(st.booleans()) and len(packet) >= 4:
        packet = packet[:2] + struct.pack("<H", len(packet) - 4) + packet[4:]
    return packet, draw(st.sampled_from([version, *VERSIONS, (4, 3), (5, 0)]))


ANY = st.tuples(st.binary(max_size=400), st.sampled_from([*VERSIONS, (0, 0), (4, 3), (255, 255)]))


@given(st.one_of(ANY, damaged()))
def test_any_bytes_give_a_value_or_a_natnet_error(case):
    packet, version = case
    decoders = [
        *(lambda p, d=d: d(p, version) for d in (*FRAME_DECODERS, decode_models)),
        decode_serverinfo,
        decode_greeting,
        decode_echo_request,
        decode_echo_response,
        decode_request,
        decode_number,
        decode_words,
    ]
    for decode in decoders:
        try:
            decode(packet)
        except NatNetError as error:
            assert 0 <= error.offset <= len(packet)
            assert error.reason in str(error)


def empty(version, number=1, suffix=None):
    return Frame(number, [], [], [], [], [], [], [], [], suffix or Suffix(*[0] * 10))


@pytest.mark.parametrize("version", VERSIONS)
def test_every_frame_cut_short_or_made_longer_is_refused(version):
    body = RigidBody(1, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0), 0.1, 1)
    frame = Frame(
        7,
        [MarkerSet("all", [(1.0, 2.0, 3.0)])],
        [(0.0, 0.0, 0.0)],
        [body, body],
        [Skeleton(3, [body])],
        [],
        [LabeledMarker(1, (0.0, 0.0, 0.0), 0.01, 0, 0.0)],
        [],
        [],
        Suffix(*[0] * 10),
    )
    packet = encode_frame(frame, version)
    for n in [*range(4, len(packet)), len(packet) + 1]:
        cut = (packet + b"\0")[:n]
        cut = cut[:2] + struct.pack("<H", len(cut) - 4) + cut[4:]
        for decode in FRAME_DECODERS:
            with pytest.raises(NatNetError):
                decode(cut, version)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("count", [2**31 - 1, -1, 10_000_000])
def test_counts_that_the_packet_cannot_hold_cost_nothing(version, count):
    good = encode_frame(empty(version), version)
    places = range(8, len(good) - 3, 4)
    tracemalloc.start()
    try:
        for at in places:
            packet = good[:at] + struct.pack("<i", count) + good[at + 4 :]
            for decode in FRAME_DECODERS:
                try:
                    decode(packet, version)
                except NatNetError as error:
                    assert str(count) in error.reason or "bytes" in error.reason
        models = packed(Message.MODELDEF, struct.pack("<ii", count, 1) + bytes(60))
        with pytest.raises(NatNetError):
            decode_models(models, version)
        assert tracemalloc.get_traced_memory()[1] < 200_000
    finally:
        tracemalloc.stop()


def test_a_frame_read_in_a_neighbouring_version_is_refused_where_they_differ():
    body = RigidBody(1, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0), 0.1, 1)
    for written, read in [((4, 1), (4, 0)), ((4, 0), (4, 1)), ((2, 10), (3, 0)), ((3, 0), (2, 10))]:
        frame = Frame(5, [], [], [body], [], [], [], [], [], Suffix(*[0] * 10))
        packet = encode_frame(frame, written)
        for decode in FRAME_DECODERS:
            with pytest.raises(NatNetError):
                decode(packet, read)


def later(packet, section, extra):
    """A frame of 4.2 whose items of one section each have grown, as a later version's may."""
    at = 8
    for _ in range(section):
        at += 8 + struct.unpack_from("<i", packet, at + 4)[0]
    count, size = struct.unpack_from("<ii", packet, at)
    stride = size // count
    start = at + 8
    items = [packet[start + i * stride : start + (i + 1) * stride] + extra for i in range(count)]
    grown = struct.pack("<ii", count, size + count * len(extra)) + b"".join(items)
    out = packet[:at] + grown + packet[start + size :]
    return out[:2] + struct.pack("<H", len(out) - 4) + out[4:]


def test_a_later_version_is_read_by_the_sizes_of_its_sections():
    bodies = [RigidBody(i, (1.0 + i, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0), 0.5, 1) for i in range(3)]
    markers = [LabeledMarker(i, (1.0, 2.0, float(i)), 0.5, 1, 0.25) for i in range(2)]
    suffix = Suffix(1, 2, 3.0, 0.0, 4, 5, 6, 7, 8, 9)
    frame = Frame(5, [], [], bodies, [], [], markers, [], [], suffix)
    packet = encode_frame(frame, (4, 2))
    for grown in (later(packet, 2, b"new!"), later(packet, 5, b"new")):
        assert decode_frame(grown, (4, 3)) == frame
        assert decode_bodies(grown, (4, 3)).suffix == suffix
        assert [row[0] for row in decode_bodies(grown, (4, 3)).bodies] == [0, 1, 2]
        with pytest.raises(NatNetError, match=r"NatNet 4\.2"):
            decode_frame(grown, (4, 2))


def grown_tail(packet, more, size=54):
    """A frame of 4.2 that has further sections before its suffix."""
    out = packet[:-size] + more + packet[-size:]
    return out[:2] + struct.pack("<H", len(out) - 4) + out[4:]


def grown_suffix(packet, more):
    """A frame of 4.2 that has further fields before its suffix's last two, as PTP's came."""
    out = packet[:-6] + more + packet[-6:]
    return out[:2] + struct.pack("<H", len(out) - 4) + out[4:]


LATER_SECTIONS = [
    struct.pack("<ii", 0, 0),
    struct.pack("<ii8s", 1, 8, b"whatever"),
    struct.pack("<ii8sii", 1, 8, bytes(8), 0, 0),
]


@pytest.mark.parametrize("code", [0, 77])
@pytest.mark.parametrize("stamp", [0.0, 3.5])
@pytest.mark.parametrize("ptp", [0, 1_795_000_000])
def test_a_later_frame_ends_in_further_sections_or_fields_and_its_times_are_right(code, stamp, ptp):
    body = RigidBody(7, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0), 0.5, 1)
    ticks = [5_000 * 10**7 + i * 30_000 for i in range(3)]
    suffix = Suffix(code, code, stamp, 0.0, *ticks, ptp, ptp, 2)
    frame = Frame(5, [], [], [body], [], [], [], [], [], suffix)
    packet = encode_frame(frame, (4, 2))
    later = [grown_tail(packet, more) for more in LATER_SECTIONS]
    later += [grown_suffix(packet, more) for more in (bytes(4), bytes(8), b"12345678", b"x" * 24)]
    for each in later:
        with pytest.raises(NatNetError, match=r"in NatNet 4\.2 it is 54"):
            decode_bodies(each, (4, 2))
        for decode in FRAME_DECODERS:
            assert decode(each, (4, 3)).suffix == suffix


def test_the_bones_of_a_later_version_are_left_out_and_the_rest_is_read():
    body = RigidBody(7, (1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0), 0.5, 1)
    suffix = Suffix(1, 2, 3.0, 0.0, 4, 5, 6, 7, 8, 9)
    frame = Frame(5, [], [], [body], [Skeleton(3, [body, body])], [], [], [], [], suffix)
    grown = later(encode_frame(frame, (4, 2)), 3, b"more")
    read = decode_frame(grown, (4, 3))
    assert (read.bodies, read.skeletons, read.suffix) == ([body], [], suffix)
    with pytest.raises(NatNetError):
        decode_frame(grown, (4, 2))


def test_a_later_description_of_a_body_is_read_as_far_as_it_is_known():
    body = BodyModel("hmd", 4, -1, (0.0, 0.0, 0.0), markers=((1.0, 2.0, 3.0),), labels=(0,))
    packet = encode_models([body], (4, 2))
    size = struct.unpack_from("<i", packet, 12)[0]
    for more, at in ((b"more", len(packet)), (b"\xff" * 8, 16 + len("hmd") + 1 + 20)):
        out = packet[:at] + more + packet[at:]
        out = out[:12] + struct.pack("<i", size + len(more)) + out[16:]
        out = out[:2] + struct.pack("<H", len(out) - 4) + out[4:]
        (read,) = decode_models(out, (4, 3))
        assert (read.name, read.id) == ("hmd", 4)
        with pytest.raises(NatNetError):
            decode_models(out, (4, 2))


def test_a_later_description_of_a_camera_is_kept_as_bytes_and_the_bodies_are_read():
    body = BodyModel("headset", 1, -1, (0.0, 0.0, 0.0))
    camera = UnknownModel(5, b"camera\0" + bytes(40))
    packet = encode_models([camera, body], (4, 2))
    assert decode_models(packet, (4, 2)) == [camera, body]
    with pytest.raises(NatNetError, match="left over"):
        decode_models(encode_models([camera, body], (4, 1)), (4, 1))
    assert bodies_of([camera, body]) == [body]


def test_names_that_are_not_utf_8_stay_distinct():
    def named(raw):
        frame = bytearray(
            encode_frame(Frame(1, [MarkerSet("ab", [])], *[[]] * 7, Suffix(*[0] * 10)), (4, 0))
        )
        at = frame.index(b"ab\0")
        frame[at : at + 2] = raw
        return decode_frame(bytes(frame), (4, 0)).marker_sets[0].name

    assert named(b"\xff\x81") != named(b"\xfe\x81")


def test_versions_before_2_5_are_refused():
    with pytest.raises(NatNetError, match=r"2\.4 is older than 2\.5"):
        decode_frame(encode_frame(empty((2, 5)), (2, 5)), (2, 4))


@pytest.mark.parametrize("version", [(2, 9, 0, 0), (3, 0, 0, 0), (4, 2, 0, 0)])
def test_what_a_server_says_of_itself_comes_back(version):
    more = (10_000_000, 1511, True, "239.255.42.99") if version[0] > 2 else ()
    info = ServerInfo("Motive", (3, 1, 0, 0), version, *more)
    packet = encode_serverinfo(info)
    assert len(packet) == 4 + (279 if version[0] > 2 else 264)
    assert decode_serverinfo(packet) == info


def test_greetings_commands_and_echoes_come_back():
    greeting = Greeting("vrbench", (1, 2, 3, 4), (4, 2, 0, 0), True, (4, 1, 0, 0))
    packet = encode_greeting(greeting)
    assert len(packet) == 4 + 269
    assert len(encode_greeting(Greeting("vrbench"))) == 4 + 264
    assert decode_greeting(packet) == greeting
    assert decode_greeting(packed(Message.CONNECT)) == Greeting()
    assert decode_greeting(packed(Message.CONNECT, b"Ping\0")).name == "Ping"
    assert decode_request(encode_request("UnitsToMillimeters")) == "UnitsToMillimeters"
    assert decode_echo_request(encode_echo_request(2**63 + 1)) == 2**63 + 1
    assert decode_echo_response(encode_echo_response(1, 2**64 - 1)) == (1, 2**64 - 1)
    number = packed(Message.RESPONSE, np.float32(1000.0).tobytes())
    assert decode_number(number) == 1000.0
    with pytest.raises(NatNetError, match="no RESPONSE"):
        decode_number(packed(Message.REQUEST, b"abcd"))


def test_errors_say_where_and_why_and_survive_pickling():
    import pickle

    with pytest.raises(
        VrbenchError, match="byte 2: the header promises 8 bytes, 2 follow"
    ) as caught:
        message_of(b"\x07\0\x08\0\0\0")
    again = pickle.loads(pickle.dumps(caught.value))
    assert (again.offset, again.reason) == (caught.value.offset, caught.value.reason)
