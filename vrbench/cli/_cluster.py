"""The client of a dask.distributed cluster: hands it units of work, and nothing else.

A scheduler is trusted: what it and its workers say is unpickled here, and they run what they are
sent.
"""

from __future__ import annotations

import logging
import re
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vrbench.errors import ConfigError, DataError, DeviceError

if TYPE_CHECKING:
    from vrbench.batch.unit import Outcome, Unit

ADDRESS = re.compile(r"^(tcp|tls)://(\[[0-9a-fA-F:.]+\]|[^\s/:]+):(?P<port>\d{1,5})$")
# How long a scheduler, or the first worker, may take to answer [s].
ANSWER_S = 5.0
# How long work waits for a worker when all are gone [s].
LEFT_ALONE_S = 60.0
LOOK_S = 2.0
# Asked by way of `eval`, which workers of any version have.
BUILD = "__import__('vrbench.batch.build', fromlist=['build']).build()"
VERSION = "__import__('vrbench').__version__"


@dataclass(frozen=True, slots=True)
class Tls:
    """Files for an encrypted connection: certificates of the authority and of the client, a key."""

    ca: Path | None = None
    cert: Path | None = None
    key: Path | None = None


@contextmanager
def cluster(address: str, tls: Tls) -> Iterator[Any]:
    """A client of the scheduler at an address, which has workers.

    Raises:
        ConfigError: no such address can be, or dask.distributed isn't installed.
        DeviceError: no scheduler answers there, or it has no workers.
    """
    _check(address, tls)
    try:
        from distributed import Client
        from distributed.security import Security
    except ImportError:
        raise ConfigError(
            "it needs dask.distributed, which is not installed",
            field="--scheduler",
            fix="pip install 'vrbench[cluster]'",
        ) from None
    # it logs what the errors here say, and more of it
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    given = {
        "tls_ca_file": tls.ca,
        "tls_client_cert": tls.cert,
        "tls_client_key": tls.key,
    }
    files = {name: str(path) for name, path in given.items() if path is not None}
    try:
        security = Security(require_encryption=address.startswith("tls:"), **files)
        given_files = security.get_connection_args("client")
    except (OSError, TypeError, ValueError) as error:
        raise ConfigError(
            f"can't be used: {_first_line(error)}",
            field="--tls-...",
            fix="PEM files: of the authority, of the client, and its key",
        ) from None
    if address.startswith("tls:") and given_files.get("ssl_context") is None:
        raise ConfigError(
            "an encrypted scheduler asks for certificates",
            field="--scheduler",
            fix="give --tls-ca, --tls-cert and --tls-key",
        )
    _greet(address, given_files)
    try:
        client = Client(address, timeout=ANSWER_S, security=security)
    except (OSError, TypeError, ValueError) as error:
        raise _silent(address, error) from None
    try:
        with suppress(TimeoutError):
            client.wait_for_workers(1, timeout=ANSWER_S)
        if not _workers(client):
            raise DeviceError(
                f"the scheduler at {address} has no workers",
                field="--scheduler",
                fix=f"`dask worker {address}` starts one",
            )
        yield client
    finally:
        client.close(timeout=ANSWER_S)


def _greet(address: str, connection: Mapping[str, Any]) -> None:
    """Has the scheduler say what it is: dask's client waits for ever for one that says nothing.

    Raises:
        DeviceError: nobody answers in time, or somebody else does.
    """
    import asyncio

    from distributed.comm import connect

    async def identity() -> object:
        comm = await connect(address, timeout=ANSWER_S, **connection)
        try:
            await comm.write({"op": "identity", "reply": True})
            return await comm.read()
        finally:
            comm.abort()

    try:
        found = asyncio.run(asyncio.wait_for(identity(), ANSWER_S))
    except Exception as error:  # what a stranger says may be taken for anything
        raise _silent(address, error) from None
    what = found.get("type") if isinstance(found, Mapping) else None
    if what != "Scheduler":
        raise _silent(address, f"a {what or 'stranger'} does")


def _silent(address: str, why: object) -> DeviceError:
    why = _first_line(why) if isinstance(why, BaseException) else why
    return DeviceError(
        f"no scheduler answers at {address}: {why}",
        field="--scheduler",
        fix="`dask scheduler` starts one and prints its address",
    )


def _check(address: str, tls: Tls) -> None:
    found = ADDRESS.match(address)
    if found is None or not 0 < int(found["port"]) < 1 << 16:
        raise ConfigError(
            f"{address!r} is no scheduler's address",
            field="--scheduler",
            fix="tcp://HOST:PORT, or tls://HOST:PORT",
        )
    if any((tls.ca, tls.cert, tls.key)) and not address.startswith("tls:"):
        raise ConfigError(
            "certificates are for an encrypted scheduler", field="--scheduler", fix="tls://..."
        )


def _first_line(error: BaseException) -> str:
    return (str(error) or type(error).__name__).splitlines()[0]


def _workers(client: Any) -> Mapping[str, Mapping[str, Any]]:
    found: Mapping[str, Mapping[str, Any]] = client.scheduler_info(n_workers=-1)["workers"]
    return found


def refuse_unlike(client: Any) -> dict[str, str]:
    """What all workers evaluate with: the same as here.

    Raises:
        ConfigError: a worker has another version of something; all that have are named.
    """
    from vrbench.batch.build import build, differences

    here = build()
    told = []
    for worker, there in client.run(eval, BUILD, on_error="return").items():
        if isinstance(there, BaseException):
            version = client.run(eval, VERSION, workers=[worker], on_error="return")[worker]
            found = f"no vrbench: {version}" if isinstance(version, BaseException) else version
            told.append(f"{worker}: vrbench {found}, here {here['vrbench']}")
        elif unlike := differences(here, there):
            told.append(f"{worker}: {'; '.join(unlike)}")
    if told:
        raise ConfigError(
            f"workers that would give other numbers: {'; '.join(told)}",
            field="--scheduler",
            fix="install the same versions there",
        )
    return here


def perform_there(client: Any, address: str, units: Sequence[Unit]) -> Iterator[Outcome]:
    """Has the units done by the cluster; yields outcomes as they come.

    What a worker had that dies is given to another.
    """
    from distributed import wait

    from vrbench.batch.pool import perform_apart
    from vrbench.batch.unit import Outcome

    waiting = {client.submit(perform_apart, unit, pure=False): unit for unit in units}
    seen = time.monotonic()
    try:
        while waiting:
            with suppress(TimeoutError):
                wait(list(waiting), timeout=LOOK_S, return_when="FIRST_COMPLETED")
            for future in [future for future in waiting if future.done()]:
                unit = waiting.pop(future)
                error = future.exception() if future.status == "error" else None
                if future.status == "finished":
                    yield future.result()
                else:
                    why = _first_line(error) if error else f"the cluster lost it ({future.status})"
                    yield Outcome(unit, error=DataError(why, file=unit.run))
            if _workers(client):
                seen = time.monotonic()
            if client.status != "running" or time.monotonic() - seen > LEFT_ALONE_S:
                gone = DeviceError("the scheduler, or every worker of it, is gone", file=address)
                yield from (Outcome(unit, error=gone) for unit in waiting.values())
                return
    finally:
        with suppress(Exception):
            client.cancel(list(waiting))
