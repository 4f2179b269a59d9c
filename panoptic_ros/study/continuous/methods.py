"""Methods of the study `continuous`: each turns a capture of free-running cameras into people at instants."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from scipy.interpolate import CubicSpline

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.elhayek.passes import ElhayekPass, Fitted
from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.continuous.subjects.passes import SubjectPass
from panoptic_ros.domain import DetectionSet, ViewDetections, ViewFrame
from panoptic_ros.domain.subjects import Subject
from panoptic_ros.evaluation import SkeletonFrame
from panoptic_ros.geometry.triangulation import triangulate_robust
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.running.continuous import ContinuousTask, with_segments
from panoptic_ros.running.continuous_online import solve_online
from panoptic_ros.running.continuous_preset import RecordingWithImages
from panoptic_ros.simulation.detector import Sightings
from panoptic_ros.simulation.drawn_maps import MapDrawing, with_drawn_maps
from panoptic_ros.simulation.free_running import START_NS, FreeRunningCapture, TimedView, owners_of
from panoptic_ros.simulation.rendering.renderer import Studio
from panoptic_ros.simulation.skeleton import JOINTS, SKELETON
from panoptic_ros.stage import Pass, StageContext, untold
from panoptic_ros.study.continuous.clock_figures import time_figures

Array = np.ndarray
REFERENCE_HZ = 70.0  # rate of the synchronous reference in the paper
ONLINE_HZ = 50.0  # rate of the instants of the online form
LAGS = (0.0, 0.05, 0.1, 0.5)  # s
LONGEST_GAP = 1.6  # periods of the slowest camera, longest gap that is interpolated between frames
FEWEST = 4  # smallest number of samples for a cubic spline


@dataclass(frozen=True, eq=False)
class MotionResult:
    """Result of a method on a capture.

    Args:
        frames: people at instants on the clock of the first camera.
        cpu_s: processor time, s.
        wrong_views: share of the assigned 2D people that went to another person; NaN = not known.
        times: figures of estimated clocks and line delays, see `clock_figures.time_figures`.
    """

    frames: list[SkeletonFrame]
    cpu_s: float = np.nan
    wrong_views: float = np.nan
    times: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class CaptureUnderTest:
    """Capture with what several methods need.

    Args:
        capture: the capture.
        times: instants (T,) s of the results.
        config: options of the continuous pass.
    """

    capture: FreeRunningCapture
    times: Array
    config: ContinuousConfig = field(default_factory=ContinuousConfig)

    @cached_property
    def reference_frames(self) -> list[SkeletonFrame]:
        """Return the triangulated people of the same cameras, synchronous at `REFERENCE_HZ`."""
        stamps, views = [], []
        for seconds, seen in self.capture.in_step(REFERENCE_HZ):
            stamps.append(START_NS + round(1e9 * seconds))
            views.append([(camera, one, owners_of(one)) for camera, one in enumerate(seen)])
        return _triangulated(self.capture, stamps, views)

    @property
    def period_s(self) -> float:
        """Return the period of the slowest camera, s."""
        return 1.0 / min(timing.rate for timing in self.capture.timings)

    def groups(self) -> list[list[TimedView]]:
        """Return the views of each instant: of every camera the view nearest to it, by timestamp.

        The instants are one period of the slowest camera apart.
        """
        stamps = np.array([1e-9 * (one.view.stamp_ns - START_NS) for one in self.capture.views])
        numbers = np.rint(stamps / self.period_s).astype(int)
        off = np.abs(stamps - numbers * self.period_s)
        chosen: dict[int, dict[int, int]] = {}
        for k in np.argsort(off, kind="stable").tolist():
            if numbers[k] >= 0:
                chosen.setdefault(int(numbers[k]), {}).setdefault(self.capture.views[k].camera, k)
        return [[self.capture.views[k] for _, k in sorted(chosen[n].items())] for n in sorted(chosen)]

    def stamp_of(self, group: Sequence[TimedView]) -> int:
        """Return the timestamp (ns) of the instant of a group."""
        middle = np.mean([1e-9 * (one.view.stamp_ns - START_NS) for one in group])
        return START_NS + round(1e9 * self.period_s * round(float(middle) / self.period_s))


def reference(case: CaptureUnderTest) -> MotionResult:
    """Triangulate the same cameras, synchronous at 70 Hz; each 2D person is assigned to its true person."""
    return MotionResult(case.reference_frames)


def low_rate(case: CaptureUnderTest) -> MotionResult:
    """Keep of the reference what synchronous cameras of the lowest rate would see; join it by splines."""
    every = max(1, round(REFERENCE_HZ * case.period_s))
    return _joined(case.reference_frames[::every], case, every / REFERENCE_HZ)


def aligned(case: CaptureUnderTest) -> MotionResult:
    """Triangulate the nearest frames as if simultaneous; each 2D person is assigned to its true person."""
    groups = case.groups()
    views = [[(one.camera, one.view, one.owners) for one in group] for group in groups]
    stamps = [case.stamp_of(group) for group in groups]
    return _joined(_triangulated(case.capture, stamps, views), case, case.period_s)


def grouped(case: CaptureUnderTest) -> MotionResult:
    """Solve the nearest frames as `panoptic solve` does; its skeletons are joined by splines."""
    context = StageContext(case.capture.rig, SKELETON)
    sets = [
        DetectionSet(k, case.stamp_of(group), SKELETON.hash, tuple(one.view for one in group))
        for k, group in enumerate(case.groups())
    ]
    begin = time.process_time()
    found = records_of("skeletons", sets, configure({}), context)
    spent = time.process_time() - begin
    frames = [SkeletonFrame(r.stamp_ns, r.ids, r.positions, r.covariances) for r in found]
    return MotionResult(_joined(frames, case, case.period_s).frames, spent)


def continuous(case: CaptureUnderTest) -> MotionResult:
    """Fit curves to the whole recording, as `panoptic continuous` does."""
    return _whole(case, ContinuousPass(case.config, StageContext(case.capture.rig, SKELETON)))


def elhayek(case: CaptureUnderTest, fitted: Fitted = "joints") -> MotionResult:
    """Fit polynomials of joint angles, as `panoptic continuous --preset elhayek-2012` does."""
    context = with_segments(StageContext(case.capture.rig, SKELETON))
    return _whole(case, ElhayekPass(case.config, context, fitted=fitted), fitted == "maps")


def subject(case: CaptureUnderTest) -> MotionResult:
    """Fit curves of joint angles to the first person, as `panoptic continuous --subject` does.

    The file states the stature and the start, so that bones are fitted.
    """
    context = with_segments(StageContext(case.capture.rig, SKELETON))
    person, begin = case.capture.people[0], case.times[:1]
    body = context.extras["segments"].body(person.body.height)
    start = case.capture.joints(begin)[0, 0].mean(axis=0)
    known = Subject(0, body, start=start, measured=False, stature=person.body.height)
    return _whole(case, SubjectPass(case.config, context, known))


def online(case: CaptureUnderTest, lag: float) -> MotionResult:
    """Give the instants k / `ONLINE_HZ`, each from the views up to `lag` s later; join them by splines."""
    capture = case.capture
    recording = InMemoryRecording({"detection_sets": list(capture.sets())})
    task = ContinuousTask(StageContext(capture.rig, SKELETON), recording, case.config, JOINTS)
    begin = time.process_time()
    result = solve_online(task, lag, ONLINE_HZ, untold)
    spent = time.process_time() - begin
    frames = [SkeletonFrame(r.stamp_ns, r.ids, r.positions, r.covariances) for r in result.sets]
    return MotionResult(_joined(frames, case, 1.0 / ONLINE_HZ).frames, spent)


METHODS: dict[str, Callable[[CaptureUnderTest], MotionResult]] = {
    "reference": reference,
    "low rate": low_rate,
    "aligned": aligned,
    "solve": grouped,
    "continuous": continuous,
    **{f"lag {lag:g} s": partial(online, lag=lag) for lag in LAGS},
}


_PRESET: dict[str, Callable[[CaptureUnderTest], MotionResult]] = {
    "elhayek": elhayek,
    "maps": partial(elhayek, fitted="maps"),
}
OF_CASE = {  # methods by case; the others have `METHODS`
    "faster": METHODS | _PRESET | {"subject": subject},
    "staggered": METHODS | {"subject": subject},
    "crossing": METHODS | _PRESET,
    "free": METHODS | {"subject": subject},
    "rendered": METHODS | _PRESET | {"images": partial(elhayek, fitted="images")},
}


def wrong_share(capture: FreeRunningCapture, motion: ContinuousMotion) -> float:
    """Return the share of assigned 2D people whose true person is not the one of most of their track.

    A ray states the camera, the timestamp and the image row of its joint, which identify the 2D person.
    """
    owners = {}
    for one in capture.views:
        for points, owner in zip(one.view.points, one.owners):
            for joint in np.flatnonzero(np.isfinite(points[:, 1])).tolist():
                owners[one.camera, one.view.stamp_ns, joint, float(points[joint, 1])] = int(owner)
    wrong = total = 0
    for person in motion.people:
        rays, found = person.rays, {}
        stamps = motion.reference_ns + np.round(1e9 * rays.stamps).astype(np.int64)
        for camera, stamp, joint, row in zip(
            rays.cameras.tolist(), stamps.tolist(), rays.joints.tolist(), rays.heights.tolist()
        ):
            owner = owners.get((camera, stamp, joint, row))
            if owner is not None:
                found[camera, stamp] = owner
        who = np.array(list(found.values()))
        known = who[who >= 0]
        main = np.bincount(known).argmax() if len(known) else -1
        wrong, total = wrong + int((who != main).sum()), total + len(who)
    return wrong / total if total else np.nan


def rendered_frames(capture: FreeRunningCapture) -> Iterator[ViewFrame]:
    """Yield the rendered images of all views, camera by camera."""
    studio = Studio(capture)
    for number, camera in enumerate(capture.rig.cameras):
        own = [one for one in capture.views if one.camera == number]
        shown = studio.camera(camera.name).render(np.array([one.seconds for one in own]))
        for k, (one, picture) in enumerate(zip(own, shown)):
            yield ViewFrame(camera.name, one.view.stamp_ns, k, picture.image)


def _whole(case: CaptureUnderTest, work: Pass[ContinuousMotion], maps: bool = False) -> MotionResult:
    """Return the people that a pass over the whole capture gives at the instants of a case.

    Args:
        maps: add score maps that are drawn from the 2D people.
    """
    capture = case.capture
    views = list(capture.sets())
    if maps:
        views = [with_drawn_maps(item, MapDrawing()) for item in views]
    sets = InMemoryRecording({"detection_sets": views})
    recording = RecordingWithImages(sets, partial(rendered_frames, capture))
    begin = time.process_time()
    motion = work.run(recording, untold)
    stamps = START_NS + np.round(1e9 * case.times).astype(np.int64)
    frames = [SkeletonFrame(r.stamp_ns, r.ids, r.positions, r.covariances) for r in motion.sets(stamps)]
    spent = time.process_time() - begin
    wrong = wrong_share(capture, motion)
    return MotionResult(
        frames, spent, wrong, time_figures(capture, motion.clocks, motion.reference_ns, case.config)
    )


def _triangulated(
    capture: FreeRunningCapture,
    stamps: Sequence[int],
    views: Sequence[Iterable[tuple[int, ViewDetections | Sightings, Array]]],
) -> list[SkeletonFrame]:
    """Triangulate every joint of every true person at instants.

    Args:
        stamps: (T,) ns.
        views: camera, 2D people and their owners of each view, at T instants.
    """
    rig, people = capture.rig, len(capture.people)
    plane = np.full((len(stamps), people, len(JOINTS), len(rig), 2), np.nan)
    for t, seen in enumerate(views):
        for camera, view, owners in seen:
            for points, owner in zip(view.points, owners):
                if owner >= 0:
                    plane[t, owner, :, camera] = rig.cameras[camera].intrinsics.undistort(points)
    shape = plane.shape[:3]
    rows = plane.reshape(-1, len(rig), 2)
    sigmas = np.full(rows.shape[:2], capture.scene.degradation.noise_px)
    found = triangulate_robust(rig.stack(), rows, sigmas).points.reshape(*shape, 3)
    frames = []
    for stamp, positions in zip(stamps, found):
        there = np.flatnonzero(np.isfinite(positions[..., 0]).any(axis=1))
        frames.append(SkeletonFrame(stamp, there, positions[there]))
    return frames


def _joined(frames: Sequence[SkeletonFrame], case: CaptureUnderTest, period_s: float) -> MotionResult:
    """Return the people of frames at the instants of a case, by cubic splines without long gaps."""
    rows: dict[int, list[tuple[float, Array]]] = {}
    for frame in frames:
        for number, positions in zip(frame.ids.tolist(), frame.positions):
            rows.setdefault(number, []).append((1e-9 * (frame.stamp_ns - START_NS), positions))
    found = {}
    for number, own in rows.items():
        times, positions = np.array([row[0] for row in own]), np.array([row[1] for row in own])
        at = np.full((len(case.times), len(JOINTS), 3), np.nan)
        for joint in range(len(JOINTS)):
            there = np.isfinite(positions[:, joint, 0])
            at[:, joint] = _interpolated(
                times[there], positions[there, joint], case.times, LONGEST_GAP * period_s
            )
        found[number] = at
    result = []
    for t, seconds in enumerate(case.times):
        ids = [number for number, at in found.items() if np.isfinite(at[t]).any()]
        positions = np.array([found[number][t] for number in ids]).reshape(len(ids), len(JOINTS), 3)
        result.append(
            SkeletonFrame(START_NS + round(1e9 * float(seconds)), np.array(ids, np.int64), positions)
        )
    return MotionResult(result)


def _interpolated(times: Array, values: Array, at: Array, longest: float) -> Array:
    """Return values (T, 3) at `at` (T,) s of a cubic spline; NaN outside, and in gaps above `longest` s."""
    found = np.full((len(at), 3), np.nan)
    if len(times) >= FEWEST:
        after = np.clip(np.searchsorted(times, at), 1, len(times) - 1)
        inside = (at >= times[0]) & (at <= times[-1]) & (times[after] - times[after - 1] <= longest)
        found[inside] = CubicSpline(times, values)(at[inside])
    return found
