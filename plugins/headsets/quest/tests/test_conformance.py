"""What every headset plugin passes: `vrbench plugin check quest` runs the same."""

from pathlib import Path

import pytest
from vrbench_quest.vrbench_log import COLUMNS, FIRST

from vrbench.geometry import UNITY
from vrbench.plugin.sample import write_calibration
from vrbench.plugin.testing import (
    HeadsetConformance,
    HeadsetModelConformance,
    ImporterConformance,
)
from vrbench.streams import Samples


class TestRoute(HeadsetConformance):
    name = "quest"


class TestQuest2(HeadsetModelConformance):
    name = "quest-2"


class TestQuestPro(HeadsetModelConformance):
    name = "quest-pro"


class TestQuest3(HeadsetModelConformance):
    name = "quest-3"


class TestQuest3S(HeadsetModelConformance):
    name = "quest-3s"


class TestUnityLog(ImporterConformance):
    name = "quest-unity-csv"
    recordings = "banaszczyk2024-quest-2"


def log(samples: Samples, path: Path) -> None:
    """What the Unity logger would have written."""
    there = UNITY.from_openxr(samples.pose)
    origin = 1_700_000_000 * 10**9
    lines = [FIRST, f"# utc_origin_ns: {origin}", ",".join(COLUMNS)]
    for k, (t, good) in enumerate(zip(samples.source_t, samples.good, strict=True)):
        pose = ",".join(f"{x:.7f}" for x in (*there.p[k], *there.q[k]))
        lines.append(f"{t - origin},{k},render,{pose},0,0,0,0,0,0,{15 if good else 0},1,0")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


class TestVrbenchLog(ImporterConformance):
    name = "quest-vrbench-csv"

    @pytest.fixture(autouse=True, scope="class")
    @classmethod
    def _simulated(cls, tmp_path_factory: pytest.TempPathFactory) -> None:
        folder = tmp_path_factory.mktemp("quest")
        cls.recordings = write_calibration(folder, "headset", {"format": cls.name}, log)
