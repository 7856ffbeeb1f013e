"""The conversation with Motive, packet by packet, without a network."""

import struct

import pytest
from vrbench_optitrack.conversation import Conversation
from vrbench_optitrack.encode import encode_frame, encode_models
from vrbench_optitrack.frame import UNSAID, Frame, RigidBody, Suffix
from vrbench_optitrack.handshake import (
    ServerInfo,
    decode_echo_request,
    decode_greeting,
    decode_request,
    encode_echo_response,
    encode_serverinfo,
)
from vrbench_optitrack.models import BodyModel, MarkerSetModel
from vrbench_optitrack.options import Options
from vrbench_optitrack.rows import ROWS
from vrbench_optitrack.wire import Message, message_of, name_bytes, packed

S = 1_000_000_000
SERVER = ("10.0.0.1", 1510)
FRAMES = ("10.0.0.1", 1511)
BODY = BodyModel("headset", 7, -1, (0.0, 0.0, 0.0))


def info(version=(4, 1), *, multicast=False, frequency=10_000_000):
    return encode_serverinfo(
        ServerInfo(
            "Motive", (3, 1, 0, 0), (*version, 0, 0), frequency, 1511, multicast, "239.1.2.3"
        )
    )


def number(value):
    return packed(Message.RESPONSE, struct.pack("<f", value))


def frame(index, *, x=0.0, id_=7, params=1, flags=0, version=(4, 1), mid=5):
    body = RigidBody(id_, (x, 1.0, 2.0), (0.0, 0.0, 0.0, 1.0), 0.1, params)
    suffix = Suffix(0, 0, 0.0, 0.0, mid, 6, 7, 0, 0, flags)
    return encode_frame(Frame(index, [], [], [body], *[[]] * 5, suffix), version)


def requests(packets):
    return [decode_request(p) for p in packets if message_of(p) == Message.REQUEST]


def kinds(packets):
    return [message_of(p) for p in packets]


@pytest.fixture
def talk():
    return Conversation(Options(body="headset", server="10.0.0.1"), "10.0.0.1")


def settle(talk, now=0, version=(4, 1), unit=1000.0, **more):
    """The handshake as Motive answers it; returns the commands it was asked."""
    asked = []
    assert Message.CONNECT in kinds(talk.outgoing(now))
    talk.incoming(info(version, **more), SERVER, now)
    for _ in range(5):
        packets = talk.outgoing(now)
        for command in requests(packets):
            asked.append(command)
            if command == "Bitstream":
                words = name_bytes(f"Bitstream,{version[0]}.{version[1]}")
                talk.incoming(packed(Message.RESPONSE, words), SERVER, now)
            elif command.startswith("Bitstream,"):
                talk.incoming(packed(Message.RESPONSE, struct.pack("<i", 0)), SERVER, now)
            else:
                talk.incoming(number(unit), SERVER, now)
        if Message.REQUEST_MODELDEF in kinds(packets):
            models = [MarkerSetModel("all", ()), BODY]
            talk.incoming(encode_models(models, version), SERVER, now)
    assert talk.settled
    return asked


def test_commands_are_asked_one_at_a_time_for_answers_have_no_tag(talk):
    assert settle(talk, unit=25.4) == ["Bitstream", "UnitsToMillimeters", "FrameRate"]
    assert talk.unit_mm == pytest.approx(25.4)
    assert talk.body == BODY


def test_in_multicast_nothing_is_asked_of_the_bitstream_and_no_keepalive_is_sent(talk):
    assert settle(talk, multicast=True) == ["UnitsToMillimeters", "FrameRate"]
    assert talk.multicast
    later = [m for t in range(1, 50) for m in kinds(talk.outgoing(t * S // 10))]
    assert Message.KEEPALIVE not in later


def test_in_unicast_a_keepalive_is_sent_each_second(talk):
    settle(talk)
    sent = [m for t in range(1, 101) for m in kinds(talk.outgoing(t * S // 10))]
    assert sent.count(Message.KEEPALIVE) == pytest.approx(10, abs=1)


def test_the_greeting_is_repeated_until_it_is_answered(talk):
    sent = [m for t in range(20) for m in kinds(talk.outgoing(t * S // 10))]
    assert sent == [Message.CONNECT] * 4
    talk.incoming(info(), SERVER, 2 * S)
    assert Message.CONNECT not in [
        m for t in range(20, 30) for m in kinds(talk.outgoing(t * S // 10))
    ]


def test_a_command_that_is_not_answered_is_given_up_and_metres_are_assumed(talk):
    talk.outgoing(0)
    talk.incoming(info((3, 0)), SERVER, 0)
    asked = [c for t in range(40) for c in requests(talk.outgoing(t * S // 10))]
    assert asked == ["UnitsToMillimeters"] * 3 + ["FrameRate"] * 3
    assert (talk.unit_mm, talk.rate_hz) == (1000.0, None)


def test_a_later_server_is_asked_for_a_version_that_is_known(talk):
    assert settle(talk, version=(4, 4))[0] == "Bitstream,4.2"


def test_the_version_wanted_goes_with_the_greeting():
    talk = Conversation(Options(body="headset", bitstream="3.1"), "10.0.0.1")
    (greeting,) = talk.outgoing(0)
    assert decode_greeting(greeting).bitstream[:2] == (3, 1)


def test_frames_become_rows_of_the_wanted_body(talk):
    settle(talk)
    talk.incoming(frame(1, x=0.5), FRAMES, S)
    talk.incoming(frame(2, x=0.6, params=0), FRAMES, S + 1)
    talk.incoming(frame(3, id_=99), FRAMES, S + 2)
    first, second, third = talk.rows
    assert (first.number, first.stamps, first.valid, first.arrival) == (1, (5, 6, 7), True, S)
    assert first.body[1:4] == (0.5, 1.0, 2.0)
    assert not second.valid
    assert (third.body, third.valid) == (None, False)


def test_a_frame_that_comes_twice_counts_once_and_missing_ones_are_told(talk):
    settle(talk)
    for index in (1, 1, 2, 5, 6, 1):
        talk.incoming(frame(index), FRAMES, S + index)
    assert [row.number for row in talk.rows] == [1, 2, 5, 6, 1]
    assert talk.rows.lost == 2
    assert [told.detail["frames"] for told in talk.told if told.kind == "gap"] == [2]


def test_in_2_5_a_pose_that_repeats_to_the_last_bit_is_lost():
    talk = Conversation(Options(body="headset", connection="unicast"), "10.0.0.1")
    settle(talk, version=(2, 5))
    for index, x in enumerate((0.1, 0.2, 0.2, 0.2, 0.3)):
        talk.incoming(frame(index, x=x, params=UNSAID, version=(2, 5)), FRAMES, index)
    assert [row.valid for row in talk.rows] == [True, True, False, False, True]


def test_packets_of_other_senders_are_dropped(talk):
    settle(talk)
    talk.incoming(frame(1), FRAMES, S)
    for sender in (("10.0.0.9", 1511), ("10.0.0.1", 4711)):
        talk.incoming(frame(2, x=9.0), sender, S + 1)
        talk.incoming(info((3, 0)), sender, S + 1)
        talk.incoming(encode_models([], (4, 1)), sender, S + 1)
    assert [row.number for row in talk.rows] == [1]
    assert (talk.version, talk.body) == ((4, 1), BODY)
    assert talk.strangers == 6
    # the server's frames may come from another socket, once the first has fallen silent
    talk.incoming(frame(3), ("10.0.0.1", 4711), 5 * S)
    assert talk.rows[-1].number == 3


def test_an_echo_that_was_not_asked_for_is_not_believed(talk):
    settle(talk)
    (request,) = [p for p in talk.outgoing(S) if message_of(p) == Message.ECHO_REQUEST]
    stamp = decode_echo_request(request)
    talk.incoming(encode_echo_response(stamp + 1, 77), SERVER, S + 1000)
    assert not talk.clock
    talk.incoming(encode_echo_response(stamp, 88), SERVER, S + 2000)
    talk.incoming(encode_echo_response(stamp, 99), SERVER, S + 3000)
    assert list(talk.echoes) == [(S, 88, S + 2000)]


def echo(talk, now, ticks, trip=100_000):
    """A clock request of this moment, answered."""
    (request,) = [p for p in talk.outgoing(now) if message_of(p) == Message.ECHO_REQUEST]
    stamp = decode_echo_request(request)
    talk.incoming(encode_echo_response(stamp, ticks), SERVER, now + trip)


def test_frames_wait_for_an_answer_that_says_their_clock_has_not_stepped(talk):
    settle(talk)
    echo(talk, S, 1_000)
    talk.incoming(frame(1), FRAMES, 2 * S)
    assert talk.rows.settled(2 * S) == []
    echo(talk, 2 * S + 1, 1_000 + 10_000_000)
    (row,) = talk.rows.settled(2 * S + 200_000)
    assert (row.number, row.sure, row.clock) == (1, True, talk.clock)


def test_frames_do_not_wait_longer_than_a_second_or_past_the_end_of_a_take(talk):
    settle(talk)
    echo(talk, S, 1_000)
    talk.incoming(frame(1), FRAMES, 2 * S)
    assert [row.number for row in talk.rows.settled(3 * S + 1)] == [1]
    talk.incoming(frame(2), FRAMES, 4 * S)
    talk.rows.collecting = False
    assert [row.number for row in talk.rows.settled(4 * S)] == [2]


@pytest.mark.parametrize("step_ms", [-3600_000, -5, 5, 2500])
def test_frames_between_two_answers_that_disagree_are_in_doubt(talk, step_ms):
    settle(talk)
    start = 5_000 * 10_000_000
    for t in range(1, 6):
        echo(talk, t * S, start + t * 10_000_000)
    old = talk.clock
    for i, at in enumerate((5 * S - 1, 5 * S + S // 10, 5 * S + S // 5)):
        talk.incoming(frame(i), FRAMES, at)
    echo(talk, 5 * S + S // 4, start + 52_500_000 + step_ms * 10_000)
    talk.incoming(frame(3), FRAMES, 5 * S + S // 3)
    talk.incoming(frame(4), FRAMES, 5 * S + S // 2)
    echo(talk, 6 * S, start + 60_000_000 + step_ms * 10_000)
    rows = talk.rows.settled(6 * S + 200_000)
    assert [row.sure for row in rows] == [True, False, False, False, True]
    assert [row.clock is old for row in rows] == [True] * 3 + [False] * 2
    (step,) = [told for told in talk.told if told.kind == "clock-step"]
    assert step.detail["by_s"] == pytest.approx(step_ms * 1e-3, abs=1e-3)


def test_before_3_0_a_server_does_not_say_how_it_sends_and_is_kept_awake():
    talk = Conversation(Options(body="headset"), "10.0.0.1")
    settle(talk, version=(2, 9))
    sent = [m for t in range(1, 51) for m in kinds(talk.outgoing(t * S // 10))]
    assert sent.count(Message.KEEPALIVE) == pytest.approx(5, abs=1)
    assert talk.described()["way"] == "unicast or multicast"


def test_models_that_are_not_sent_are_asked_for_by_their_types_too(talk):
    talk.outgoing(0)
    talk.incoming(info(), SERVER, 0)
    asked = []
    for t in range(40):
        for packet in talk.outgoing(t * S // 10):
            if message_of(packet) == Message.REQUEST:
                talk.incoming(number(1000.0), SERVER, t * S // 10)
            if message_of(packet) == Message.REQUEST_MODELDEF:
                asked.append(packet[4:])
    assert asked[:4] == [b"", b"\3\0\0\0", b"", b"\3\0\0\0"]


def test_models_are_asked_again_when_they_have_changed(talk):
    settle(talk)
    talk.incoming(frame(1, flags=2), FRAMES, 3 * S)
    assert Message.REQUEST_MODELDEF in kinds(talk.outgoing(3 * S))
    renamed = BodyModel("headset", 9, -1, (0.0, 0.0, 0.0))
    talk.incoming(encode_models([renamed], (4, 1)), SERVER, 3 * S)
    talk.incoming(frame(2, id_=9), FRAMES, 3 * S)
    assert talk.rows[-1].valid


@pytest.mark.parametrize("flags", [8, 0])
def test_a_changed_bitstream_begins_a_new_handshake(talk, flags):
    settle(talk)
    spoilt = frame(1, flags=flags) if flags else frame(1, version=(3, 1))
    talk.incoming(spoilt, FRAMES, 3 * S)
    assert Message.CONNECT in kinds(talk.outgoing(3 * S))
    rows = len(talk.rows)
    talk.incoming(frame(2), FRAMES, 3 * S)
    assert len(talk.rows) == rows


def test_frames_that_never_become_readable_are_a_failure_that_says_why(talk):
    settle(talk)
    for t in range(1, 70):
        now = t * S // 10
        talk.incoming(frame(t, version=(3, 1)), FRAMES, now)
        talk.outgoing(now)
        talk.incoming(info(), SERVER, now)
        for command in requests(talk.outgoing(now)):
            words = name_bytes("Bitstream,4.1")
            talk.incoming(
                packed(Message.RESPONSE, words) if command == "Bitstream" else number(1000.0),
                SERVER,
                now,
            )
    assert "frames aren't of NatNet 4.1" in str(talk.failure(now))


def test_silence_is_a_failure_after_a_while_and_is_asked_about_before(talk):
    settle(talk)
    talk.incoming(frame(1), FRAMES, S)
    assert talk.failure(3 * S) is None
    assert Message.CONNECT in kinds(talk.outgoing(3 * S))
    assert "has sent no frame for 6.0 s" in str(talk.failure(7 * S))


def test_a_server_that_is_too_old_is_told(talk):
    talk.outgoing(0)
    talk.incoming(info((2, 4)), SERVER, 0)
    assert "Motive speaks NatNet 2.4" in str(talk.failure(S))


def test_rows_that_nobody_reads_are_bounded_and_counted(talk):
    settle(talk)
    packet = bytearray(frame(0))
    for index in range(ROWS + 10):
        struct.pack_into("<i", packet, 4, index)
        talk.incoming(bytes(packet), FRAMES, index)
    assert len(talk.rows) == ROWS
    assert talk.rows.overflown == 10


@pytest.mark.parametrize(
    "raw", [b"", b"\7", b"\7\0\0\0", b"\1\0\3\0abc", b"\5\0\4\0\xff\xff\xff\x7f"]
)
def test_what_is_no_packet_does_no_harm(talk, raw):
    settle(talk)
    for sender in (SERVER, FRAMES):
        talk.incoming(raw, sender, S)
    assert talk.body == BODY
