"""Runs: suite x rig -> takes in a bundle."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from vrbench.config.rig import SIMULATED, Rig
from vrbench.config.suite import Step, Suite
from vrbench.config.yaml_file import as_yaml
from vrbench.devices.ports import (
    HeadsetProfile,
    Operator,
    PoseSource,
    Robot,
    Session,
)
from vrbench.devices.simulated.stage import SimulatedOperator, Stage, VirtualClock
from vrbench.errors import ConfigError
from vrbench.motion.generators import generate
from vrbench.motion.motion import Motion, at_speed
from vrbench.permission import Permission
from vrbench.plugin.manager import Plugins, check_options, pick
from vrbench.recording.recorder import record_take
from vrbench.results.bundle import (
    AccuracyRecord,
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


@dataclass(frozen=True, slots=True)
class Devices:
    """A rig's devices, connected."""

    headset: PoseSource
    robot: Robot
    operator: Operator
    session: Session
    mocap: PoseSource | None = None

    @property
    def sources(self) -> list[PoseSource]:
        return [x for x in (self.robot, self.headset, self.mocap) if x is not None]


def record_suite(
    suite: Suite,
    rig: Rig,
    rig_name: str,
    folder: Path,
    plugins: Plugins,
    *,
    seed: int,
    watcher: Watcher,
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
    profile = _profile(rig, rig_name, plugins)
    motions = {name: generate(motion) for name, motion in suite.motions.items()}
    steps = list(suite.schedule())
    record = RunRecord(
        kind="simulated",
        created=utc_now().isoformat(),
        suite=suite.canonical(),
        suite_digest=suite.digest,
        lab=rig.lab,
        sitting="1",
        device=DeviceRecord(
            headset=rig.headset.model, firmware=rig.headset.firmware, logger=rig.headset.plugin
        ),
        references=[name for name in suite.references if getattr(rig, name) is not None],
        accuracy=accuracy_of(rig),
        seed=seed,
        versions=versions(plugins.versions()),
    )
    with ExitStack() as stack:
        devices = _open(rig, rig_name, profile, plugins, seed, stack)
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
                devices.operator.remount(mount)
                if permission is not None:
                    permission.again(devices.session.permit)
            watcher.take(step.name, index, len(steps))
            _record_step(bundle, devices, step, motions[step.case.motion], watcher)
        bundle.finish()
    return bundle


def accuracy_of(rig: Rig) -> dict[str, AccuracyRecord]:
    """What the rig states of its references."""
    stated = {"robot": rig.robot, "mocap": rig.mocap}
    return {
        name: AccuracyRecord(metres=device.accuracy.value, source=device.accuracy.source)
        for name, device in stated.items()
        if device is not None and device.accuracy is not None
    }


def _profile(rig: Rig, rig_name: str, plugins: Plugins) -> HeadsetProfile:
    spec = pick(
        plugins.headsets, rig.headset.model, "headset", field="headset.device", file=rig_name
    )
    if spec.profile is None:
        raise ConfigError(
            f"{spec.name} is a route to headsets, not a headset model",
            file=rig_name,
            field="headset.device",
            fix="name the model that is benchmarked",
        )
    return spec.profile


def _open(
    rig: Rig,
    rig_name: str,
    profile: HeadsetProfile,
    plugins: Plugins,
    seed: int,
    stack: ExitStack,
) -> Devices:
    if rig.robot is None:
        raise ConfigError(
            "the suite moves by robot, the rig has none", file=rig_name, field="robot"
        )
    chosen = [device for device in (rig.headset, rig.robot, rig.mocap) if device is not None]
    if any(device.plugin != SIMULATED for device in chosen):
        raise ConfigError(
            "this vrbench runs simulated rigs only; real devices come with their plugins",
            file=rig_name,
            fix="rig sim:quest-2, or `vrbench import` recordings",
        )
    stage = Stage()
    session = Session(VirtualClock(), rig.mounting.tcp_eye.transform(), seed, stage)
    route = pick(
        plugins.headsets, rig.headset.plugin, "headset", field="headset.plugin", file=rig_name
    )
    if route.open is None:
        raise ConfigError(
            f"{route.name} has no live connection",
            file=rig_name,
            field="headset.plugin",
            fix="name a route, or import its recordings",
        )
    robots = pick(plugins.robots, rig.robot.plugin, "robot", field="robot.plugin", file=rig_name)
    robot_options = check_options(
        rig.robot.options, robots.options, field="robot.options", file=rig_name
    )
    headset_options = check_options(
        rig.headset.options, route.options, field="headset.options", file=rig_name
    )
    return Devices(
        robot=stack.enter_context(robots.open(robot_options, session)),
        headset=stack.enter_context(route.open(headset_options, profile, session)),
        operator=SimulatedOperator(stage),
        session=session,
        mocap=_open_mocap(rig, rig_name, plugins, session, stack),
    )


def _open_mocap(
    rig: Rig, rig_name: str, plugins: Plugins, session: Session, stack: ExitStack
) -> PoseSource | None:
    if rig.mocap is None:
        return None
    spec = pick(plugins.mocap, rig.mocap.plugin, "mocap", field="mocap.plugin", file=rig_name)
    options = check_options(rig.mocap.options, spec.options, field="mocap.options", file=rig_name)
    return stack.enter_context(spec.open(options, session))


def _record_step(
    bundle: Bundle, devices: Devices, step: Step, motion: Motion, watcher: Watcher
) -> None:
    case = step.case
    plan = devices.robot.plan(at_speed(motion, case.speed))
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
    for _ in devices.robot.prepare(plan):
        pass
    movement = devices.robot.execute(plan)
    record_take(path, metadata, devices.sources, movement, devices.session.host, watcher.moving)
    truth: dict[str, Any] = devices.session.stage.truth
    bundle.write_truth(step.name, truth)
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
