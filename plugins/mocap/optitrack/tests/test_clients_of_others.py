"""Clients by others on the emulator: independent witnesses that it speaks as Motive does."""

import subprocess
import sys
import time

import numpy as np
import pytest
from vrbench_optitrack.scene import Scene

SCENE = Scene(motion="saturate-30s-1", begin_s=10.0)


WITNESSED = {
    "2.10": "unicast",
    "3.0": "multicast",
    "3.1": "unicast",
    "4.0": "multicast",
    "4.1": "unicast",
    "4.2": "multicast",
}


@pytest.mark.parametrize(("version", "way"), WITNESSED.items())
def test_natnet_reads_bodies_names_and_times(motive, version, way):
    """Version 0.3 misreads the suffix of 2.x and the PTP fields of 4.1; the rest it reads right."""
    natnet = pytest.importorskip("natnet", reason="pip install natnet: a client by others")
    server = motive("--version", version, f"--{way}")
    client = natnet.NatNetClient(
        "127.0.0.1",
        "127.0.0.1",
        command_port=server.port,
        data_port=server.data_port,
        use_multicast=way == "multicast",
    )
    frames, models = [], []
    client.on_data_frame_received_event.handlers.append(frames.append)
    client.on_data_description_received_event.handlers.append(models.append)
    with client:
        client.run_async()
        client.request_modeldef()
        end = time.monotonic() + 5
        while time.monotonic() < end and not (len(frames) > 20 and models):
            time.sleep(0.02)
    assert str(client.protocol_version).startswith(f"{version}.")
    assert [(b.name, b.id_num) for b in models[0].rigid_bodies] == [
        ("controller", 8),
        ("headset", 1),
    ]
    assert len(frames) > 20
    for frame in frames[-10:]:
        body = next(b for b in frame.rigid_bodies if b.id_num == 1)
        assert body.tracking_valid
        index = frame.prefix.frame_number - 1
        truth = SCENE.head(np.array([index / 240.0]))
        np.testing.assert_allclose(body.pos, truth.p[0], atol=1e-6)
        np.testing.assert_allclose(body.rot, truth.q[0], atol=1e-6)
        if version >= "3":
            mid = server.clock.at(server.first_frame_ns + round(index * 1e9 / 240.0))
            assert abs(frame.suffix.stamp_camera_mid_exposure - mid) <= 1
            assert frame.suffix.timestamp == pytest.approx(index / 240.0)


# In a process of its own, for it waits without end where no frame comes.
READ_ONE = """
import sys, motioncapture
mocap = motioncapture.connect(
    "optitrack",
    {"hostname": "127.0.0.1", "interface_ip": "127.0.0.1", "port_command": sys.argv[1]},
)
for _ in range(20):
    mocap.waitForNextFrame()
    body = mocap.rigidBodies["headset"]
    q = body.rotation
    print(*body.position, q.x, q.y, q.z, q.w)
"""


@pytest.mark.parametrize(
    ("version", "way"),
    [("3.0", "unicast"), ("3.1", "multicast"), ("4.0", "multicast"), ("4.1", "unicast")],
)
def test_motioncapture_reads_the_moving_head(motive, version, way):
    """Version 1.1 crashes on model definitions of 4.2, and gives neither times nor validity.

    In unicast it greets from a socket that it closes, and listens at the data port.
    """
    pytest.importorskip("motioncapture", reason="pip install motioncapture: a client by others")
    server = motive("--version", version, f"--{way}")
    command = [sys.executable, "-c", READ_ONE, str(server.port)]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=20, check=True)
    rows = [
        [float(x) for x in line.split()] for line in ran.stdout.splitlines() if line[0] in "-0123"
    ]
    poses = np.array(rows)
    assert len(poses) == 20
    # it gives no times: each pose must be the head's at one of the frames sent up to now
    seconds = np.arange(0, 6, 1 / 240.0)
    path = SCENE.head(seconds)
    away = np.linalg.norm(poses[:, None, :3] - path.p[None], axis=2)
    nearest = np.argmin(away, axis=1)
    assert away.min(axis=1).max() < 1e-5
    assert np.all(np.diff(nearest) > 0)
    np.testing.assert_allclose(poses[:, 3:], path.q[nearest], atol=1e-5)
