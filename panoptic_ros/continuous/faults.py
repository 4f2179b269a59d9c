"""Find cameras and single views that contradict the motion of the people.

2D people of a camera whose timestamps are far off fit the motion at another time. The curves come from all
cameras. A camera that is a second off has little weight in them, because it contradicts the others.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from panoptic_ros.continuous.follow import ViewTrack
from panoptic_ros.continuous.stamps import listed_names
from panoptic_ros.domain import RefinedPoseSet
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.solving.frames import CameraFrame
from panoptic_ros.stage import Notice

Array = np.ndarray
WINDOW_S = 2.0  # s, time for which a camera is judged
SAMPLES, LEAST_SAMPLES = 10, 5  # number of 2D people of a camera in a window: at most, and at least
MISS = 0.08  # on the normalised plane, upper limit of the distance of a joint in means
LEAST_MISS = 0.004  # on the normalised plane, mean distance of a 2D person that needs no explanation
FAR = 2.0  # ratio to the typical mean distance from which a window is suspected
SHIFTS_S = np.arange(-3.0, 3.01, 0.02)  # s, errors of timestamps that are tried
LEAST_SHIFT_S = 0.15  # s; smaller errors are left to the clocks
BETTER = 0.5  # ratio of mean distances below which another time explains the 2D people
LEAST_MISFITS = 3  # minimum number of single views that are reported
SEARCHED = 60  # number of 2D people for which other times are searched


class TimedCurve(Protocol):
    """Curve of a person."""

    def at(self, times: Array) -> Array:
        """Return the positions (T, J, 3) m at times (T,) s, NaN outside of the curve."""


class SampledMotion(NamedTuple):
    """Motion of a person at known instants, linear between them.

    Args:
        instants: (N,) s, increasing.
        positions: (N, J, 3) m, NaN = unknown.
        longest: (s) longest time between two instants of a part of the motion.
    """

    instants: Array
    positions: Array
    longest: float

    @classmethod
    def of_sets(
        cls, sets: Sequence[RefinedPoseSet], reference_ns: int, longest: float
    ) -> list[SampledMotion]:
        """Return the people of sets at increasing instants; times are in s from the reference."""
        rows: dict[int, list[tuple[float, Array]]] = {}
        for item in sets:
            time = 1e-9 * (item.stamp_ns - reference_ns)
            for number, positions in zip(item.ids.tolist(), item.positions):
                rows.setdefault(number, []).append((time, positions))
        return [
            cls(np.array([time for time, _ in own]), np.array([positions for _, positions in own]), longest)
            for own in rows.values()
            if len(own) > 1
        ]

    def at(self, times: Array) -> Array:
        """See `TimedCurve`."""
        after = np.clip(np.searchsorted(self.instants, times), 1, len(self.instants) - 1)
        first, last = self.instants[after - 1], self.instants[after]
        share = (times - first) / (last - first)
        inside = (share >= 0.0) & (share <= 1.0) & (last - first <= self.longest)
        share = np.where(inside, share, np.nan)[:, None, None]
        found: Array = (1.0 - share) * self.positions[after - 1] + share * self.positions[after]
        return found


class ClockFault(NamedTuple):
    """Part of a recording in which timestamps of a camera are wrong.

    Args:
        camera: index.
        first, last: (s) times of the part since the first view; infinite at the ends of the recording.
        ahead: (s) by which the timestamps are too late.
    """

    camera: int
    first: float
    last: float
    ahead: float


class _Poses(NamedTuple):
    """N 2D people of a camera: times (N,) s, normalised points (N, J, 2), known joints (N, J)."""

    times: Array
    plane: Array
    known: Array

    def part(self, rows: Array) -> _Poses:
        """Return some rows."""
        return _Poses(*(values[rows] for values in self))


def clock_faults(
    frames: Sequence[CameraFrame], times: Array, people: Sequence[TimedCurve], arrays: RigArrays
) -> list[ClockFault]:
    """Return the cameras whose timestamps are wrong by more than `LEAST_SHIFT_S`, fewer than half of all.

    Args:
        times: (F,) s, of the frames, in increasing order.
    """
    if not people:
        return []
    cameras = sorted({frame.camera for frame in frames})
    samples, means = {}, {}
    for camera in cameras:
        poses, windows = _samples(frames, times, camera)
        misses = _misses(poses, people, arrays, camera)
        samples[camera] = poses, windows
        means[camera] = {int(w): _middle(misses[windows == w]) for w in np.unique(windows)}
    every = [value for own in means.values() for value in own.values() if np.isfinite(value)]
    limit = max(LEAST_MISS, FAR * float(np.median(every))) if every else np.inf
    found = []
    for camera in cameras:
        suspect = [window for window, value in means[camera].items() if value > limit]
        poses, windows = samples[camera]
        fault = _fault(camera, poses, windows, suspect, people, arrays)
        if fault is not None:
            found.append((float(np.mean([means[camera][w] for w in suspect])), fault))
    found.sort(reverse=True)
    return [fault for _, fault in found[: (len(cameras) - 1) // 2]]


def views_without(
    faults: Sequence[ClockFault], frames: Sequence[CameraFrame], times: Array
) -> list[CameraFrame]:
    """Return the views outside of the faults, in the order of timestamps.

    Args:
        times: (F,) s, of the frames, in increasing order.
    """
    kept = [
        frame
        for frame, time in zip(frames, times)
        if not any(f.camera == frame.camera and f.first <= time - times[0] < f.last for f in faults)
    ]
    return sorted(kept, key=lambda frame: (frame.stamp_ns, frame.camera))


def fault_notices(faults: Sequence[ClockFault], cameras: Sequence[str]) -> list[Notice]:
    """Return one notice per fault.

    Args:
        cameras: names of the cameras.
    """
    notices = []
    for fault in faults:
        name, side = cameras[fault.camera], "ahead of" if fault.ahead > 0.0 else "behind"
        since = f" from {fault.first:.0f} s on" if np.isfinite(fault.first) else ""
        until = f" until {fault.last:.0f} s" if np.isfinite(fault.last) else ""
        text = (
            f"stamps of camera {name} are {abs(fault.ahead):.2f} s {side} those of the other "
            f"cameras{since}{until}: these views are left out; correct the stamps"
        )
        values = {"camera": name, "device": name, "offset_s": fault.ahead}
        notices.append(Notice("continuous.clock_off", "warning", text, values))
    return notices


def misfit_notices(
    frames: Sequence[CameraFrame], times: Array, tracks: Sequence[ViewTrack], cameras: Sequence[str]
) -> list[Notice]:
    """Return a notice about single views whose 2D people fit no person, unlike those before and after.

    Args:
        times: (F,) s, of the frames, in increasing order.
        cameras: names of the cameras.
    """
    fitting = np.zeros(len(frames), np.int64)
    for track in tracks:
        np.add.at(fitting, [entry.frame for entry in track.entries], 1)
    begins = np.sort([times[track.entries[0].frame] for track in tracks])
    ends = np.sort([times[track.entries[-1].frame] for track in tracks])
    alive = np.searchsorted(begins, times, "right") > np.searchsorted(ends, times)
    counts: dict[str, int] = {}
    for camera, name in enumerate(cameras):
        own = [k for k, frame in enumerate(frames) if frame.camera == camera and len(frame.plane)]
        fits = fitting[own] > 0
        lone = ~fits[1:-1] & fits[:-2] & fits[2:] & alive[own][1:-1]
        if lone.any():
            counts[name] = int(lone.sum())
    if sum(counts.values()) < LEAST_MISFITS:
        return []
    listed = listed_names([f"{name} ({count})" for name, count in counts.items()])
    text = (
        f"2D people of {sum(counts.values())} views fit nobody, unlike those before and after, and have no "
        f"effect; are stamps wrong there? {listed}"
    )
    return [Notice("continuous.misfits", "info", text, {"views": counts})]


def _samples(frames: Sequence[CameraFrame], times: Array, camera: int) -> tuple[_Poses, Array]:
    """Return some 2D people of every window of a camera, and the windows (N,)."""
    own = [k for k, frame in enumerate(frames) if frame.camera == camera and len(frame.plane)]
    windows = ((times[own] - times[0]) / WINDOW_S).astype(np.int64)
    chosen = []
    for window in np.unique(windows):
        inside = np.flatnonzero(windows == window)
        spread = np.unique(np.linspace(0, len(inside) - 1, SAMPLES).round().astype(np.int64))
        chosen += [own[k] for k in inside[spread]]
    rows = [(k, d) for k in chosen for d in range(len(frames[k].plane))]
    joints = frames[0].plane.shape[1]
    poses = _Poses(
        np.array([times[k] for k, _ in rows]),
        np.array([frames[k].plane[d] for k, d in rows]).reshape(-1, joints, 2),
        np.array([frames[k].scores[d] > 0.0 for k, d in rows]).reshape(-1, joints),
    )
    return poses, ((poses.times - times[0]) / WINDOW_S).astype(np.int64)


def _misses(
    poses: _Poses, people: Sequence[TimedCurve], arrays: RigArrays, camera: int, shift: float = 0.0
) -> Array:
    """Return the mean distances (N,) of 2D people from the nearest person, NaN where there is no person.

    Args:
        shift: (s) added to the times.
    """
    rotation, translation = arrays.rotations[camera], arrays.translations[camera]
    best = np.full(len(poses.times), np.nan)
    for person in people:
        local = person.at(poses.times + shift) @ rotation.T + translation
        with np.errstate(invalid="ignore", divide="ignore"):
            gaps = np.linalg.norm(local[..., :2] / local[..., 2:] - poses.plane, axis=-1)
            gaps = np.where(local[..., 2] > 0.0, np.minimum(gaps, MISS), MISS)
        there = poses.known & np.isfinite(local[..., 2])
        total = np.where(there, gaps, 0.0).sum(axis=1) / np.maximum(there.sum(axis=1), 1)
        best = np.fmin(best, np.where(there.any(axis=1), total, np.nan))
    return best


def _middle(values: Array) -> float:
    """Return the median of the numbers that are known, NaN for too few."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) >= LEAST_SAMPLES else np.nan


def _fault(
    camera: int,
    poses: _Poses,
    windows: Array,
    suspect: Sequence[int],
    people: Sequence[TimedCurve],
    arrays: RigArrays,
) -> ClockFault | None:
    """Return the fault of a camera if another time explains its 2D people in the suspected windows."""
    rows = np.flatnonzero(np.isin(windows, suspect))
    if not len(rows):
        return None
    few = poses.part(rows[np.unique(np.linspace(0, len(rows) - 1, SEARCHED).round().astype(np.int64))])
    costs = np.array([_middle(_misses(few, people, arrays, camera, shift)) for shift in SHIFTS_S])
    now = _middle(_misses(few, people, arrays, camera))
    if not np.isfinite(costs).any():
        return None
    best = int(np.nanargmin(costs))
    if not costs[best] < BETTER * now or abs(SHIFTS_S[best]) < LEAST_SHIFT_S:
        return None
    shifted = _misses(poses, people, arrays, camera, float(SHIFTS_S[best]))
    plain = _misses(poses, people, arrays, camera)
    wrong = [w for w in suspect if _middle(shifted[windows == w]) < BETTER * _middle(plain[windows == w])]
    if not wrong:
        return None
    # a window beside those may be wrong in part, and the outermost windows have few views
    first, last = min(wrong) - 1, max(wrong) + 1
    begin = -np.inf if first <= windows[0] else WINDOW_S * first
    end = np.inf if last >= windows[-1] else WINDOW_S * (last + 1)
    return ClockFault(camera, begin, end, -float(SHIFTS_S[best]))
