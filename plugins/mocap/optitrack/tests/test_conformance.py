"""What every plugin of motion capture passes: `vrbench plugin check optitrack` runs the same."""

from datetime import UTC, datetime
from pathlib import Path

import pytest

from vrbench.plugin.sample import write_calibration
from vrbench.plugin.testing import ImporterConformance, MocapConformance
from vrbench.streams import Samples


class TestLive(MocapConformance):
    name = "optitrack"


def export(samples: Samples, path: Path) -> None:
    """What Motive would have exported: y up, metres, frames without the body left blank."""
    rate = 60.0
    began = datetime.fromtimestamp(int(samples.pose_t[0]) / 1e9, UTC)
    facts = ["Format Version", "1.23", "Take Name", "take", "Export Frame Rate", f"{rate:.6f}"]
    facts += ["Capture Frame Rate", f"{rate:.6f}", "Rotation Type", "Quaternion"]
    facts += ["Capture Start Time", f"{began:%Y-%m-%d %I.%M.%S}.{began.microsecond // 1000:03} "]
    facts[-1] += f"{began:%p}"
    facts += ["Length Units", "Meters", "Coordinate Space", "Global"]
    kinds, axes = ["Rotation"] * 4 + ["Position"] * 3, list("XYZWXYZ")
    lines = [",".join(facts), ""]
    for label, cells in (("Type", "Rigid Body"), ("Name", "headset"), ("ID", '"9D1F"')):
        lines.append(",".join(["", label, *[cells] * 7]))
    lines += [",".join(["", "", *kinds]), ",".join(["Frame", "Time (Seconds)", *axes])]
    for k, good in enumerate(samples.good):
        pose = (*samples.pose.q[k], *samples.pose.p[k])
        since = (samples.pose_t[k] - samples.pose_t[0]) / 1e9
        cells = [f"{x:.6f}" for x in pose] if good else [""] * 7
        lines.append(",".join([str(k), f"{since:.6f}", *cells]))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


class TestMotiveCsv(ImporterConformance):
    name = "motive-csv"

    @pytest.fixture(autouse=True, scope="class")
    @classmethod
    def _simulated(cls, tmp_path_factory: pytest.TempPathFactory) -> None:
        folder, said = tmp_path_factory.mktemp("motive"), {"utc_offset": "+00:00"}
        cls.recordings = write_calibration(folder, "mocap", {"format": cls.name, **said}, export)
