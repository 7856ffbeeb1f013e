"""What every importer passes, on a file written here as QTM writes it."""

from datetime import UTC, datetime
from pathlib import Path

import pytest
from scipy.spatial.transform import Rotation

from vrbench.geometry import Axes
from vrbench.plugin.sample import write_calibration
from vrbench.plugin.testing import ImporterConformance, MocapConformance
from vrbench.streams import Samples

QTM = Axes(up="z", forward="y", unit_m=0.001)


class TestLive(MocapConformance):
    """Nothing plays QTM's protocol yet: what a stand-in would prove is told as not checked."""

    name = "qualisys"


def export(samples: Samples, path: Path) -> None:
    """What QTM would have exported: z up, mm, a matrix column by column, lost frames as zeros."""
    began = datetime.fromtimestamp(int(samples.pose_t[0]) / 1e9, UTC)
    there = QTM.from_openxr(samples.pose)
    lines = [f"NO_OF_FRAMES\t{len(samples)}", "NO_OF_CAMERAS\t8", "NO_OF_BODIES\t1"]
    lines += ["FREQUENCY\t60", "NO_OF_ANALOG\t0", "ANALOG_FREQUENCY\t0", "DESCRIPTION\t--"]
    stamp = f"{began:%Y-%m-%d, %H:%M:%S}.{began.microsecond // 1000:03}"
    lines += [f"TIME_STAMP\t{stamp}\t22107.99179716", "DATA_INCLUDED\t6D", "BODY_NAMES\theadset"]
    titles = ["headset X", *"YZ", "Roll", "Pitch", "Yaw", "Residual"]
    titles += [f"Rot[{i}]" for i in range(9)]
    lines.append("\t".join(["Frame", "Time", *titles]))
    for k, good in enumerate(samples.good):
        turn = Rotation.from_quat(there.q[k]).as_matrix().T.ravel()
        pose = (*there.p[k], 0, 0, 0, 0.4, *turn) if good else (*[0] * 6, -1, *[0] * 9)
        since = (samples.pose_t[k] - samples.pose_t[0]) / 1e9
        lines.append("\t".join([str(k + 1), f"{since:.5f}", *(f"{x:.6f}" for x in pose)]))
    path.write_text("".join(f"{line}\r\n" for line in lines), encoding="utf-8", newline="")


class TestTsv(ImporterConformance):
    name = "qtm-6d-tsv"

    @pytest.fixture(autouse=True, scope="class")
    @classmethod
    def _simulated(cls, tmp_path_factory: pytest.TempPathFactory) -> None:
        folder, said = tmp_path_factory.mktemp("qtm"), {"utc_offset": "+00:00"}
        cls.recordings = write_calibration(folder, "mocap", {"format": cls.name, **said}, export)
