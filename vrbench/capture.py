"""Captures: a suite that a person moves x rig -> takes in a bundle."""

from __future__ import annotations

from collections.abc import Generator
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol

from vrbench.config.rig import Rig
from vrbench.config.suite import Step, Suite
from vrbench.config.yaml_file import as_yaml
from vrbench.devices.ports import Session
from vrbench.devices.simulated.robot import START_EYE
from vrbench.errors import ConfigError
from vrbench.motion.files import given
from vrbench.motion.generators import generate
from vrbench.motion.motion import digest_of_name
from vrbench.opening import Devices, accuracy_of, is_simulated, open_rig
from vrbench.plugin.manager import Plugins
from vrbench.recording.recorder import record_take
from vrbench.results.bundle import (
    Bundle,
    DeviceRecord,
    RunRecord,
    TakeRecord,
    file_digest,
    utc_now,
    versions,
)
from vrbench.runner import Watcher
from vrbench.trajectory import Trajectory

STEP_S = 1.0


class Person(Protocol):
    """Who wears the headset."""

    def ready(self, step: Step) -> None:
        """Told what comes; returns when they are ready."""
        ...

    def perform(self, step: Step, session: Session) -> Generator[float, None, None]:
        """Moves while it is iterated, many times a second where time is real."""
        ...


class SimulatedPerson:
    """Moves on the stage as generated motions do: all axes to calibrate, else as in a game."""

    def ready(self, step: Step) -> None:
        pass

    def perform(self, step: Step, session: Session) -> Generator[float, None, None]:
        motion = generate(
            "saturate-1" if step.case.role == "calibration" else "shooter-1"
        ).trajectory
        hand = session.mounting.inverse()
        path = motion.mapped(lambda pose: START_EYE @ pose @ hand)
        session.stage.move(Trajectory(path.t + session.host.now(), path.pose))
        done, duration = 0.0, path.duration_s + 1.0
        while done < duration:
            session.host.wait(STEP_S)
            done += STEP_S
            yield min(1.0, done / duration)


def record_capture(
    suite: Suite,
    rig: Rig,
    rig_name: str,
    folder: Path,
    plugins: Plugins,
    *,
    person: Person,
    seed: int,
    watcher: Watcher,
    licence: str | None = None,
    consent: str | None = None,
) -> Bundle:
    """Records all takes of a suite that a person moves into a new bundle.

    Args:
        suite: what to record.
        rig: with what: a headset and motion capture.
        rig_name: the rig's path or name, for messages.
        folder: the new bundle's folder.
        plugins: for their devices.
        person: who moves; a simulated rig has a person of its own.
        seed: of everything random on a simulated rig.
        watcher: told how it goes on.
        licence: under which the person's motion may be used.
        consent: how the person agreed to that.

    Raises:
        ConfigError: the rig lacks what the suite needs, an option is wrong, the folder exists, or
            a real person's motion has no licence or consent.
        DeviceError: a device failed. The bundle stays, marked incomplete, with the takes so far.
    """
    if rig.mocap is None:
        raise ConfigError(
            f"suite {suite.label} needs motion capture, the rig has none",
            file=rig_name,
            field="mocap",
        )
    simulated = is_simulated(rig, rig_name)
    if not simulated and not (given(licence) and given(consent)):
        raise ConfigError(
            f"suite {suite.label} records a person's motion: it needs a licence and their consent",
            field="--licence, --consent",
            fix="say what was agreed with the person",
        )
    record = RunRecord(
        kind="simulated" if simulated else "recorded",
        created=utc_now().isoformat(),
        suite=suite.canonical(),
        suite_digest=suite.digest,
        lab=rig.lab,
        sitting="1",
        device=DeviceRecord(
            headset=rig.headset.model, firmware=rig.headset.firmware, logger=rig.headset.plugin
        ),
        references=["mocap"],
        accuracy=accuracy_of(rig),
        licence=licence,
        consent=consent,
        seed=seed if simulated else None,
        versions=versions(plugins.versions()),
    )
    steps = list(suite.schedule())
    with ExitStack() as stack:
        devices = open_rig(rig.model_copy(update={"robot": None}), rig_name, plugins, seed, stack)
        inputs = {
            "suite.yaml": as_yaml(suite.canonical()),
            "rig.yaml": as_yaml(rig.model_dump(mode="json")),
        }
        bundle = Bundle.create(folder, record, inputs)
        mover = SimulatedPerson() if simulated else person
        for index, step in enumerate(steps):
            watcher.take(step.name, index, len(steps))
            mover.ready(step)
            _record_step(bundle, suite, devices, step, mover, watcher)
        bundle.finish()
    return bundle


def _record_step(
    bundle: Bundle,
    suite: Suite,
    devices: Devices,
    step: Step,
    person: Person,
    watcher: Watcher,
) -> None:
    case, session = step.case, devices.session
    motion = suite.motions[case.motion]
    metadata = {
        "case": case.id,
        "motion": motion,
        "motion_digest": digest_of_name(motion),
        "logger": bundle.record.device.logger,
        "prediction": bundle.record.device.prediction,
    }
    path = bundle.take_path(step.name)
    movement = person.perform(step, session)
    record_take(path, metadata, devices.sources, movement, session.host, watcher.moving)
    if session.stage is not None:
        bundle.write_truth(step.name, session.stage.truth)
    bundle.add(
        TakeRecord(
            file=f"takes/{path.name}",
            sha256=file_digest(path),
            case=case.id,
            mount=step.mount,
            repeat=step.repeat,
            role=case.role,
            motion=motion,
            motion_digest=digest_of_name(motion),
        )
    )
