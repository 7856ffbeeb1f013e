"""Plans: from a head motion to a joint path that this arm, in these surroundings, can do."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

import numpy as np

from vrbench.errors import DeviceError
from vrbench.geometry import Transform, quat_rotate, relative_angle
from vrbench.trajectory import NS, Trajectory
from vrbench_ur.arms import JOINTS, Arm
from vrbench_ur.calibration import difference, read_calibration
from vrbench_ur.cell import Cell
from vrbench_ur.checks import Breach, Examined, examine
from vrbench_ur.fraction import COARSE_HZ, moveit_fraction
from vrbench_ur.inverse import branch_name, refine
from vrbench_ur.kinematics import flange
from vrbench_ur.options import Options, Start
from vrbench_ur.plan import UrPlan, plan_hash, rig_digest
from vrbench_ur.search import Progress, quiet, search
from vrbench_ur.spline import JointPath, smooth
from vrbench_ur.targets import Task, check_motion, postures, reached, start_eye

# How many of the search's starts are planned in full before the best of them is taken.
PLANNED = 4
# Use of a limit above which a plan that can be done carries a warning.
NEAR = 0.95
# A joint that turns farther from one pose to the next jumps to another posture [rad].
JUMP = 0.5
DYNAMIC = {"speed", "acceleration", "torque"}


# Plans of this process, so that repeats of a motion aren't searched for again.
REMEMBERED = 32
_MADE: dict[tuple[str, Start | None, str], UrPlan] = {}


class PlanError(DeviceError):
    """No start was found from which the arm can do the motion."""


class Planner:
    """Plans motions for one arm in one rig; needs no robot.

    Args:
        arm: the arm.
        options: of the rig.
        mounting: nominal `T_tcp_eye`.

    Raises:
        ConfigError: the payload is above the arm's limit, or the calibration can't be read.
    """

    def __init__(self, arm: Arm, options: Options, mounting: Transform) -> None:
        from vrbench_ur.safety import check_payload

        check_payload(arm, options.payload.kg)
        self.arm, self.options, self.mounting = arm, options, mounting
        self.dh = read_calibration(options.calibration, arm) if options.calibration else arm.dh
        self.cell = Cell(arm, options, self.dh)
        self.rig = rig_digest(arm, options, mounting, self.dh)

    def plan(self, motion: Trajectory, progress: Progress = quiet) -> UrPlan:
        """A plan that does the whole motion, `T_eye0_eye` with stamps from 0.

        Raises:
            ConfigError: the motion is no motion.
            PlanError: it can't be done; says where and why, and what start or stretch would do.
        """
        check_motion(motion)
        values = np.column_stack((motion.t, motion.pose.p, motion.pose.q)).tobytes()
        key = self.rig, self.options.start, hashlib.sha256(values).hexdigest()
        if key not in _MADE:
            while len(_MADE) >= REMEMBERED:
                del _MADE[next(iter(_MADE))]
            _MADE[key] = self._made(motion, progress)
        return _MADE[key]

    def _made(self, motion: Trajectory, progress: Progress) -> UrPlan:
        task = Task(motion, self.mounting, self.options)
        if self.options.start is not None:
            tried = self._best(task, [self.options.start])
            if tried is None or tried.breaches:
                raise self._cannot(task, self.options.start, tried, progress)
            return self._plan(task, tried)
        found = search(task, self.cell, progress)
        starts = list(dict.fromkeys(c.start for c in found))
        tried = self._best(task, starts[:PLANNED])
        if tried is None or tried.breaches:
            short = found[0].fraction if found[0].fraction < 1.0 else 0.0
            if tried is not None and tried.far(task) < short and tried.rank()[0] > 1:
                tried = None  # what doesn't reach it all gets farther
            raise self._cannot(task, starts[0], tried, None)
        return self._plan(task, tried)

    def _best(self, task: Task, starts: list[Start]) -> _Tried | None:
        """The best of all postures from these starts; None where none reaches everything."""
        tried = []
        for start in starts:
            target = task.flange(start)
            q = postures(target, self.arm.dh)
            for branch in np.flatnonzero(reached(q).all(axis=1)):
                angles = q[branch]
                if self.options.calibration is not None:
                    angles = refine(angles, target, self.dh)
                if np.abs(np.diff(angles, axis=0)).max() > JUMP:
                    continue
                path = smooth(task.times(), angles)
                checks = examine(path, self.cell, self.options, task.rate_hz)
                tried.append(_Tried(start, int(branch), path, checks))
        return min(tried, key=_Tried.rank, default=None)

    def _plan(self, task: Task, tried: _Tried) -> UrPlan:
        path, checks, options = tried.path, tried.checks, self.options
        t = path.grid(task.rate_hz)
        tcp = flange(path.at(t), self.dh) @ options.flange_tcp
        target = Trajectory(np.rint(t * NS).astype(np.int64), tcp)
        apart, turned = self._deviation(task, tried)
        warnings = [
            f"{name} uses {100 * use:.0f} % of its limit"
            for name, use in checks.worst.items()
            if use > NEAR
        ]
        step = options.limits.step_mm
        if apart > step:
            warnings.append(f"smoothing moves the eye by up to {apart:.2f} mm, more than {step:g}")
        facts = dict(checks.extra)
        if options.calibration is not None:
            off = difference(path.at(t), self.arm.dh, self.dh)
            facts |= {
                "calibration_mean_mm": off.mean_mm,
                "calibration_max_mm": off.max_mm,
                "calibration_max_deg": off.max_deg,
            }
        else:
            warnings.append(
                "planned with nominal kinematics: a controller's own calibration puts the TCP "
                "millimetres elsewhere; the reference is what it logs"
            )
        coarse = task.coarse(COARSE_HZ)
        way = coarse.flange(tried.start)
        first = path.at(np.array([path.lead_in_s]))[0]
        return UrPlan(
            target=target,
            hash=plan_hash(self.rig, path),
            fraction=1.0,
            stretch=options.stretch,
            arm=self.arm.name,
            rig=self.rig,
            path=path,
            start=tried.start,
            branch=tried.branch,
            moveit=moveit_fraction(way, first, self.cell),
            examined=checks,
            deviation_mm=apart,
            deviation_deg=turned,
            facts=facts,
            warnings=tuple(warnings),
        )

    def _deviation(self, task: Task, tried: _Tried) -> tuple[float, float]:
        """The most that smoothing moves the eye [mm] and turns it [deg]."""
        at = flange(tried.path.at(task.times() + tried.path.lead_in_s), self.dh)
        want = task.flange(tried.start)
        tool = self.options.flange_tcp @ self.mounting
        moved = (at.p + quat_rotate(at.q, tool.p)) - (want.p + quat_rotate(want.q, tool.p))
        angle = relative_angle(at.q, want.q)
        return (
            float(1e3 * np.linalg.norm(moved, axis=1).max()),
            float(np.degrees(angle.max())),
        )

    def _cannot(
        self, task: Task, start: Start, tried: _Tried | None, progress: Progress | None
    ) -> PlanError:
        """The error that says where and why, and what would do instead."""
        place = f"start p_m {list(start.p_m)}, yaw {start.yaw_deg:g} deg"
        if tried is None:
            fraction, what = self._broken_off(task, start)
        else:
            start, checks = tried.start, tried.checks
            place = f"start p_m {list(start.p_m)}, yaw {start.yaw_deg:g} deg"
            fraction = tried.far(task)
            # told on the motion's time, not on that of the lead
            first = checks.breaches[0].earlier(tried.path.lead_in_s)
            what = f"{first} ({branch_name(tried.branch)})"
            others = sorted({b.check for b in checks.breaches[1:]} - {checks.breaches[0].check})
            what += f"; also {', '.join(others)}" if others else ""
        return PlanError(
            f"the motion can't be done by {self.arm.name}: strict fraction {fraction:.3f} from "
            f"{place}: {what}",
            field="motion",
            fix=self._advice(task, tried, progress),
        )

    def _broken_off(self, task: Task, start: Start) -> tuple[float, str]:
        """How far the best posture gets that doesn't reach everything, and what ends it."""
        q = postures(task.flange(start), self.arm.dh)
        there = reached(q)
        with np.errstate(invalid="ignore"):
            leaps = np.abs(np.diff(q, axis=1)).max(axis=2) > JUMP
        good = there & np.pad(~leaps, ((0, 0), (1, 0)), constant_values=True)
        until = good.argmin(axis=1)  # 0 for one that reaches it all, and breaks another limit
        branch = int(np.argmax(until))
        k = int(until[branch])
        at, eye = task.times()[k], (start_eye(start) @ task.motion.pose).p[k]
        where = ", ".join(f"{x:.3f}" for x in eye)
        if there[branch, k]:
            joint = JOINTS[int(np.argmax(np.abs(q[branch, k] - q[branch, k - 1])))]
            what = f"{joint} would have to jump at {at:.2f} s, a singularity is there"
        else:
            what = f"out of reach of {self.arm.name} at {at:.2f} s"
        return float(k / good.shape[1]), f"{what}, eye at ({where}) m ({branch_name(branch)})"

    def _advice(self, task: Task, tried: _Tried | None, progress: Progress | None) -> str:
        """What stretch or start would do, tried out."""
        if tried is not None and {b.check for b in tried.breaches} <= DYNAMIC:
            worst = tried.checks.worst
            need = max(worst["speed"], np.sqrt(worst["acceleration"]), 1.0)
            for more in (1.01, 1.1, 1.3, 1.6):
                stretch = round(float(need * more) * task.options.stretch, 2)
                slower = task.options.model_copy(update={"stretch": stretch})
                again = self._best(Task(task.motion, task.mounting, slower), [tried.start])
                if again is not None and not again.breaches:
                    return f"a stretch of {stretch:.2f} does it from there"
        if progress is not None:
            found = search(task, self.cell, progress)
            better = self._best(task, list(dict.fromkeys(c.start for c in found))[:PLANNED])
            if better is not None and not better.breaches:
                p = ", ".join(f"{x:g}" for x in better.start.p_m)
                return f"start: {{p_m: [{p}], yaw_deg: {better.start.yaw_deg:g}}} does it"
        return "a smaller or slower motion, more room, or an arm that reaches farther"


@dataclass(frozen=True, slots=True, eq=False)
class _Tried:
    """One start and posture, planned and examined."""

    start: Start
    branch: int
    path: JointPath
    checks: Examined

    @property
    def breaches(self) -> tuple[Breach, ...]:
        return self.checks.breaches

    def far(self, task: Task) -> float:
        """The share of the motion 0..1 before the first breach."""
        begun = max(0.0, self.checks.ok_until_s - self.path.lead_in_s)
        return float(min(1.0, begun / task.times()[-1]))

    def rank(self) -> tuple[int, float]:
        """Least for the best: what can be done, what a stretch may do, what gets farthest."""
        if not self.breaches:
            return 0, self.checks.cost
        if {breach.check for breach in self.breaches} <= DYNAMIC:
            return 1, self.checks.cost
        return 2, -self.checks.ok_until_s
