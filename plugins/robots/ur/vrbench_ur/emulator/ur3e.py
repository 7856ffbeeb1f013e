"""Runs the emulator of a UR3e: `python -m vrbench_ur.emulator.ur3e`."""

from __future__ import annotations

import sys

from vrbench_ur.emulator.__main__ import main

if __name__ == "__main__":
    sys.exit(main(["--model", "ur3e", *sys.argv[1:]]))
