"""Runs the emulator of a UR10e: `python -m vrbench_ur.emulator.ur10e`."""

from __future__ import annotations

import sys

from vrbench_ur.emulator.__main__ import main

if __name__ == "__main__":
    sys.exit(main(["--model", "ur10e", *sys.argv[1:]]))
