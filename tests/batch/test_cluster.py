"""A real cluster: a scheduler and two workers as processes of their own, one killed in mid-work."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.batch.processes import evaluator, gone, start, state, tables, until

pytest.importorskip("distributed")


@contextmanager
def dask(what: str, log: Path, *words: str, **environment: str) -> Iterator[subprocess.Popen[str]]:
    with log.open("w") as out:
        process = subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.dask_{what}", "--no-dashboard", *words],
            stdout=out,
            stderr=out,
            text=True,
            cwd=log.parent,
            env={**os.environ, **environment},
        )
        try:
            yield process
        finally:
            process.terminate()
            process.wait()


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@contextmanager
def scheduler(folder: Path, scheme: str = "tcp", *tls: str) -> Iterator[str]:
    port = free_port()
    address, log = f"{scheme}://127.0.0.1:{port}", folder / "scheduler.log"
    with dask("scheduler", log, "--host", f"{scheme}://127.0.0.1", "--port", str(port), *tls):
        until(lambda: "Scheduler at" in log.read_text())
        yield address


@contextmanager
def worker(
    address: str, log: Path, *words: str, **environment: str
) -> Iterator[subprocess.Popen[str]]:
    words = (address, "--nthreads", "1", "--no-nanny", "--local-directory", str(log.parent), *words)
    with dask("worker", log, *words, **environment) as process:
        until(lambda: "Registered to" in log.read_text())
        yield process


def evaluate(folder: Path, *words: str) -> tuple[int, str, str]:
    asked = start("evaluate", *words, cwd=folder)
    shown, told = asked.communicate()
    assert "Traceback" not in told
    return asked.returncode, shown, told


def test_a_worker_that_dies_costs_nothing_and_one_of_another_version_is_refused(
    two: tuple[Path, Path], tmp_path: Path
) -> None:
    one, other = two
    before = tables(one)
    logs = [tmp_path / f"{name}.log" for name in ("first", "second", "alien")]
    with scheduler(tmp_path) as at, worker(at, logs[0]) as first, worker(at, logs[1]) as second:
        asked = start("evaluate", "a", "b", "none", "--scheduler", at, cwd=one.parent)
        victim = int(state(evaluator(other))[1])
        assert victim in (first.pid, second.pid)
        busy = evaluator(other)
        os.kill(victim, signal.SIGKILL)
        until(lambda: gone(busy))
        _, told = asked.communicate()
        assert asked.returncode == 1
        assert "evaluated 2 of 3 runs" in told
        assert "sees no run there" in told
        assert tables(one) == tables(other) == before

        fake = tmp_path / "fake" / "vrbench"
        fake.mkdir(parents=True)
        (fake / "__init__.py").write_text("__version__ = '0.0.9'\n")
        with worker(at, logs[2], PYTHONPATH=str(fake.parent)):
            code, _, told = evaluate(one.parent, "a", "--scheduler", at)
    assert code == 2
    assert "127.0.0.1" in told
    assert "vrbench 0.0.9, here" in told


def test_a_worker_ends_what_it_began_when_its_client_is_interrupted(
    two: tuple[Path, Path], tmp_path: Path
) -> None:
    one, other = two
    before = tables(one)
    with scheduler(tmp_path) as at, worker(at, tmp_path / "worker.log"):
        asked = start("evaluate", "b", "--scheduler", at, cwd=one.parent)
        busy = evaluator(other)
        asked.send_signal(signal.SIGINT)
        _, told = asked.communicate()
        until(lambda: gone(busy))
    assert (asked.returncode, told.splitlines()[-1]) == (1, "interrupted")
    assert tables(other) == tables(one) == before


def test_a_cluster_may_be_encrypted(tmp_path: Path) -> None:
    if shutil.which("openssl") is None:
        pytest.skip("needs openssl")
    key, cert = tmp_path / "key.pem", tmp_path / "cert.pem"
    subprocess.run(
        f"openssl req -x509 -newkey rsa:2048 -nodes -days 1 -subj /CN=localhost "
        f"-keyout {key} -out {cert}".split(),
        check=True,
        capture_output=True,
    )
    files = ("--tls-ca-file", str(cert), "--tls-cert", str(cert), "--tls-key", str(key))
    mine = ("--tls-ca", str(cert), "--tls-cert", str(cert), "--tls-key", str(key))
    with scheduler(tmp_path, "tls", *files) as at, worker(at, tmp_path / "worker.log", *files):
        code, _, told = evaluate(tmp_path, "none", "--scheduler", at, *mine)
        assert (code, "sees no run there" in told) == (1, True), told
        code, _, told = evaluate(tmp_path, "none", "--scheduler", at)
    assert code == 2
    assert "give --tls-ca, --tls-cert and --tls-key" in told


@pytest.mark.parametrize("greeting", [b"", b"SSH-2.0-OpenSSH_9.6\r\n"])
def test_who_is_no_scheduler_is_told_so(tmp_path: Path, greeting: bytes) -> None:
    with socket.create_server(("127.0.0.1", 0)) as stranger:
        at = f"tcp://127.0.0.1:{stranger.getsockname()[1]}"
        asked = start("evaluate", "none", "--scheduler", at, cwd=tmp_path)
        guest, _ = stranger.accept()
        with guest:
            guest.sendall(greeting)
            _, told = asked.communicate(timeout=60)
    assert (asked.returncode, f"no scheduler answers at {at}" in told) == (1, True), told


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (("--scheduler", "tcp://127.0.0.1:1"), 1, "no scheduler answers at tcp://127.0.0.1:1"),
        (("--scheduler", "127.0.0.1"), 2, "'127.0.0.1' is no scheduler's address"),
        (("--scheduler", "tcp://127.0.0.1:99999"), 2, "is no scheduler's address"),
        (("--scheduler", "tls://127.0.0.1:1", "--tls-ca", "ca"), 2, "give --tls-ca, --tls-cert"),
        (("--scheduler", "tcp://127.0.0.1:1", "--jobs", "1"), 2, "stands beside --scheduler"),
        (("--scheduler", "tcp://127.0.0.1:1", "--tls-ca", "ca"), 2, "an encrypted scheduler"),
        (("--tls-ca", "ca"), 2, "is for a scheduler's connection"),
    ],
)
def test_what_cannot_be_is_refused(
    tmp_path: Path, words: tuple[str, ...], code: int, says: str
) -> None:
    (tmp_path / "ca").touch()
    found, _, told = evaluate(tmp_path, "none", *words)
    assert (found, says in told) == (code, True), told
