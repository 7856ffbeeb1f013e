"""What the emulated cameras see: a head in motion, with markers on it, and what is lost of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from vrbench.geometry import Floats, Transform
from vrbench.motion.generators import generate
from vrbench.trajectory import NS, Trajectory
from vrbench_optitrack.axes import Up, from_y_up, pose_from_y_up
from vrbench_optitrack.frame import (
    UNSAID,
    VALID,
    BodyMarker,
    Frame,
    LabeledMarker,
    MarkerSet,
    RigidBody,
    Suffix,
)
from vrbench_optitrack.models import BodyModel, CameraModel, MarkerSetModel, Model
from vrbench_optitrack.wire import Version

# Where the head begins: sitting, a little off the middle of the room; y up [m].
HEAD = Transform.of((0.3, 1.2, 0.1), (0.0, 0.0, 0.0, 1.0))
# The markers of the headset, from its pivot [m]; no two distances alike, so that none is swapped.
MARKERS = np.array(
    [
        [0.081, 0.034, -0.041],
        [-0.074, 0.041, -0.032],
        [0.013, 0.078, 0.021],
        [-0.052, -0.029, -0.063],
        [0.064, -0.047, -0.058],
    ]
)
CAMERAS = np.array([[2.4, 2.3, 2.2], [-2.5, 2.4, 2.1], [-2.3, 2.2, -2.4], [2.2, 2.5, -2.3]])
MARKER_SIZE = 0.014


@dataclass(frozen=True, slots=True)
class Scene:
    """A room with a head in it.

    Attributes:
        motion: the head's, by the name of its generator.
        begin_s: where in the motion to begin [s].
        body: the headset's rigid body.
        id: its streaming id.
        others: further bodies, at rest.
        markers: further labeled markers, at rest.
        rate_hz: of frames.
        up: the axis that is up in the stream.
        unit_mm: the stream's unit [mm].
        lose_every_s: how often tracking is lost; 0 is never.
        lose_s: for how long.
        carried: where an emulated robot carries the body, y up [m], at times (n,) since the first
            frame [s]; where there is none it moves as `motion`.
        lost_as: what the stream does then: `flag` says so, `absent` leaves the body out; both hold
            the last pose otherwise, as Motive does.
    """

    motion: str = "shooter-1"
    begin_s: float = 0.0
    body: str = "headset"
    id: int = 1
    others: tuple[str, ...] = ("controller",)
    markers: int = 3
    rate_hz: float = 240.0
    up: Up = "y"
    unit_mm: float = 1000.0
    lose_every_s: float = 0.0
    lose_s: float = 0.5
    lost_as: Literal["flag", "absent"] = "flag"
    carried: Callable[[Floats], Transform] | None = None
    _block: dict[int, tuple[Floats, Floats]] = field(default_factory=dict, repr=False)

    @property
    def block(self) -> int:
        """Frames that are computed at one go: about a second's; one where a robot moves it."""
        return 1 if self.carried is not None else max(1, round(self.rate_hz))

    def head(self, seconds: Floats) -> Transform:
        """Where the body truly is, y up [m], at times (n,) since the first frame [s]."""
        if self.carried is not None:
            return self.carried(seconds)
        path: Trajectory = generate(self.motion).trajectory
        t = np.rint(np.mod(seconds + self.begin_s, path.duration_s) * NS).astype(np.int64)
        return HEAD @ path.at(t)

    def lost(self, seconds: float) -> bool:
        """Whether the cameras have lost the body."""
        if not self.lose_every_s:
            return False
        return seconds % self.lose_every_s >= self.lose_every_s - self.lose_s

    def models(self, version: Version) -> list[Model]:
        """What MODELDEF tells; cameras from 4.0."""
        unit = 1e3 / self.unit_mm
        offsets = tuple(map(tuple, (from_y_up(MARKERS, self.up) * unit).tolist()))
        names = tuple(f"Marker{i + 1}" for i in range(len(MARKERS)))
        models: list[Model] = []
        for id_, name in self._bodies():
            models.append(MarkerSetModel(name, names))
            models.append(
                BodyModel(
                    name,
                    id_,
                    -1,
                    (0.0, 0.0, 0.0),
                    markers=offsets,
                    labels=(0,) * len(MARKERS),
                    marker_names=names,
                )
            )
        if version >= (4, 0):
            for i, place in enumerate((from_y_up(CAMERAS, self.up) * unit).tolist()):
                models.append(CameraModel(f"Camera {i + 1}", tuple(place), (0.0, 0.0, 0.0, 1.0)))
        return models

    def frame(self, index: int, version: Version, suffix: Suffix, number: int) -> Frame:
        """The index-th frame since the start, as the version has it."""
        held = index
        lost = self.lost(index / self.rate_hz)
        if lost:
            into = (index / self.rate_hz) % self.lose_every_s
            held = max(0, index - 1 - int((into - self.lose_every_s + self.lose_s) * self.rate_hz))
        pose, markers = (rows[held % self.block] for rows in self._rows(held))
        spots = [tuple(row) for row in markers.tolist()]
        params = (0 if lost else VALID) if version >= (2, 6) else UNSAID
        bodies = []
        labeled = []
        for id_, name in self._bodies():
            moving = name == self.body
            if moving and lost and self.lost_as == "absent":
                continue
            p, q = (pose[:3], pose[3:]) if moving else (np.array([0.0, 0.0, 0.0]), HEAD.q)
            carried = tuple(BodyMarker(spot, i + 1, MARKER_SIZE) for i, spot in enumerate(spots))
            bodies.append(
                RigidBody(
                    id_,
                    tuple(p.tolist()),
                    tuple(q.tolist()),
                    0.0 if moving and lost else 0.0002,
                    params if moving else (VALID if version >= (2, 6) else UNSAID),
                    carried if version < (3, 0) and moving else (),
                )
            )
            if moving and not lost:
                labeled = [
                    LabeledMarker(id_ << 16 | i + 1, spot, MARKER_SIZE, 10, 0.0002)
                    for i, spot in enumerate(spots)
                ]
        still = [
            LabeledMarker(50_000 + i, (0.1 * i, 0.1 * i, 0.1 * i), MARKER_SIZE, 18, 0.0003)
            for i in range(self.markers)
        ]
        return Frame(
            number=number,
            marker_sets=[MarkerSet(self.body, spots), MarkerSet("all", spots)],
            other_markers=[],
            bodies=bodies,
            skeletons=[],
            assets=[],
            labeled_markers=labeled + still,
            force_plates=[],
            devices=[],
            suffix=suffix,
        )

    def _bodies(self) -> list[tuple[int, str]]:
        """Ids and names; ids don't follow the order of definitions, as in a real project."""
        others = [(self.id + 7 - i, name) for i, name in enumerate(self.others)]
        return [*others, (self.id, self.body)]

    def _rows(self, index: int) -> tuple[Floats, Floats]:
        """Poses (n, 7) and markers (n, 5, 3) of the block of frames that has this one."""
        first = index // self.block * self.block
        if first not in self._block:
            if len(self._block) > 4:
                del self._block[min(self._block)]
            pose = self.head(np.arange(first, first + self.block) / self.rate_hz)
            spots = pose[:, None].apply(MARKERS)
            unit = 1e3 / self.unit_mm
            shown = pose_from_y_up(pose, self.up)
            rows = np.concatenate((shown.p * unit, shown.q), axis=1)
            self._block[first] = rows, from_y_up(spots, self.up) * unit
        return self._block[first]
