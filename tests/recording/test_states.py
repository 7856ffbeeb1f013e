"""What a robot's controller says of itself, in a take and out of it."""

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from vrbench.recording.take import TakeWriter, read_take
from vrbench.streams import Columns, States


def states(n=50):
    rng = np.random.default_rng(1)
    t = 1_700_000_000_000_000_000 + np.arange(n, dtype=np.int64) * 2_000_000
    return States(
        t=t,
        receive_t=t + 100_000,
        device_t=np.arange(n, dtype=np.int64) * 2_000_000,
        speed_scaling=rng.uniform(0, 1, n),
        safety=rng.integers(0, 2**11, n).astype(np.uint32),
        runtime=np.full(n, 2, dtype=np.uint32),
    )


def test_states_come_back_to_the_last_bit(tmp_path):
    path, want = tmp_path / "take.mcap", states()
    with TakeWriter(path, {}) as writer:
        writer.write(Columns({}, states={"robot/state": want}))
    got = read_take(path).states["robot/state"]
    for name in ("t", "receive_t", "device_t", "speed_scaling", "safety", "runtime"):
        np.testing.assert_array_equal(getattr(got, name), getattr(want, name))


def test_other_tools_read_them_too(tmp_path):
    path, want = tmp_path / "take.mcap", states(3)
    with TakeWriter(path, {}) as writer:
        writer.write(Columns({}, states={"robot/state": want}))
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        read = [message for *_, message in reader.iter_decoded_messages()]
    assert [message.stamp_ns for message in read] == want.t.tolist()
    assert [message.safety for message in read] == want.safety.tolist()
    assert [message.speed_scaling for message in read] == want.speed_scaling.tolist()
