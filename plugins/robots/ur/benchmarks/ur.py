"""Speeds of the robot plugin: planning, search, logging, the loop of servoJ.

python plugins/robots/ur/benchmarks/ur.py [inverse plan search record servo]

The search takes the paper's head recording too where VRBENCH_DATA names the datasets.
`servo` means something on an idle machine only.
"""

import os
import sys
import time
from pathlib import Path

import numpy as np
from vrbench_ur.arms import UR5E
from vrbench_ur.control import Control
from vrbench_ur.inverse import pose_error, solve
from vrbench_ur.kinematics import flange
from vrbench_ur.options import Options, Start
from vrbench_ur.plan import start_posture
from vrbench_ur.planner import Planner
from vrbench_ur.reader import Reader
from vrbench_ur.testing import MOUNTING, Emulator, nod, options

from vrbench.geometry import Transform
from vrbench.motion.generators import generate
from vrbench.motion.motion import relative_to_first

FOUND = Start(p_m=(0.467, 0.0172, 0.9806), yaw_deg=155.43)
BAG = "banaszczyk2024/data/real_world_head_trajectories/real_world_head_movement_example_0.bag"
T_TCP_BODY = [
    [-0.999996, 0.000866265, -0.00261548, -0.0107378],
    [-0.00261606, -0.000663386, 0.999996, 0.134303],
    [0.000864527, 0.999999, 0.00066565, 0.342898],
]


def inverse():
    q = np.random.default_rng(1).uniform(-3, 3, (100_000, 6))
    pose = flange(q, UR5E.dh)
    begin = time.perf_counter()
    found = solve(pose, UR5E.dh)
    spent = time.perf_counter() - begin
    there = ~np.isnan(found[..., 0])
    flat = np.broadcast_to(pose.p[:, None], (*there.shape, 3))[there]
    turned = np.broadcast_to(pose.q[:, None], (*there.shape, 4))[there]
    error = np.abs(pose_error(found[there], Transform(flat, turned), UR5E.dh)).max()
    print(f"inverse: {1e6 * spent / len(q):.2f} us a pose, 8 branches; error {error:.1e}")


def plan():
    planner = Planner(UR5E, Options(start=FOUND), MOUNTING)
    motion = generate("shooter-1").trajectory
    begin = time.perf_counter()
    made = planner.plan(motion)
    spent = time.perf_counter() - begin
    print(f"plan: {motion.duration_s:.0f} s at 120 Hz, all branches, collisions: {spent:.2f} s")
    print(f"      {made.facts}")


def search():
    motions = [("shooter-1", generate("shooter-1").trajectory, MOUNTING)]
    motions.append(("saturate-1", generate("saturate-1").trajectory, MOUNTING))
    bag = Path(os.environ.get("VRBENCH_DATA", "/nowhere")) / BAG
    if bag.is_file():
        from vrbench.recording.bags import BagOptions
        from vrbench.recording.importers.rosbag1 import IMPORTER

        read = IMPORTER.read(bag, BagOptions(topic="/optitrack_node/rigid_body_0"))
        motion = relative_to_first(read.samples.trajectory())
        motions.append(("recorded head", motion, Transform.from_matrix(T_TCP_BODY)))
    for name, motion, mounting in motions:
        planner = Planner(UR5E, Options(), mounting)
        begin = time.perf_counter()
        made = planner.plan(motion)
        spent = time.perf_counter() - begin
        print(
            f"search: {name}, {motion.duration_s:.0f} s: {spent:.1f} s; strict {made.fraction:.3f},"
            f" MoveIt's {made.moveit:.3f}, stretch {made.stretch:g}, start {made.start.p_m} "
            f"{made.start.yaw_deg:g} deg, worst {100 * made.examined.cost:.0f} %, smoothing "
            f"{made.deviation_mm:.2f} mm, {made.facts}"
        )


def record(seconds=60.0):
    with Emulator() as emulator, Reader(emulator.host, 500.0, time.time_ns) as reader:
        packets = []
        begin = time.monotonic()
        while time.monotonic() - begin < seconds:
            time.sleep(0.1)
            packets.append(reader.take()[1])
        stamps = np.concatenate([part["timestamp"] for part in packets])
        sent = round((stamps[-1] - stamps[0]) / 0.002) + 1
        print(f"record: {sent - len(stamps)} of {sent} samples lost in {seconds:.0f} s at 500 Hz")


def servo():
    with Emulator() as emulator:
        planner = Planner(UR5E, options(emulator.host), MOUNTING)
        made = planner.plan(nod(20.0))
        emulator.place(start_posture(made))
        emulator.report()
        with Control(UR5E, planner.options) as control:
            for _ in control.servo(made.path):
                pass
            print(f"servo: {control.last}")


if __name__ == "__main__":
    for name in sys.argv[1:] or ["inverse", "plan", "search", "record", "servo"]:
        {"inverse": inverse, "plan": plan, "search": search, "record": record, "servo": servo}[
            name
        ]()
