"""What is known of each Quest model without asking the device.

The paper is "How Accurate is the Positioning in VR?" (doi 10.1109/ISMAR-Adjunct64951.2024.00027);
its recordings are the dataset `banaszczyk2024`.
"""

from __future__ import annotations

from vrbench.devices.specs import HeadsetProfile, HeadsetSpec, Tracking

# The Unity app logs once a frame. Quest 2 and Quest Pro kept 72.0 Hz in all recordings of the paper
# (its text says 30); the Quest 3 is taken to do the same until a recording says otherwise.
RATE_HZ = 72.0

# Stamps of the Unity log are DateTime.UtcNow.
CLOCK = "utc"

# The four cameras that track, numbered as the wearer would count them. On the Quest Pro they have
# no place here: the paper's levels name ids, and which lens an id is must be settled on the device.
CORNERS = {0: "upper left", 1: "upper right", 2: "lower left", 3: "lower right"}
NUMBERED = {id_: f"tracking camera {id_}" for id_ in range(4)}

# Levels of the paper's occlusion experiment. It was made on the Quest Pro alone; on the others the
# same ids are covered, so that the suite can be run on them.
OCCLUSION: dict[str, tuple[int, ...]] = {"none": (), "two": (0, 3), "three": (0, 2, 3)}

# Slow position error: rms of the residuals of calib and traj1 together, at the eye, over sqrt(3):
# 3.03 and 1.45 mm (Quest 2), 1.87 and 1.75 mm (Quest Pro).
# Slow rotation error: the mean angle of the hand-eye residuals, 0.178 and 0.209 deg, over
# 1.6 (the mean length of a normal 3-vector of unit variance) and sqrt(2) (two poses in each).
# Jitter: third differences in the stillest 2 s of each log. Intervals: the standard deviation of
# their length, over sqrt(2) (two instants in each).
QUEST_2 = Tracking(
    position_noise_m=0.0014,
    rotation_noise_rad=0.0014,
    position_jitter_m=0.000004,
    rotation_jitter_rad=0.00004,
    interval_jitter_s=0.0002,
    source="residuals of banaszczyk2024, calib and traj1 (Quest 2); correlation time and losses"
    " made up",
)
QUEST_PRO = Tracking(
    position_noise_m=0.0010,
    rotation_noise_rad=0.0016,
    position_jitter_m=0.000004,
    rotation_jitter_rad=0.000055,
    interval_jitter_s=0.00024,
    source="residuals of banaszczyk2024, calib and traj1 (Quest Pro); correlation time and losses"
    " made up",
)
QUEST_3 = Tracking(
    position_noise_m=0.0012,
    rotation_noise_rad=0.0015,
    position_jitter_m=0.000004,
    rotation_jitter_rad=0.00005,
    interval_jitter_s=0.0002,
    source="made up: halfway between the Quest 2 and the Quest Pro; no recordings at hand",
)

QUEST_3S = Tracking(
    position_noise_m=0.0013,
    rotation_noise_rad=0.0015,
    position_jitter_m=0.000004,
    rotation_jitter_rad=0.00005,
    interval_jitter_s=0.0002,
    source="made up: between the Quest 3 and the Quest 2; no recordings at hand",
)

HEADSETS = (
    HeadsetSpec(
        name="quest-2",
        title="Meta Quest 2",
        profile=HeadsetProfile(
            rate_hz=RATE_HZ, cameras=CORNERS, clock=CLOCK, occlusion=OCCLUSION, tracking=QUEST_2
        ),
    ),
    HeadsetSpec(
        name="quest-pro",
        title="Meta Quest Pro",
        profile=HeadsetProfile(
            rate_hz=RATE_HZ, cameras=NUMBERED, clock=CLOCK, occlusion=OCCLUSION, tracking=QUEST_PRO
        ),
    ),
    HeadsetSpec(
        name="quest-3",
        title="Meta Quest 3",
        profile=HeadsetProfile(
            rate_hz=RATE_HZ, cameras=CORNERS, clock=CLOCK, occlusion=OCCLUSION, tracking=QUEST_3
        ),
    ),
    HeadsetSpec(
        name="quest-3s",
        title="Meta Quest 3S",
        profile=HeadsetProfile(
            rate_hz=RATE_HZ, cameras=CORNERS, clock=CLOCK, occlusion=OCCLUSION, tracking=QUEST_3S
        ),
    ),
)
