"""Runs: suite x rig -> takes in a bundle, whoever moves the headset."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Protocol

from vrbench.capture import Person, PersonMover, SimulatedPerson, persons_references
from vrbench.config.rig import Rig
from vrbench.config.suite import Step, Suite
from vrbench.config.yaml_file import as_yaml
from vrbench.devices.ports import Operator
from vrbench.devices.simulated.stage import SimulatedOperator
from vrbench.errors import ConfigError
from vrbench.movers import Mover, RobotMover, robots_references
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
    person: Person | None = None,
    permission: Permission | None = None,
    licence: str | None = None,
    consent: str | None = None,
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
        person: who moves, where the suite says so; a simulated rig has a person of its own.
        permission: to move a real robot; asked for at the start and after every operator prompt.
        licence: under which a person's motion may be used.
        consent: how the person agreed to that.

    Raises:
        ConfigError: the rig lacks what the suite needs, an option is wrong, the folder exists, or
            a real person's motion has no licence or consent.
        DeviceError: a device failed. The bundle stays, marked incomplete, with the takes so far.
    """
    simulated = is_simulated(rig, rig_name)
    if suite.mover == "person":
        references = persons_references(suite, rig, rig_name, licence, consent, simulated=simulated)
        rig = rig.model_copy(update={"robot": None})
    else:
        references = robots_references(suite, rig, rig_name)
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
        references=references,
        accuracy=accuracy_of(rig),
        licence=licence,
        consent=consent,
        seed=seed if simulated else None,
        versions=versions(plugins.versions()),
    )
    inputs = {
        "suite.yaml": as_yaml(suite.canonical()),
        "rig.yaml": as_yaml(rig.model_dump(mode="json")),
    }
    steps = list(suite.schedule())
    with ExitStack() as stack:
        devices = open_rig(rig, rig_name, plugins, seed, stack)
        mover = _mover(suite, devices, operator, person, permission)
        mover.begin()
        bundle = Bundle.create(folder, record, inputs)
        for index, step in enumerate(steps):
            watcher.take(step.name, index, len(steps))
            _record_step(bundle, devices, step, mover, watcher)
        bundle.finish()
    return bundle


def _mover(
    suite: Suite,
    devices: Devices,
    operator: Operator | None,
    person: Person | None,
    permission: Permission | None,
) -> Mover:
    """Who moves the headset; a simulated rig has its own operator and its own person."""
    session = devices.session
    if devices.robot is None:
        who = person if session.stage is None else SimulatedPerson()
        if who is None:
            raise ConfigError("a person moves in this suite, and nobody is there")
        return PersonMover(suite, who, session)
    hand = operator if session.stage is None else SimulatedOperator(session.stage)
    if hand is None:
        raise ConfigError("a real rig needs an operator")
    return RobotMover(suite, devices.robot, session, hand, permission)


def _record_step(
    bundle: Bundle, devices: Devices, step: Step, mover: Mover, watcher: Watcher
) -> None:
    """Records one take, and enters it into the bundle."""
    case, session = step.case, devices.session
    movement = mover.ready(step)
    metadata = {
        "case": case.id,
        "motion": movement.motion,
        "motion_digest": movement.digest,
        "logger": bundle.record.device.logger,
        "prediction": bundle.record.device.prediction,
    }
    path = bundle.take_path(step.name)
    take = TakeRecord(
        file=f"takes/{path.name}",
        sha256="",
        case=case.id,
        mount=step.mount,
        repeat=step.repeat,
        role=case.role,
        motion=movement.motion,
        motion_digest=movement.digest,
    )
    plan = movement.plan
    if plan is not None:
        take.speed, take.fraction, take.stretch = case.speed, plan.fraction, plan.stretch
        metadata |= {
            "plan": plan.hash,
            "fraction": f"{plan.fraction:.9g}",
            "planned_duration_s": f"{plan.target.duration_s:.9g}",
            "stretch": f"{plan.stretch / case.speed:.9g}",
        }
    record_take(path, metadata, devices.sources, movement.steps, session.host, watcher.moving)
    if session.stage is not None:
        bundle.write_truth(step.name, session.stage.truth)
    take.sha256 = file_digest(path)
    bundle.add(take)
