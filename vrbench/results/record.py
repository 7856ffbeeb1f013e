"""`run.json`: what was run, with what, and what came of it."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, StringConstraints, model_validator

from vrbench.config.suite import Suite
from vrbench.config.yaml_file import validate
from vrbench.motion.files import given

SCHEMA_VERSION = 1
RECORD = "run.json"


class _Record(BaseModel):
    model_config = ConfigDict(extra="forbid")


class DeviceRecord(_Record):
    """The headset that was measured, and how its poses were had."""

    UNKNOWN: ClassVar[str] = "unknown"

    headset: str
    firmware: str = UNKNOWN
    logger: str = UNKNOWN
    logger_version: str = UNKNOWN
    prediction: str = UNKNOWN


class AccuracyRecord(_Record):
    """How accurate a reference is over the motion's box, and who says so."""

    metres: float
    source: str


class OcclusionRecord(_Record):
    """The headset's cameras, name by id, and those that each level of the suite covers."""

    cameras: dict[int, str]
    levels: dict[str, list[int]]


class TakeRecord(_Record):
    """One take of the run."""

    file: Annotated[str, StringConstraints(pattern=r"^takes/[^/\\]+$")]
    sha256: str
    case: str
    condition: str = "default"
    mount: int
    repeat: int
    role: Literal["calibration", "check", "scored"]
    motion: str
    motion_digest: str
    speed: float = 1.0
    stretch: float = 1.0
    fraction: float = 1.0
    repairs: list[str] = []
    status: Literal["ok", "failed", "skipped"] = "ok"
    reason: str = ""
    # Of a calibration that an earlier run recorded: `run/take`.
    origin: str = ""

    @property
    def name(self) -> str:
        """What the take is called; that of one which failed stands in a `.mcap.part`."""
        return Path(self.file).name.partition(".mcap")[0]

    def facts(self, device: DeviceRecord) -> dict[str, str]:
        """What the take's own file says of it, text by name, so that it can be read alone."""
        return {
            "case": self.case,
            "role": self.role,
            "motion": self.motion,
            "motion_digest": self.motion_digest,
            "stretch": f"{self.stretch / self.speed:.9g}",
            "logger": device.logger,
            "prediction": device.prediction,
        }


class RunRecord(_Record):
    """`run.json`: what was run, with what, and what came of it."""

    schema_version: Literal[1] = 1
    # incomplete: interrupted or crashed; failed: a device ended it. Both can be gone on with.
    status: Literal["incomplete", "failed", "complete"] = "incomplete"
    reason: str = ""
    kind: Literal["recorded", "simulated", "imported"]
    created: str
    suite: dict[str, Any]
    suite_digest: str
    lab: str
    sitting: str
    device: DeviceRecord
    references: list[str]
    accuracy: dict[str, AccuracyRecord] = {}
    occlusion: OcclusionRecord | None = None
    seed: int | None = None
    # One hash over the plans that a real robot carries out, and when the run was gone on with.
    plans: str | None = None
    resumed: list[str] = []
    licence: str | None = None
    consent: str | None = None
    versions: dict[str, str]
    files: dict[str, str] = {}
    takes: list[TakeRecord] = []

    @model_validator(mode="after")
    def _permitted(self) -> RunRecord:
        """A run that carries a person's motion says under which licence, and by what consent."""
        if self.suite.get("mover") == "person" and self.kind != "simulated":
            for name in ("licence", "consent"):
                if not given(getattr(self, name)):
                    raise ValueError(f"a run with a person's motion needs {name}")
        return self

    def resolved_suite(self) -> Suite:
        """The suite as it was when the run was made."""
        return validate(self.suite, Suite, RECORD)


def utc_now() -> datetime:
    """The time, to the second."""
    return datetime.now(UTC).replace(microsecond=0)


def versions(plugins: Mapping[str, str]) -> dict[str, str]:
    """Versions of Python and of what takes part in a result, by name."""
    from importlib.metadata import version

    import numpy
    import scipy

    return {
        "python": platform.python_version(),
        "numpy": numpy.__version__,
        "scipy": scipy.__version__,
        "mcap": version("mcap"),
        **plugins,
    }
