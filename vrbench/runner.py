"""Runs: suite x rig -> takes in a bundle, whoever moves the headset."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from vrbench.config.case import UNCOVERED
from vrbench.config.rig import Rig
from vrbench.config.suite import Suite
from vrbench.config.yaml_file import as_yaml
from vrbench.devices.ports import Operator
from vrbench.devices.simulated.stage import SimulatedOperator
from vrbench.errors import ConfigError, VrbenchError
from vrbench.plugin.manager import Plugins
from vrbench.plugin.report import newest
from vrbench.recording.guard import DiskFullError
from vrbench.results.bundle import Bundle, require_new
from vrbench.results.lock import locked
from vrbench.results.record import DeviceRecord, RunRecord, utc_now, versions
from vrbench.running.capture import Person, PersonMover, SimulatedPerson, persons_references
from vrbench.running.feasibility import check_feasible
from vrbench.running.forecast import check_room, run_bytes
from vrbench.running.movers import Mover, RobotMover, lacking, robots_references
from vrbench.running.opening import (
    Devices,
    accuracy_of,
    is_simulated,
    nominal_rates,
    occlusion_of,
    open_rig,
)
from vrbench.running.permission import Permission
from vrbench.running.resuming import ended, left, resumed
from vrbench.running.reusing import reused
from vrbench.running.steps import Watcher, record_step, skip_step
from vrbench.trajectory import NS

# Of everything random, where nobody says another.
SEED = 1


class InterruptedRunError(VrbenchError):
    """Somebody stopped the run by Ctrl-C; exit code 1."""

    exit_code = 1


def record_suite(
    suite: Suite,
    rig: Rig,
    rig_name: str,
    folder: Path,
    plugins: Plugins,
    *,
    watcher: Watcher,
    seed: int | None = None,
    operator: Operator | None = None,
    person: Person | None = None,
    permission: Permission | None = None,
    licence: str | None = None,
    consent: str | None = None,
    resume: bool = False,
    calibration: Path | None = None,
) -> Bundle:
    """Records all takes of a suite into a bundle.

    Args:
        suite: what to run.
        rig: with what.
        rig_name: the rig's path or name, for messages.
        folder: the bundle's folder: new, or that of the run that is gone on with.
        plugins: for their devices.
        watcher: told how it goes on.
        seed: of everything random, so that a simulated run can be made again; 1, or that of the run
            that is gone on with.
        operator: who fixes the headset anew on a real rig; a simulated one has its own.
        person: who moves, where the suite says so; a simulated rig has a person of its own.
        permission: to move a real robot; asked for at the start and after every operator prompt.
        licence: under which a person's motion may be used.
        consent: how the person agreed to that.
        resume: whether to go on with a run, and to record only what of it isn't whole.
        calibration: a run whose last calibration opens this one, as nobody has touched the headset
            since.

    Raises:
        ConfigError: the suite does what its takes are too short for, the rig lacks what the suite
            needs, an option is wrong, the folder exists, is in use, has too little room or holds
            another run, the calibration can't be reused, or a real person's motion has no licence
            or consent.
        DeviceError: a device failed or was lost. The bundle stays, marked failed, with what was
            recorded.
        DiskFullError: the disk is full; the bundle stays, marked incomplete.
        InterruptedRunError: somebody pressed Ctrl-C; the same.
    """
    if resume:
        begun = Bundle.begun(folder).record
        seed = begun.seed if seed is None else seed
    seed = SEED if seed is None else seed
    check_feasible(suite, suite.label)
    record = _record(suite, rig, rig_name, plugins, seed, permission, licence, consent)
    if suite.mover == "person":
        rig = rig.model_copy(update={"robot": None})
    inputs = {
        "suite.yaml": as_yaml(suite.canonical()),
        "rig.yaml": as_yaml(rig.model_dump(mode="json")),
    }
    reports = newest(rig.things)
    if reports is not None:
        inputs["conformance.json"] = reports
    steps = list(suite.schedule())
    todo, mount, bundle, earlier = steps, 1, Bundle(folder, record), None
    with ExitStack() as stack:
        if not resume:
            require_new(folder)
        stack.enter_context(locked(folder))
        if resume:
            bundle = resumed(folder, record, inputs)
            todo, mount = left(bundle, steps)
        elif calibration is not None:
            earlier = reused(calibration, suite, record, inputs)
            todo = [step for step in steps if step.name not in earlier.takes]
        if todo:
            check_room(folder, run_bytes(suite, todo, nominal_rates(rig, rig_name, plugins)))
            devices = open_rig(rig, rig_name, plugins, seed, stack)
            _carry_on_from(bundle if earlier is None else earlier.run, devices, mount)
            mover = _mover(suite, devices, operator, person, permission, mount, resume=resume)
            mover.begin()
        if not resume:
            bundle = Bundle.create(folder, record, inputs)
        if earlier is not None:
            earlier.enter(bundle)
        order = {step.name: place for place, step in enumerate(steps)}
        with _marked(bundle, len(steps)):
            for step in todo:
                watcher.take(step.name, order[step.name], len(steps))
                why = lacking(step.case, devices.profile)
                if why is None:
                    record_step(bundle, devices, step, mover, watcher, suite)
                else:
                    skip_step(bundle, step, suite, why)
        bundle.record.takes.sort(key=lambda take: order[take.name])
        bundle.finish()
    return bundle


def _record(
    suite: Suite,
    rig: Rig,
    rig_name: str,
    plugins: Plugins,
    seed: int,
    permission: Permission | None,
    licence: str | None,
    consent: str | None,
) -> RunRecord:
    """What a run says of itself before anything is recorded.

    Raises:
        ConfigError: the rig lacks what the suite needs.
    """
    simulated = is_simulated(rig, rig_name)
    if suite.mover == "person":
        references = persons_references(suite, rig, rig_name, licence, consent, simulated=simulated)
    else:
        references = robots_references(suite, rig, rig_name)
    now = utc_now()
    return RunRecord(
        kind="simulated" if simulated else "recorded",
        created=now.isoformat(),
        suite=suite.canonical(),
        suite_digest=suite.digest,
        lab=rig.lab,
        # no device says when it was switched on: a lab visit is a day
        sitting="1" if simulated else now.date().isoformat(),
        device=DeviceRecord(
            headset=rig.headset.model, firmware=rig.headset.firmware, logger=rig.headset.plugin
        ),
        references=references,
        accuracy=accuracy_of(rig),
        occlusion=occlusion_of(suite, rig, rig_name, plugins),
        licence=licence,
        consent=consent,
        seed=seed if simulated else None,
        plans=None if permission is None else permission.planned.hash,
        versions=versions(plugins.versions()),
    )


@contextmanager
def _marked(bundle: Bundle, total: int) -> Iterator[None]:
    """Marks the bundle as it ended, where it didn't end well."""
    try:
        yield
    except KeyboardInterrupt:
        done = sum(take.status == "ok" for take in bundle.record.takes)
        bundle.end("incomplete", "interrupted")
        raise InterruptedRunError(
            f"interrupted: {done} of {total} takes are recorded",
            file=bundle.folder,
            fix="go on with --resume",
        ) from None
    except BaseException as error:
        # a full disk may have no room for this either: then it stays marked incomplete
        with suppress(OSError):
            full = isinstance(error, DiskFullError)
            bundle.end("incomplete" if full else "failed", str(error))
        raise


def _carry_on_from(bundle: Bundle, devices: Devices, mount: int) -> None:
    """Simulated devices go on where the last whole take ended."""
    session = devices.session
    if session.stage is None:
        return
    session.stage.mount = mount
    last = ended(bundle)
    if last is not None:
        session.host.wait((last - session.host.now()) / NS)


def _mover(
    suite: Suite,
    devices: Devices,
    operator: Operator | None,
    person: Person | None,
    permission: Permission | None,
    mount: int,
    *,
    resume: bool,
) -> Mover:
    """Who moves the headset; a simulated rig has its own operator and its own person."""
    session = devices.session
    if devices.robot is None:
        who = person if session.stage is None else SimulatedPerson()
        if who is None:
            raise ConfigError("a person moves in this suite, and nobody is there")
        return PersonMover(suite, who, session)
    hand = operator if session.stage is None else SimulatedOperator(session.stage, session.host)
    if hand is None:
        raise ConfigError("a real rig needs an operator")
    # who goes on with a run can't know what is covered: the operator is asked
    known = None if resume and suite.conditions else UNCOVERED
    return RobotMover(
        *(suite, devices.robot, session, devices.profile, hand, permission),
        mount=mount,
        level=known,
    )
