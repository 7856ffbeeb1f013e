"""Runs: suite x rig -> takes in a bundle."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol

from vrbench.config.rig import Rig
from vrbench.config.suite import Step, Suite
from vrbench.config.yaml_file import as_yaml
from vrbench.devices.ports import Operator
from vrbench.devices.simulated.stage import SimulatedOperator
from vrbench.errors import ConfigError
from vrbench.motion.generators import generate
from vrbench.motion.motion import Motion, at_speed
from vrbench.opening import Devices, accuracy_of, is_simulated, open_rig
from vrbench.permission import Permission
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


class Watcher(Protocol):
    """Told how a run goes on."""

    def take(self, name: str, index: int, total: int) -> None:
        """A take begins, the index-th of so many."""
        ...

    def moving(self, received: Mapping[str, int], done: float) -> None:
        """Poses received by stream, and the part of the movement done, 0..1."""
        ...


def record_suite(
    suite: Suite,
    rig: Rig,
    rig_name: str,
    folder: Path,
    plugins: Plugins,
    *,
    seed: int,
    watcher: Watcher,
    operator: Operator | None = None,
    permission: Permission | None = None,
) -> Bundle:
    """Records all takes of a suite into a new bundle.

    Args:
        suite: what to run.
        rig: with what.
        rig_name: the rig's path or name, for messages.
        folder: the new bundle's folder.
        plugins: for their devices.
        seed: of everything random, so that a simulated run can be made again.
        watcher: told how it goes on.
        operator: who fixes the headset anew on a real rig; a simulated one has its own.
        permission: to move a real robot; asked for at the start and after every operator prompt.

    Raises:
        ConfigError: the rig lacks what the suite needs, an option is wrong, or the folder exists.
        DeviceError: a device failed. The bundle stays, marked incomplete, with the takes so far.
    """
    if suite.mover != "robot":
        raise ConfigError(
            f"suite {suite.label} is moved by: {suite.mover}",
            field="mover",
            fix="this vrbench records suites that a robot moves; import the others' recordings",
        )
    if rig.robot is None:
        raise ConfigError(
            f"suite {suite.label} is moved by a robot, the rig has none",
            file=rig_name,
            field="robot",
        )
    references = [name for name in suite.references if getattr(rig, name) is not None]
    if not references:
        raise ConfigError(
            f"suite {suite.label} is scored against {' or '.join(suite.references)}, "
            "the rig has neither",
            file=rig_name,
            field="mocap",
        )
    simulated = is_simulated(rig, rig_name)
    motions = {name: generate(motion) for name, motion in suite.motions.items()}
    steps = list(suite.schedule())
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
        references=list(references),
        accuracy=accuracy_of(rig),
        seed=seed if simulated else None,
        versions=versions(plugins.versions()),
    )
    with ExitStack() as stack:
        devices = open_rig(rig, rig_name, plugins, seed, stack)
        stage = devices.session.stage
        hand = operator if stage is None else SimulatedOperator(stage)
        if hand is None:
            raise ConfigError("a real rig needs an operator", file=rig_name)
        if permission is not None:
            permission.again(devices.session.permit)
        inputs = {
            "suite.yaml": as_yaml(suite.canonical()),
            "rig.yaml": as_yaml(rig.model_dump(mode="json")),
        }
        bundle = Bundle.create(folder, record, inputs)
        mount = 1
        for index, step in enumerate(steps):
            if step.mount != mount:
                mount = step.mount
                devices.session.permit.revoke()
                hand.remount(mount)
                if permission is not None:
                    permission.again(devices.session.permit)
            watcher.take(step.name, index, len(steps))
            _record_step(bundle, devices, step, motions[step.case.motion], watcher)
        bundle.finish()
    return bundle


def _record_step(
    bundle: Bundle, devices: Devices, step: Step, motion: Motion, watcher: Watcher
) -> None:
    case, robot = step.case, devices.robot
    if robot is None:
        raise ValueError("a suite moved by a robot is recorded with one")
    plan = robot.plan(at_speed(motion, case.speed))
    metadata = {
        "case": case.id,
        "motion": motion.name,
        "motion_digest": motion.digest,
        "plan": plan.hash,
        "fraction": f"{plan.fraction:.9g}",
        "planned_duration_s": f"{plan.target.duration_s:.9g}",
        "stretch": f"{plan.stretch / case.speed:.9g}",
        "logger": bundle.record.device.logger,
        "prediction": bundle.record.device.prediction,
    }
    path = bundle.take_path(step.name)
    for _ in robot.prepare(plan):
        pass
    movement = robot.execute(plan)
    record_take(path, metadata, devices.sources, movement, devices.session.host, watcher.moving)
    if devices.session.stage is not None:
        bundle.write_truth(step.name, devices.session.stage.truth)
    bundle.add(
        TakeRecord(
            file=f"takes/{path.name}",
            sha256=file_digest(path),
            case=case.id,
            mount=step.mount,
            repeat=step.repeat,
            role=case.role,
            motion=motion.name,
            motion_digest=motion.digest,
            speed=case.speed,
            fraction=plan.fraction,
            stretch=plan.stretch,
        )
    )
