"""A real Monado with a head that is put where we say, located through the plugin.

    unshare -rn python monado.py FOLDER

Run by the tests in a network of its own: Monado's remote driver listens to everybody. Prints the
largest difference, the flags, and how many poses there were.
"""

import fcntl
import os
import socket
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

MANIFEST = "/usr/share/openxr/1/openxr_monado.json"
SIOCGIFFLAGS, SIOCSIFFLAGS, IFF_UP = 0x8913, 0x8914, 1
PORT = 4242
MAGIC = b"mndrmt3\0"
CENTRE = slice(104, 132)  # xyzw and xyz, float32
# Where Monado's remote head starts, and so the origin of LOCAL.
START = np.array([0.0, 1.6, 0.0])
POSES = 30


def raise_loopback():
    with socket.socket() as probe:
        name = struct.pack("16sh14x", b"lo", 0)
        flags = struct.unpack("16sh14x", fcntl.ioctl(probe, SIOCGIFFLAGS, name))[1]
        fcntl.ioctl(probe, SIOCSIFFLAGS, struct.pack("16sh14x", b"lo", flags | IFF_UP))


def connect():
    """The driver's socket, and a message of it: it greets with two, one like those it takes."""
    head = socket.create_connection(("127.0.0.1", PORT), 5)
    greeting = head.recv(1 << 16)
    return head, greeting[: len(greeting) // 2]


def main(folder):
    raise_loopback()
    os.environ.update(
        XDG_RUNTIME_DIR=folder,
        XR_RUNTIME_JSON=MANIFEST,
        XRT_COMPOSITOR_NULL="1",
        P_OVERRIDE_ACTIVE_CONFIG="remote",
    )
    from vrbench_openxr.runtime import Runtime

    # the service takes its orders from its input, so that has to stay open
    service = subprocess.Popen(
        ["monado-service"], stdin=subprocess.PIPE, stdout=sys.stderr, stderr=sys.stderr
    )
    try:
        end = time.monotonic() + 20
        while not list(Path(folder).glob("monado_comp_ipc*")) and time.monotonic() < end:
            time.sleep(0.05)
        head, message = connect()
        rng = np.random.default_rng(1)
        worst, flags = 0.0, set()
        with head, Runtime() as runtime:
            for _ in range(POSES):
                q = rng.normal(size=4)
                q /= np.linalg.norm(q)
                p = rng.normal(size=3)
                put = bytearray(message)
                put[: len(MAGIC)] = MAGIC
                put[CENTRE] = np.array([*q, *p], "<f4").tobytes()
                head.sendall(put)
                time.sleep(0.05)
                located = runtime.locate()
                found = np.array(located.pose)
                sign = np.sign(found[3:] @ q)
                wrong = found - [*(p - START), *(sign * q)]
                worst, flags = max(worst, np.abs(wrong).max()), flags | {located.flags}
        sys.stdout.write(f"worst {worst:.3g} flags {sorted(flags)} poses {POSES}\n")
    finally:
        service.terminate()
        service.wait(10)


if __name__ == "__main__":
    main(sys.argv[1])
