"""One step of a run: its take is recorded, and entered into the bundle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from vrbench.config.suite import Step, Suite
from vrbench.devices.ports import facts_of
from vrbench.recording.monitor import Progress
from vrbench.recording.recorder import MOVER, TakeFailedError, record_take
from vrbench.results.bundle import Bundle
from vrbench.results.files import file_digest
from vrbench.results.record import DeviceRecord, TakeRecord
from vrbench.running.movers import Mover
from vrbench.running.opening import Devices


class Watcher(Protocol):
    """Told how a run goes on."""

    def take(self, name: str, index: int, total: int) -> None:
        """A take begins, the index-th of so many."""
        ...

    def moving(self, progress: Progress) -> None:
        """The movement goes on."""
        ...

    def notice(self, text: str) -> None:
        """Something happened that people should know."""
        ...


def skip_step(bundle: Bundle, step: Step, suite: Suite, why: str) -> None:
    """Enters a take that isn't recorded, and why."""
    motion = suite.motion(step.case.motion)
    take = _entry(bundle, step, motion.name, motion.digest)
    take.status, take.reason = "skipped", why
    bundle.add(take)


def record_step(
    bundle: Bundle, devices: Devices, step: Step, mover: Mover, watcher: Watcher, suite: Suite
) -> None:
    """Records one take, and enters it into the bundle.

    Raises:
        TakeFailedError: a device failed, and the run can't or is not to go on.
    """
    session = devices.session
    movement = mover.ready(step)
    path = bundle.take_path(step.name)
    # of a run that is gone on with: what stands there isn't whole, or was never entered
    path.unlink(missing_ok=True)
    take = _entry(bundle, step, movement.motion, movement.digest)
    plan = movement.plan
    if plan is not None:
        take.speed, take.fraction, take.stretch = step.case.speed, plan.fraction, plan.stretch
    metadata = take.facts(bundle.record.device)
    if plan is not None:
        metadata |= {
            "plan": plan.hash,
            "fraction": f"{plan.fraction:.9g}",
            "planned_duration_s": f"{plan.target.duration_s:.9g}",
        }
    sources = {**devices.sources, **({"diary": movement.diary} if movement.diary else {})}
    carry_on, failure = suite.on_loss == "continue", None
    try:
        record_take(
            path,
            metadata,
            sources,
            movement.steps,
            session.host,
            watcher.moving,
            carry_on=carry_on,
            notice=watcher.notice,
        )
    except TakeFailedError as error:
        failure = error
        take.status, take.reason, take.file = "failed", str(error), f"{take.file}.part"
    if session.stage is not None:
        bundle.write_truth(step.name, session.stage.truth)
    take.sha256 = file_digest(bundle.folder / take.file)
    bundle.record.device = _told(bundle.record.device, facts_of(devices.headset))
    bundle.add(take)
    if failure is not None:
        if not carry_on or failure.device == MOVER:
            raise failure
        watcher.notice(f"{step.name} failed: {failure}; the suite goes on")


def _told(device: DeviceRecord, facts: Mapping[str, str]) -> DeviceRecord:
    """The device as the rig has it, and what it says of itself where the rig doesn't know."""
    unknown = {k for k, v in device.model_dump().items() if v == DeviceRecord.UNKNOWN}
    return device.model_copy(update={k: v for k, v in facts.items() if k in unknown})


def _entry(bundle: Bundle, step: Step, motion: str, digest: str) -> TakeRecord:
    """A step's take in the run's record, before it has content."""
    return TakeRecord(
        file=f"takes/{bundle.take_path(step.name).name}",
        sha256="",
        case=step.case.id,
        condition=step.condition,
        mount=step.mount,
        repeat=step.repeat,
        role=step.case.role,
        motion=motion,
        motion_digest=digest,
    )
