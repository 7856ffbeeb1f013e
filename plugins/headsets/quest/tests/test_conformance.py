"""What every headset plugin passes: `vrbench plugin check quest` runs the same."""

from vrbench.plugin.testing import (
    HeadsetConformance,
    HeadsetModelConformance,
    ImporterConformance,
)


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


class TestVrbenchLog(ImporterConformance):
    name = "quest-vrbench-csv"
