"""Association view by view: 2D people of one camera and instant are assigned to people without any grouping.

Each view is assigned alone. All tracks are predicted to the timestamp of the view, and its 2D people are
assigned to the nearest predictions. Unassigned 2D people of two cameras start a candidate. Further views
confirm a candidate or discard it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from panoptic_ros.continuous.motion import (
    START_ACCELERATION,
    START_SPEED,
    JointFilters,
    ViewRays,
    predict,
    update,
)
from panoptic_ros.continuous.view_costs import SIGMA, ambiguous, view_costs
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.geometry.medians import finite_median
from panoptic_ros.identity.assignment import best_pairs
from panoptic_ros.solving.frames import CameraFrame

Array = np.ndarray
GATE = 3.5  # standard deviations, mean distance up to which a 2D person may belong to a person
# factor on SIGMA of 2D people that fit another person as well. With 4, people who embrace change places; with
# no update, their tracks drift apart. On 8 rendered captures, 8 and 30 give more exchanges of people than 16
UNSURE = 16.0
MEMORY_S = 0.5  # s without a view after which a person has left
# share of the expected views of MEMORY_S below which a person has left; minimum number of these views
LEAST_SHARE, SHARE_VIEWS = 0.2, 6
PAIR_S = 0.08  # s, time between two views of different cameras that may start a person
PAIR_DISTANCE = 0.08  # m, mean distance of their rays
MOST_RAY_DISTANCE = 0.3  # m, upper limit of the distance of two rays in that mean
PAIR_JOINTS = 6  # minimum number of joints that both see
LEAST_SINE = 0.2  # least sine of the angle between the rays of a joint that both see
START_SIGMA = 0.06  # m, standard deviation of a joint that two rays start
CONFIRM_CAMERAS, CONFIRM_VIEWS, CONFIRM_SHARE = 3, 5, 0.6
# number of views, and share of the expected ones, that confirm a person whom two cameras see
PAIR_VIEWS, PAIR_SHARE = 10, 0.8
SETTLED_VIEWS = 10  # views after confirmation, after which the filter serves the search in reversed time


class Entry(NamedTuple):
    """2D person that was assigned.

    Args:
        frame: index of the frame.
        person: row of the 2D person in the frame.
        depth: (m) of the person in the camera.
        mirrored: True if the 2D person fits with left and right exchanged.
        squares: (J,) squared innovations of the person's joints, see `motion.update`; () = unknown.
    """

    frame: int
    person: int
    depth: float
    mirrored: bool = False
    squares: Array | tuple[()] = ()


@dataclass(eq=False)
class ViewTrack:
    """Person followed from view to view.

    Args:
        filters: Motion at `time`.
        time: (s) time of the filters.
        number: Order of the start.
        last: (s) timestamp of the newest view that shows the person.
        entries: (V) 2D people, one per view.
        cameras: (V) their cameras.
        missed: (int) number of views in which a person was expected and not found.
        recent: (time, whether found) of the views of the last MEMORY_S in which the person was expected.
        excess: Number of views that show the person, minus LEAST_SHARE of those expected, and its maximum.
        surest: Frame of that maximum. Fewer than LEAST_SHARE of the views after it show the person.
        confirmed: (int) number of views at confirmation, 0 = candidate.
        seed: (time, filters) for the search in reversed time.
    """

    filters: JointFilters
    time: float
    number: int
    last: float
    entries: list[Entry] = field(default_factory=list)
    exchanged: int = 0
    cameras: set[int] = field(default_factory=set)
    missed: int = 0
    recent: deque[tuple[float, bool]] = field(default_factory=deque)
    excess: tuple[float, float] = (0.0, 0.0)
    surest: int = 0
    confirmed: int = 0
    seed: tuple[float, JointFilters] | None = None

    def move(self, time: float) -> None:
        """Predict the filters to a time."""
        if time != self.time:
            predict(self.filters, time - self.time)
            self.time = time

    def take(
        self,
        number: int,
        person: int,
        view: ViewRays,
        frame: CameraFrame,
        mirror: Array | None = None,
        unsure: bool = False,
    ) -> None:
        """Update with a 2D person of view `number` at the present time.

        Args:
            mirror: (J,) joint on the other side of each joint, if left and right are exchanged.
            unsure: the 2D person fits another person as well, and moves the filters little.
        """
        plane, known = frame.plane[person].copy(), frame.scores[person] > 0.0
        if mirror is not None:
            plane, known = plane[mirror], known[mirror]
        squares = update(self.filters, view, plane, known, UNSURE * SIGMA if unsure else SIGMA)
        self.last = self.time
        depth = finite_median(self.positions @ view.rotation[2]) + float(view.translation[2])
        self.entries.append(Entry(number, person, depth, mirror is not None, squares))
        self.exchanged += mirror is not None
        self.cameras.add(frame.camera)

    def count(self, number: int, found: bool) -> None:
        """Count view `number`, in which the person is expected."""
        self.missed += not found
        self.recent.append((self.time, found))
        while abs(self.recent[0][0] - self.time) > MEMORY_S:
            self.recent.popleft()
        excess = self.excess[0] + found - LEAST_SHARE
        if excess >= self.excess[1]:
            self.surest = number
        self.excess = excess, max(excess, self.excess[1])

    def turn(self, mirror: Array) -> None:
        """Exchange left and right if most views show the person that way."""
        if 2 * self.exchanged > len(self.entries):
            self.exchanged = len(self.entries) - self.exchanged
            for filters in (self.filters, self.seed[1]) if self.seed else (self.filters,):
                for values in filters:
                    values[:] = values[mirror]
            self.entries = [
                entry._replace(
                    mirrored=not entry.mirrored, squares=entry.squares[mirror] if len(entry.squares) else ()
                )
                for entry in self.entries
            ]

    def keep(self, oldest: int) -> None:
        """Forget the views before a frame."""
        self.entries = [entry for entry in self.entries if entry.frame >= oldest]
        self.exchanged = sum(entry.mirrored for entry in self.entries)

    @property
    def rare(self) -> bool:
        """Return whether so few of the recent views show the person that it has left."""
        least, shown = LEAST_SHARE * len(self.recent), 0
        for _, found in self.recent:
            shown += found
            if shown >= least:
                return False
        return len(self.recent) >= SHARE_VIEWS

    @property
    def positions(self) -> Array:
        """Return the positions (J, 3) m at `time`, NaN = unknown."""
        return self.filters.states[:, 0]


class ViewTracker:
    """Follows people through views in order of time, or in reversed order from given seeds."""

    def __init__(self, arrays: RigArrays, mirror: Array, pair_s: float = PAIR_S):
        self._arrays, self._mirror, self.pair_s = arrays, mirror, pair_s
        self.views = [
            ViewRays(rotation, translation)
            for rotation, translation in zip(arrays.rotations, arrays.translations)
        ]
        self._free: list[tuple[float, int, Array, Array, int]] = []  # unassigned 2D people: time, camera, ...
        self._numbers = 0
        self.active: list[ViewTrack] = []
        self.ended: list[ViewTrack] = []

    def step(self, number: int, frame: CameraFrame, time: float) -> None:
        """Assign the 2D people of one view, and start, confirm and end people.

        Args:
            number: index of the frame, for `ViewTrack.entries`.
            time: (s) corrected timestamp.
        """
        for track in self.active:
            track.move(time)
        self._end(time)
        left = set(range(len(frame.plane)))
        sure = [track for track in self.active if track.confirmed]
        left -= self._assign(sure, number, frame, left)
        candidates = [track for track in self.active if not track.confirmed]
        left -= self._assign(candidates, number, frame, left)
        for track in candidates:
            self._judge(track)
        for person in sorted(left):
            self._start(number, frame, person, time)

    def finish(self) -> list[ViewTrack]:
        """Return the people in the order of their starts; those who ended before they settled are ghosts.

        Views after the surest one are left out.
        """
        found = [track for track in self.ended if track.seed]
        for track in self.active:
            if track.confirmed:
                track.seed = track.seed or (track.time, track.filters.copy())
                found.append(track)
        self.active = []
        for track in found:
            track.entries = [entry for entry in track.entries if entry.frame <= track.surest]
        return sorted(found, key=lambda track: track.number)

    def _assign(self, tracks: list[ViewTrack], number: int, frame: CameraFrame, free: set[int]) -> set[int]:
        """Assign free 2D people to tracks.

        Returns:
            the assigned ones, and those that fit a confirmed track that has a better one: duplicates.
        """
        people = sorted(free)
        if not tracks:
            return set()
        view = self.views[frame.camera]
        explained: set[int] = set()
        pairs: list[tuple[int, int]] = []
        unsure: set[int] = set()
        if people:
            costs = [view_costs(track.filters, view, frame, people, self._mirror) for track in tracks]
            least = np.stack([np.minimum(*cost) for cost in costs])
            pairs = best_pairs(least, GATE)
            sure = np.array([track.confirmed > 0 for track in tracks])
            unsure = ambiguous(least, pairs) if sure.all() else unsure
            explained = {people[k] for k in np.flatnonzero((least[sure] <= GATE).any(axis=0))}
        for row, column in pairs:
            straight, mirrored = costs[row]
            exchanged = self._mirror if mirrored[column] < straight[column] else None
            tracks[row].take(number, people[column], view, frame, exchanged, row in unsure)
            tracks[row].turn(self._mirror)
            explained.add(people[column])
            self._settle(tracks[row])
        found = {row for row, _ in pairs}
        for row, track in enumerate(tracks):
            if row in found or self.expected(track, frame.camera):
                track.count(number, row in found)
        return explained

    def _settle(self, track: ViewTrack) -> None:
        if track.confirmed and track.seed is None and len(track.entries) >= track.confirmed + SETTLED_VIEWS:
            track.seed = (track.time, track.filters.copy())

    def expected(self, track: ViewTrack, camera: int) -> bool:
        """Return whether the centre of a person lies in the image of a camera."""
        lens = self._arrays.lenses[camera]
        view = self.views[camera]
        local = view.rotation @ np.nanmedian(track.positions, axis=0) + view.translation
        if local[2] <= 0.1:
            return False
        x, y = local[:2] / local[2]
        return bool(lens["left"] < x < lens["right"] and lens["top"] < y < lens["bottom"])

    def _judge(self, track: ViewTrack) -> None:
        """Confirm a candidate or discard it."""
        views, total = len(track.entries), len(track.entries) + track.missed
        share = views / total
        enough = len(track.cameras) >= CONFIRM_CAMERAS and views >= CONFIRM_VIEWS and share >= CONFIRM_SHARE
        enough |= len(track.cameras) >= 2 and views >= PAIR_VIEWS and share >= PAIR_SHARE
        if enough:
            track.confirmed = views
        elif total >= 2 * CONFIRM_VIEWS and share < 0.5:
            self.active.remove(track)

    def _end(self, time: float) -> None:
        for track in list(self.active):
            if abs(time - track.last) > MEMORY_S or track.rare:
                self.active.remove(track)
                if track.confirmed:
                    self.ended.append(track)

    def _start(self, number: int, frame: CameraFrame, person: int, time: float) -> None:
        """Start a candidate from an unassigned 2D person and an earlier one of another camera."""
        plane, known = frame.plane[person], frame.scores[person] > 0.0
        self._free = [one for one in self._free if time - one[0] <= self.pair_s]
        best, partner = PAIR_DISTANCE, None
        for one in self._free:
            if one[1] != frame.camera:
                distance = self._ray_distance(frame.camera, plane, known, one)
                if distance < best:
                    best, partner = distance, one
        mine = (time, frame.camera, plane, known, number * 1000 + person)
        if partner is None:
            self._free.append(mine)
            return
        self._free = [one for one in self._free if one is not partner]
        track = ViewTrack(self._meeting(mine, partner), time, self._numbers, time)
        self._numbers += 1
        centre = np.nanmedian(track.positions, axis=0)
        for frame_number, who, camera in (
            (*divmod(partner[4], 1000), partner[1]),
            (number, person, frame.camera),
        ):
            view = self.views[camera]
            track.entries.append(
                Entry(frame_number, who, float(view.rotation[2] @ centre + view.translation[2]))
            )
        track.cameras = {partner[1], frame.camera}
        self.active.append(track)

    def _rays(self, camera: int, plane: Array) -> tuple[Array, Array]:
        """Return the centre (3,) of a camera and the directions (J, 3) of rays in the world."""
        local = np.concatenate([plane, np.ones((len(plane), 1))], axis=1)
        local /= np.linalg.norm(local, axis=1, keepdims=True)
        return self._arrays.centres[camera], local @ self._arrays.rotations[camera]

    def _ray_distance(
        self, camera: int, plane: Array, known: Array, other: tuple[float, int, Array, Array, int]
    ) -> float:
        """Return the mean distance (m) of the rays of two 2D people; infinite with too few common joints."""
        common = known & other[3]
        centre, rays = self._rays(camera, plane[common])
        centre2, rays2 = self._rays(other[1], other[2][common])
        cross = np.cross(rays, rays2)
        sine = np.linalg.norm(cross, axis=1)
        good = sine > LEAST_SINE
        if good.sum() < PAIR_JOINTS:
            return np.inf
        gaps = np.abs(cross[good] @ (centre2 - centre)) / sine[good]
        return float(np.minimum(gaps, MOST_RAY_DISTANCE).mean())

    def _meeting(
        self,
        one: tuple[float, int, Array, Array, int],
        other: tuple[float, int, Array, Array, int],
    ) -> JointFilters:
        """Return filters of joints that start where two rays meet, at rest; joints of one ray are unknown."""
        filters = JointFilters.unknown(len(self._mirror))
        common = np.flatnonzero(one[3] & other[3])
        (c1, d1), (c2, d2) = self._rays(one[1], one[2][common]), self._rays(other[1], other[2][common])
        for j, u, v in zip(common, d1, d2):
            # nearest points of the rays c1 + s u and c2 + t v
            b = float(u @ v)
            if 1.0 - b * b < LEAST_SINE**2:
                continue
            w = c2 - c1
            s, t = (u @ w - b * (v @ w)) / (1.0 - b * b), (b * (u @ w) - v @ w) / (1.0 - b * b)
            filters.states[j] = 0.0
            filters.states[j, 0] = 0.5 * (c1 + s * u + c2 + t * v)
            gap = np.linalg.norm(c1 + s * u - c2 - t * v)
            variances = [START_SIGMA**2 + gap**2, START_SPEED**2, START_ACCELERATION**2]
            filters.covariances[j] = np.diag(np.repeat(np.array(variances), 3))
        return filters


def follow(frames: Sequence[CameraFrame], times: Array, arrays: RigArrays, mirror: Array) -> list[ViewTrack]:
    """Return the people of all views (F,), which are in the order of the times (F,) s.

    A search in reversed time adds the views before a person was confirmed.

    Args:
        mirror: (J,) joint on the other side of each joint.
    """
    tracker = ViewTracker(arrays, mirror, pairing_time(frames, times))
    for number, (frame, time) in enumerate(zip(frames, times)):
        tracker.step(number, frame, float(time))
    tracks = tracker.finish()
    _extend(tracker, tracks, frames, times, mirror)
    return tracks


def camera_periods(frames: Sequence[CameraFrame], times: Array) -> list[float]:
    """Return the median time (s) between the frames of each camera that has two frames."""
    cameras = np.array([frame.camera for frame in frames], np.int64)
    of_cameras = [times[cameras == c] for c in np.unique(cameras)]
    return [float(np.median(np.diff(own))) for own in of_cameras if len(own) > 1]


def pairing_time(frames: Sequence[CameraFrame], times: Array) -> float:
    """Return the time (s) between two views that may start a person: half a period of the slowest camera."""
    return pairing_time_of(camera_periods(frames, times))


def pairing_time_of(periods: Iterable[float]) -> float:
    """Return the time (s) between two views that may start a person, from the cameras' periods (s)."""
    return max([PAIR_S, *(0.5 * period for period in periods if period < 1.0)])


def _extend(
    tracker: ViewTracker, tracks: list[ViewTrack], frames: Sequence[CameraFrame], times: Array, mirror: Array
) -> None:
    """Add views before the seeds of the people, in reversed time, in place."""
    owners: dict[tuple[int, int], ViewTrack] = {}
    for track in tracks:
        owners.update({(entry.frame, entry.person): track for entry in track.entries})
    waiting = sorted(tracks, key=lambda track: track.seed[0] if track.seed else 0.0)
    copies: list[tuple[ViewTrack, ViewTrack]] = []  # a person, and its copy in reversed time
    active: list[tuple[ViewTrack, ViewTrack]] = []
    for number in range(len(frames) - 1, -1, -1):
        time, frame = float(times[number]), frames[number]
        while waiting and waiting[-1].seed is not None and waiting[-1].seed[0] >= time:
            seed = waiting[-1].seed
            copies.append((waiting.pop(), ViewTrack(seed[1], seed[0], 0, seed[0])))
            active.append(copies[-1])
        active = [pair for pair in active if pair[1].last - time <= MEMORY_S and not pair[1].rare]
        view = tracker.views[frame.camera]
        owned = {id(owners.get((number, d))): d for d in range(len(frame.plane))}
        free = [d for d in range(len(frame.plane)) if (number, d) not in owners]
        others = []
        for track, copy in active:
            copy.move(time)
            if id(track) in owned:
                own = next(entry for entry in reversed(track.entries) if entry.frame == number)
                copy.take(number, own.person, view, frame, mirror if own.mirrored else None)
                copy.count(number, True)
            else:
                others.append((track, copy))
        pairs, unsure = [], set()
        if others and free:
            costs = [view_costs(copy.filters, view, frame, free, mirror) for _, copy in others]
            least = np.stack([np.minimum(*cost) for cost in costs])
            pairs = best_pairs(least, GATE)
            unsure = ambiguous(least, pairs)
        for row, column in pairs:
            track, copy = others[row]
            exchanged = mirror if costs[row][1][column] < costs[row][0][column] else None
            copy.take(number, free[column], view, frame, exchanged, row in unsure)
            track.entries.append(copy.entries[-1])
            track.cameras.add(frame.camera)
            owners[number, free[column]] = track
        found = {row for row, _ in pairs}
        for row, (_, copy) in enumerate(others):
            if row in found or tracker.expected(copy, frame.camera):
                copy.count(number, row in found)
    for track, copy in copies:
        kept = [entry for entry in track.entries if entry.frame >= copy.surest]
        track.entries = sorted(kept, key=lambda entry: entry[:2])
