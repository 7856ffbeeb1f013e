"""The route `quest`: the Unity logger on the headset, live by UDP, its whole log by cable after."""

from __future__ import annotations

import secrets
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Literal, Self

from pydantic import Field

from vrbench.devices.link import Link
from vrbench.devices.listening import Listening, Place
from vrbench.devices.ports import Finding, Session
from vrbench.devices.specs import HeadsetProfile, HeadsetSpec
from vrbench.errors import DeviceError
from vrbench.streams import Columns
from vrbench_quest.adb import Adb, findings, state_of
from vrbench_quest.receiver import Receiver
from vrbench_quest.stand_in import stand_in
from vrbench_quest.wire import TOKEN_BYTES

ANSWER_S = 3.0
LAST_POSES_S = 3.0
LOOK_S = 0.02
ACTIVITY = "com.unity3d.player.UnityPlayerActivity"


class Options(Listening):
    """Where the logger's poses arrive, and what the cable is used for."""

    listen: Place = Field(
        "127.0.0.1:9750", description="address of this PC that the headset sends to; port 0: any"
    )
    token: str | None = Field(
        None,
        pattern=r"^[0-9a-f]{16}$",
        description="secret of the session; drawn anew where not given",
    )
    moment: Literal["update", "render"] = Field(
        "render", description="poses as in Update, or those right before rendering"
    )
    adb: bool = Field(True, description="start the app, and look at the headset, by cable")
    serial: str | None = Field(None, description="which device, where several are attached")
    package: str = Field(
        "org.vrbench.logger", pattern=r"^[A-Za-z0-9_.]+$", description="name of the lab's app"
    )
    pull: Path | None = Field(None, description="folder that each take's log is copied to by adb")
    mannequin: bool = Field(
        False, description="`rig check` switches the proximity sensor off, so that it stays awake"
    )
    wait_s: float = Field(120.0, ge=0, description="how long to wait for the logger [s]")
    quiet: bool = Field(False, description="print nothing")


class QuestLogger:
    """The logger's app on one headset, kept over as many takes as the suite has.

    Entered, it listens and starts the app where a cable is there; the first take waits for it.

    Attributes:
        link: its poses and its clock.
        token: of the session, as the app has to be given it.
        pulled: logs copied so far.
    """

    def __init__(self, options: Options, _profile: HeadsetProfile | None, session: Session) -> None:
        self.link = Link()
        self.token = options.token or secrets.token_hex(TOKEN_BYTES)
        self.pulled: list[Path] = []
        self._options, self._host = options, session.host
        self._adb = Adb(options.serial) if options.adb else None
        self._stack = ExitStack()
        self._receiver: Receiver | None = None
        self._take = ""

    @property
    def receiver(self) -> Receiver:
        """What listens, once it does."""
        assert self._receiver is not None
        return self._receiver

    def __enter__(self) -> Self:
        try:
            self.listen()
            if self._adb is not None:
                self._adb.device()
                self._start_app(self._adb)
        except BaseException:
            self._stack.close()
            raise
        return self

    def listen(self) -> None:
        """Listens, and tells what the app has to be told."""
        options = self._options
        self._receiver = self._stack.enter_context(
            Receiver(
                self.link,
                self._host,
                address=options.host,
                port=options.port,
                token=bytes.fromhex(self.token),
                moment=options.moment,
            )
        )
        if not options.quiet and not options.adb:
            sys.stderr.write(
                f"\n  Tell the logger: address {options.host}, port {self._receiver.port},"
                f" token {self.token}\n\n"
            )

    def __exit__(self, *error: object) -> None:
        self._stack.close()

    def start(self, take: str) -> None:
        """The logger sends and logs this take from now on.

        Raises:
            DeviceError: it isn't heard, or doesn't answer.
        """
        self._until(lambda: self.missing is None, ANSWER_S if self._take else self._options.wait_s)
        missing = self.missing
        if missing is not None:
            raise DeviceError(f"can't record {take}: {missing[0]}", field="headset", fix=missing[1])
        facts = dict(state_of(self._adb)) if self._adb is not None else {}
        facts["pose_time"] = "when it was sampled; its prediction is the runtime's"
        self.link.begin(self._host.now(), {**facts, "moment": self._options.moment})
        self._take = take
        if not self.receiver.start(take, ANSWER_S):
            self.link.finish(self._host.now())
            raise DeviceError(
                "the logger doesn't answer", field="headset", fix="is the headset awake?"
            )

    def facts(self) -> dict[str, str]:
        """What the app says of itself: see `vrbench.devices.ports.facts_of`."""
        told = {} if self._receiver is None else self._receiver.facts or {}
        names = {"app": "logger_version", "prediction": "prediction"}
        facts = {name: str(told[key]) for key, name in names.items() if key in told}
        return {**facts, "world": self.link.world}

    def read(self) -> Columns:
        """What has arrived since the last call, and whose times are known."""
        return self.link.take()

    def stop(self) -> None:
        """The take ends; its log is copied where the rig says so. Never fails for the log."""
        self.link.end(self._host.now())
        answered = self.receiver.stop(ANSWER_S)
        self._until(lambda: self.link.complete, LAST_POSES_S if answered else 0.0)
        if self._adb is not None:
            self.link.tell(self._host.now(), "headset-after", state_of(self._adb))
        if self._adb is not None and self._options.pull is not None:
            try:
                self.pulled += self._adb.pull(self._options.package, self._take, self._options.pull)
            except DeviceError as error:
                self.link.tell(self._host.now(), "log", {"why": str(error)})
        self.link.finish(self._host.now())

    @property
    def missing(self) -> tuple[str, str] | None:
        """What keeps it from being recorded, and what to do; None where nothing does."""
        if self._receiver is None or not self._receiver.connected:
            return (
                "no logger is heard",
                f"start the app; it sends to {self._options.host}, port"
                f" {self._receiver.port if self._receiver else self._options.port},"
                " in the same network",
            )
        if not self.link.synchronised:
            return "the headset's clock isn't known yet", "wait a moment"
        return None

    def findings(self, wait_s: float) -> Iterator[Finding]:
        """What `vrbench rig check` tells of the logger, after waiting for it for so long."""
        self._until(lambda: self.missing is None, wait_s)
        missing = self.missing
        if missing is not None:
            yield Finding(False, *missing)
            return
        facts = self.receiver.facts or {}
        yield Finding(True, f"the logger runs: {facts.get('model', 'no model told')}")
        yield Finding(True, f"clock known to {self.link.bound_s * 1e3:.2f} ms")

    def _start_app(self, adb: Adb) -> None:
        options = self._options
        words = ["am", "start", "-n", f"{options.package}/{ACTIVITY}"]
        for name, value in (
            ("vrbench_host", options.host),
            ("vrbench_port", str(self.receiver.port)),
            ("vrbench_token", self.token),
        ):
            words += ["-e", name, value]
        adb.shell(*words)

    def _until(self, done: Callable[[], bool], seconds: float) -> None:
        end = time.monotonic() + seconds
        while not done() and time.monotonic() < end:
            time.sleep(LOOK_S)


def check(options: Options, session: Session) -> Iterator[Finding]:
    """The headset by cable, then the logger by network."""
    if options.adb:
        bad = False
        for finding in findings(Adb(options.serial), mannequin=options.mannequin):
            bad = bad or not finding.ok
            yield finding
        if bad:
            return
    logger = QuestLogger(options, None, session)
    with logger._stack:
        try:
            logger.listen()
            if logger._adb is not None:
                logger._start_app(logger._adb)
        except DeviceError as error:
            yield Finding(False, error.what, error.fix or "")
            return
        yield from logger.findings(options.wait_s)


HEADSET = HeadsetSpec(
    name="quest",
    title="Quest by its native Unity logger: UDP live, the whole log by adb",
    options=Options,
    open=QuestLogger,
    check=check,
    emulator="vrbench_quest.emulator",
    stand_in=stand_in,
)
