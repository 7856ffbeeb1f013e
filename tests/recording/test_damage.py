"""Whatever happens to a file on its way: poses, or one error that names it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vrbench.errors import DataError
from vrbench.recording.importers import builtin_importers

IMPORTERS = {importer.name: importer for importer in builtin_importers()}
POSE = "geometry_msgs/msg/PoseStamped"
damage = st.lists(
    st.tuples(st.floats(0, 1, exclude_max=True), st.binary(min_size=0, max_size=6)),
    min_size=1,
    max_size=4,
)


def damaged(content, places):
    for where, what in places:
        at = int(where * len(content))
        content = content[:at] + what + content[at + max(len(what), 1) :]
    return content


def check(importer, path, options):
    try:
        samples = importer.read(path, options).samples
    except DataError as error:
        assert path.name in str(error)
    else:
        assert len(samples) > 0
        assert np.isfinite(samples.pose.p).all()
        np.testing.assert_allclose(np.linalg.norm(samples.pose.q, axis=1), 1.0, atol=1e-9)
        assert np.all(np.diff(samples.pose_t) > 0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("damage")


@pytest.fixture(scope="module")
def bag(folder):
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    path = folder / "whole.bag"
    with Writer(path) as writer:
        tcp = writer.add_connection("/tcp", POSE, typestore=store)
        for i in range(12):
            stamp = np.array([i, 100 + i, 7, 4], dtype="<u4").tobytes()
            values = np.array([i, 0, 0, 0, 0, 0, 1], dtype="<f8").tobytes()
            writer.write(tcp, (100 + i) * 10**9, stamp + b"base" + values)
    return path.read_bytes()


@given(places=damage)
def test_a_damaged_bag(folder, bag, places):
    path = folder / "damaged.bag"
    path.write_bytes(damaged(bag, places))
    importer = IMPORTERS["rosbag1"]
    check(importer, path, importer.options(topic="/tcp"))


@pytest.mark.parametrize("name", ["tum", "euroc"])
@given(places=damage)
def test_a_damaged_text(folder, name, places):
    gap, times = (" ", range(9)) if name == "tum" else (",", range(100, 109))
    rows = "".join(gap.join(map(str, (t, t, 2.5, -3, 0.5, 0.5, 0.5, -0.5))) + "\n" for t in times)
    path = folder / "damaged.txt"
    path.write_bytes(damaged(rows.encode(), places))
    check(IMPORTERS[name], path, IMPORTERS[name].options())
