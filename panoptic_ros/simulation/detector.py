"""Simulated detector of 2D poses: it projects the true joints and adds the faults of a `Degradation`.

Array axes: C cameras, P people, 19 joints. All cameras and people of one instant are processed together.

A joint is occluded by bodies, a table or walls. A body is a set of capsules around its bones. A joint is
hidden if the segment from the camera to a point just in front of the joint passes through a capsule.

False people (ghosts) appear partly at fixed background positions and partly at random positions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import Camera, Rig
from panoptic_ros.simulation.body import ADULT
from panoptic_ros.simulation.degradation import Degradation
from panoptic_ros.simulation.people import SimulatedPerson, draw_person
from panoptic_ros.simulation.silhouettes import box_overlap, boxes_of, seen_from_behind
from panoptic_ros.simulation.skeleton import JOINTS, J, both_sides
from panoptic_ros.simulation.walls import Wall, behind_walls

OWN = 0.7  # scale of capsule radii against joints of the same body
SKIN = 0.03  # m; visible surface point of a joint, in front of its centre
TABLE_HEIGHT = 0.70  # m; height of the table top
BATCH = 16  # number of views processed together, to bound the memory
STEADY = 0.8  # probability per frame that a ghost at a fixed position is reported
FIXED_SHARE = 0.5  # share of ghosts at fixed positions
FOUND = 0.7  # share of a ghost's joints that are reported
FEWEST = 4  # smallest number of joints of a ghost
TEMPLATES = 8
Array = np.ndarray
ARMS = both_sides("Shoulder", "Elbow", "Wrist")
LEGS = both_sides("Hip", "Knee", "Ankle")
EVERYTHING = both_sides("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle", "Eye", "Ear")
EXCHANGED = (*ARMS, *LEGS, np.concatenate(LEGS))  # joint groups that two overlapping people can exchange
AVERAGE_QUALITY = 0.72  # quality score at which the noise is exactly `noise_px`
OVERLAP = 0.2  # smallest box overlap (`box_overlap`) at which two people can merge
MELT = 0.3  # share of merges in which one of the two people vanishes
DUPLICATE_KEEPS = 0.6  # share of joints kept in a duplicate
POINT_DIGITS, SCORE_DIGITS = 6, 3


@dataclass(frozen=True)
class OccluderCapsule:
    """Capsule of a body part, the volume that hides joints.

    Args:
        start, end: End points as weighted sums of joints, by joint name.
        radius: Radius in m, for an adult.
        spares: Joints of the same body that this capsule never hides.
    """

    start: dict[str, float]
    end: dict[str, float]
    radius: float
    spares: tuple[str, ...] = ()


def _side(side: str) -> list[OccluderCapsule]:
    limbs = (
        ("Shoulder", "Elbow", 0.045),
        ("Elbow", "Wrist", 0.036),
        ("Hip", "Knee", 0.072),
        ("Knee", "Ankle", 0.050),
    )
    flank = OccluderCapsule(
        {side + "Shoulder": 0.75, "Neck": 0.25},
        {side + "Hip": 0.8, "BodyCenter": 0.2},
        0.085,
        ("Neck", "BodyCenter", side + "Shoulder", side + "Hip"),
    )
    return [flank] + [
        OccluderCapsule({side + a: 1.0}, {side + b: 1.0}, radius, (side + a, side + b))
        for a, b, radius in limbs
    ]


CAPSULES = [  # trunk, head, and both sides
    OccluderCapsule(
        {"Neck": 0.9, "BodyCenter": 0.1},
        {"BodyCenter": 1.0},
        0.120,
        ("Neck", "BodyCenter", "lHip", "rHip"),
    ),
    OccluderCapsule({"lEar": 0.5, "rEar": 0.5}, {"lEar": 0.65, "rEar": 0.65, "Neck": -0.3}, 0.095),
    *_side("l"),
    *_side("r"),
]


def _mixture(ends: list[dict[str, float]]) -> Array:
    """Return joint weights (K, 19) of one end of the K capsules."""
    weights = np.zeros((len(ends), len(JOINTS)))
    for row, end in zip(weights, ends):
        for name, weight in end.items():
            row[J[name]] = weight
    return weights


_START = _mixture([capsule.start for capsule in CAPSULES])
_END = _mixture([capsule.end for capsule in CAPSULES])
_RADIUS = np.array([capsule.radius for capsule in CAPSULES])
_SPARED = np.array([[name in capsule.spares for capsule in CAPSULES] for name in JOINTS])  # (19, K)


def hidden_joints(centres: Array, joints: Array, present: Array, heights: Array, table: float) -> Array:
    """Return a mask (C, P, 19) of the joints that are hidden by bodies or the table.

    Args:
        centres: Camera centres (C, 3) m.
        joints: Joints (C, P, 19, 3) m at each camera's exposure.
        present: Presence (C, P) of people. Absent people hide nothing.
        heights: Body heights (P,) m.
        table: Radius (m) of a round table centred at the origin, 0 = no table.
    """
    cameras, people = present.shape
    points = joints.reshape(cameras, -1, 3)
    towards = centres[:, None] - points
    seen = points + SKIN * towards / np.linalg.norm(towards, axis=-1, keepdims=True)
    starts = (_START @ joints).reshape(cameras, -1, 3)
    ends = (_END @ joints).reshape(cameras, -1, 3)
    radii = _radii(people, heights)
    blocks = np.repeat(present, len(CAPSULES), axis=1)[:, None, :]
    hidden = np.empty(points.shape[:2], bool)
    for first in range(0, cameras, BATCH):
        part = slice(first, first + BATCH)
        distances = segment_distances(centres[part], seen[part], starts[part], ends[part])
        hidden[part] = ((distances < radii) & blocks[part]).any(-1)
    if table > 0.0:
        hidden |= under_table(centres, points, table)
    return hidden.reshape(cameras, people, len(JOINTS))


def _radii(people: int, heights: Array) -> Array:
    """Return the radius (P * 19, P * K) m of every capsule against every joint.

    The radius is 0 where the capsule never hides the joint.
    """
    radius = np.tile(np.outer(heights / ADULT, _RADIUS).ravel(), (people * len(JOINTS), 1))
    for k in range(people):
        rows = slice(k * len(JOINTS), (k + 1) * len(JOINTS))
        columns = slice(k * len(CAPSULES), (k + 1) * len(CAPSULES))
        radius[rows, columns] = np.where(_SPARED, 0.0, OWN * radius[rows, columns])
    return radius


def segment_distances(origins: Array, points: Array, starts: Array, ends: Array) -> Array:
    """Return distances (C, N, K) m between sight segments (origin to point) and capsule axes (start to end).

    The closest points of the two infinite lines are clamped to one segment, then to the other.

    Args:
        origins: Camera centres (C, 3) m.
        points: Observed points (C, N, 3) m.
        starts, ends: Ends of the capsule axes (C, K, 3) m.
    """
    sight, axis = points - origins[:, None], ends - starts
    offset = origins[:, None] - starts  # (C, K, 3)
    sight2 = (sight * sight).sum(-1)[:, :, None]
    axis2 = np.maximum((axis * axis).sum(-1), 1e-12)[:, None, :]
    axis_offset = (axis * offset).sum(-1)[:, None, :]
    offset2 = (offset * offset).sum(-1)[:, None, :]
    cross = sight @ axis.swapaxes(1, 2)
    sight_offset = sight @ offset.swapaxes(1, 2)
    parallel = np.maximum(sight2 * axis2 - cross * cross, 1e-12)
    u = np.clip((cross * axis_offset - sight_offset * axis2) / parallel, 0.0, 1.0)
    w = np.clip((cross * u + axis_offset) / axis2, 0.0, 1.0)
    u = np.clip((cross * w - sight_offset) / sight2, 0.0, 1.0)
    squared = offset2 + u * u * sight2 + w * w * axis2
    squared += 2.0 * (u * sight_offset - w * axis_offset - u * w * cross)
    distances: Array = np.sqrt(np.maximum(squared, 0.0))
    return distances


def under_table(centres: Array, points: Array, radius: float) -> Array:
    """Return a mask (C, N) of points hidden by the table top, a horizontal disc centred above the origin."""
    drop = points[..., 2] - centres[:, None, 2]
    share = (TABLE_HEIGHT - centres[:, None, 2]) / np.where(drop == 0.0, 1e-9, drop)
    crossing = centres[:, None, :2] + share[..., None] * (points - centres[:, None])[..., :2]
    hidden: Array = (share > 0.0) & (share < 1.0) & (np.linalg.norm(crossing, axis=-1) < radius)
    return hidden


class Ghosts:
    """Generator of false people in every camera.

    Args:
        rate: Mean number of ghosts per view.
        noise_px: Standard deviation of their joints per axis, px.
    """

    def __init__(self, rng: np.random.Generator, rate: float, noise_px: float, cameras: Sequence[Camera]):
        self._rate, self._noise, self._cameras = rate, noise_px, cameras
        self._templates = [_template(rng) for _ in range(TEMPLATES)]
        counts = rng.poisson(FIXED_SHARE * rate / STEADY, len(cameras))
        self._fixed = [[self._place(rng, c) for _ in range(n)] for c, n in zip(cameras, counts)]

    def appear(self, rng: np.random.Generator, camera: int) -> list[tuple[Array, Array]]:
        """Return the ghosts of one image as pairs of points (19, 2) px, NaN = missing, and scores (19,)."""
        shapes = [place for place in self._fixed[camera] if rng.random() < STEADY]
        count = rng.poisson((1.0 - FIXED_SHARE) * self._rate)
        shapes += [self._place(rng, self._cameras[camera]) for _ in range(count)]
        ghosts = []
        for shape in shapes:
            points = shape + self._noise * rng.standard_normal(shape.shape)
            found = (rng.random(len(JOINTS)) < FOUND) & self._cameras[camera].contains(points)
            scores = rng.uniform(0.15, 0.75, len(JOINTS))
            if found.sum() >= FEWEST:
                ghosts.append((np.where(found[:, None], points, np.nan), np.where(found, scores, 0.0)))
        return ghosts

    def _place(self, rng: np.random.Generator, camera: Camera) -> Array:
        """Return a template (19, 2) px at a random position in the image."""
        width, height = camera.image_size
        middle = rng.uniform(0.1, 0.9, 2) * [width, height]
        size = height * rng.uniform(0.15, 0.5)
        return middle + size * self._templates[int(rng.integers(TEMPLATES))]


def _template(rng: np.random.Generator) -> Array:
    """Return the joints (19, 2) of a standing person from a random horizontal direction, y down.

    They are scaled to height 1 and centred at 0.
    """
    person = draw_person(rng, 0, "stand", 1.7, 0.1)
    angle = rng.uniform(0.0, 2.0 * np.pi)
    joints = person.joints(rng.uniform(0.0, 10.0, 1))[0]
    across = joints[:, :2] @ np.array([np.cos(angle), np.sin(angle)])
    flat = np.column_stack([across, -joints[:, 2]])
    shape: Array = (flat - flat.mean(axis=0)) / np.ptp(flat[:, 1])
    return shape


@dataclass(frozen=True)
class Absence:
    """Period from `start` until `end` (s) in which a person, or some of its joints, is not detected.

    Args:
        person: Index of the person.
        cameras: Indices of cameras in the rig; empty = all.
        joints: Joint names; empty = the whole person.
    """

    person: int
    start: float
    end: float
    cameras: tuple[int, ...] = ()
    joints: tuple[str, ...] = ()

    def holds(self, times: Array) -> Array:
        """Return a mask (C,) of cameras that are affected at their exposure times (C,) s."""
        among = np.isin(np.arange(len(times)), self.cameras) if self.cameras else np.ones(len(times), bool)
        during: Array = (times >= self.start) & (times < self.end) & among
        return during


@dataclass(frozen=True, eq=False)
class Sightings:
    """Detections of one camera.

    Args:
        points: Joints (Q, 19, 2) px, NaN = missing.
        scores: Scores (Q, 19).
        sources: True person and joint (Q, 19, 2) of each reported joint, for tests and for studies of the
            best possible result. The value -1 marks joints without a source: missing, outlier, ghost,
            duplicate.
        sigmas: Standard deviation (Q, 19) px of the noise of joints with a source, NaN otherwise.
    """

    points: Array
    scores: Array
    sources: Array
    sigmas: Array


@dataclass(frozen=True, eq=False)
class _JointDetections:
    """Joint detections (C, P, 19, ...) before they are assembled into people."""

    points: Array
    scores: Array
    found: Array
    sigmas: Array
    outliers: Array


class SimulatedDetector:
    """Simulated detector for all cameras.

    Frames must be requested in order from 0, because the noise is correlated between frames.
    """

    def __init__(
        self,
        seed: Sequence[int],
        degradation: Degradation,
        rig: Rig,
        people: Sequence[SimulatedPerson],
        absences: Sequence[Absence] = (),
        table: float = 0.0,
        walls: Sequence[Wall] = (),
    ):
        self._seed, self._faults, self._rig, self._people = tuple(seed), degradation, rig, people
        self._absences, self._table, self._walls = absences, table, walls
        self._centres = np.array([camera.centre for camera in rig.cameras])
        self._heights = np.array([person.body.height for person in people])
        self._noise = np.zeros((len(rig), len(people), len(JOINTS), 2))
        ghosts = np.random.default_rng([*seed, 0])
        self._ghosts = Ghosts(ghosts, degradation.ghosts, degradation.noise_px, rig.cameras)

    def detect(self, index: int, times: Array) -> list[Sightings]:
        """Return the detections of every camera in frame `index`, exposed at `times` (C,) s."""
        rng = np.random.default_rng([*self._seed, 1, index])
        slow = np.random.default_rng([*self._seed, 2, index // self._faults.hold])
        joints = np.stack([person.joints(times) for person in self._people], axis=1)
        present = np.stack([person.is_present(times) for person in self._people], axis=1)
        points, visible = self._project(joints)
        visible &= present[..., None] & ~behind_walls(self._centres, joints, self._walls)
        hidden = hidden_joints(self._centres, joints, present, self._heights, self._table)
        boxes = boxes_of(points, visible)
        marks = self._mark(rng, index, points, visible, hidden, boxes)
        marks = replace(marks, found=self._without(times, marks.found))
        reported = self._report(slow, times, (marks.found & ~hidden).sum(-1))
        # person and joint indices (C, P, 19, 2)
        pick = np.moveaxis(np.indices(visible.shape)[1:], 0, -1).copy()
        self._swap(slow, pick, seen_from_behind(joints, self._centres))
        self._merge(rng, pick, reported, boxes)
        return self._collect(rng, marks, reported, pick)

    def _project(self, joints: Array) -> tuple[Array, Array]:
        """Return points (C, P, 19, 2) px and a mask of points inside the image."""
        points, visible = np.empty(joints.shape[:-1] + (2,)), np.empty(joints.shape[:-1], bool)
        for c, camera in enumerate(self._rig.cameras):
            pixels, seen = camera.project(joints[c])
            points[c], visible[c] = np.nan_to_num(pixels), seen & camera.contains(pixels)
        return points, visible

    def _mark(
        self,
        rng: np.random.Generator,
        index: int,
        points: Array,
        visible: Array,
        hidden: Array,
        boxes: Array,
    ) -> _JointDetections:
        """Return the joints with noise, outliers, misses and scores."""
        faults, shape = self._faults, visible.shape
        quality = np.where(hidden, rng.beta(3.0, 4.0, shape), rng.beta(6.0, 2.0, shape))
        spread = np.exp(1.2 * (AVERAGE_QUALITY - quality))  # better quality gives smaller noise
        sigmas = faults.noise_px * np.where(hidden, faults.hidden_noise, spread)
        if faults.size_px is not None:
            size = np.linalg.norm(np.nan_to_num(boxes[..., 2:] - boxes[..., :2]), axis=-1)
            sigmas = sigmas * np.clip(size / faults.size_px, 0.4, 3.0)[..., None]
        memory = faults.memory if index else 0.0
        self._noise = memory * self._noise + np.sqrt(1.0 - memory**2) * rng.standard_normal(points.shape)
        noise = self._noise
        if faults.memory_share < 1.0:
            white = rng.standard_normal(points.shape)
            noise = np.sqrt(faults.memory_share) * noise + np.sqrt(1.0 - faults.memory_share) * white
        outliers = rng.random(shape) < faults.outlier
        angle = rng.uniform(0.0, 2.0 * np.pi, shape)
        far = faults.outlier_px * rng.uniform(0.5, 1.5, shape)
        jump = far[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        points = points + np.where(outliers[..., None], jump, sigmas[..., None] * noise)
        quality = np.where(outliers, 0.8 * quality, quality)
        scores = np.clip(quality + 0.05 * rng.standard_normal(shape), 0.02, 0.99)
        missed = rng.random(shape) < np.where(hidden, faults.hidden_miss, faults.joint_miss)
        inside = np.stack([camera.contains(p) for camera, p in zip(self._rig.cameras, points)])
        return _JointDetections(points, scores, visible & inside & ~missed, sigmas, outliers)

    def _report(self, rng: np.random.Generator, times: Array, seen: Array) -> Array:
        """Return a mask (C, P) of reported people, given their numbers of visible joints `seen` (C, P)."""
        reported = (seen >= self._faults.fewest_joints) & (rng.random(seen.shape) >= self._faults.person_miss)
        for absence in self._absences:
            if not absence.joints:
                reported[:, absence.person] &= ~absence.holds(times)
        return reported

    def _without(self, times: Array, found: Array) -> Array:
        """Return the mask of found joints (C, P, 19) without those that absences remove."""
        found = found.copy()
        for absence in self._absences:
            for name in absence.joints:
                found[absence.holds(times), absence.person, J[name]] = False
        return found

    def _swap(self, rng: np.random.Generator, pick: Array, behind: Array) -> None:
        """Exchange left and right joints in `pick`, in place."""
        draws = rng.random((*behind.shape, 3))
        for c, p in np.argwhere(draws[..., 0] < self._faults.limb_swap):
            _exchange(pick[c, p], *(ARMS if draws[c, p, 1] < 0.5 else LEGS))
        for c, p in np.argwhere(behind & (draws[..., 2] < self._faults.back_swap)):
            _exchange(pick[c, p], *EVERYTHING)

    def _merge(self, rng: np.random.Generator, pick: Array, reported: Array, boxes: Array) -> None:
        """Let overlapping people exchange limbs or melt into one, in place."""
        draws = rng.random((*reported.shape, reported.shape[1], 3))
        takes = rng.random((*reported.shape, len(JOINTS))) < 0.5
        for c, a, b in np.argwhere(draws[..., 0] < self._faults.merge):
            if a >= b or not (reported[c, a] and reported[c, b]):
                continue
            if box_overlap(boxes[c, a], boxes[c, b]) < OVERLAP:
                continue
            if draws[c, a, b, 1] < MELT:
                pick[c, a, takes[c, a]] = pick[c, b, takes[c, a]]
                reported[c, b] = False
            else:
                limb = EXCHANGED[int(draws[c, a, b, 2] * len(EXCHANGED))]
                pick[c, [[a], [b]], limb] = pick[c, [[b], [a]], limb]

    def _collect(
        self, rng: np.random.Generator, marks: _JointDetections, reported: Array, pick: Array
    ) -> list[Sightings]:
        """Return the people of every view in random order, with duplicates and ghosts."""
        doubled = rng.random(reported.shape) < self._faults.duplicate
        shift = rng.standard_normal(marks.points.shape)
        kept = rng.random(marks.found.shape) < DUPLICATE_KEEPS
        nobody = np.full((len(JOINTS), 2), -1)
        unknown = np.full(len(JOINTS), np.nan)
        views = []
        for c, camera in enumerate(self._rig.cameras):
            rows: list[tuple[Array, Array, Array, Array]] = []
            for p in np.flatnonzero(reported[c]):
                at = (c, pick[c, p, :, 0], pick[c, p, :, 1])
                found, points, scores = marks.found[at], marks.points[at], marks.scores[at]
                if not found.any():
                    continue
                known = found & ~marks.outliers[at]
                source = np.where(known[:, None], pick[c, p], -1)
                sigmas = np.where(known, marks.sigmas[at], np.nan)
                rows.append((*_hide(points, scores, found), source, sigmas))
                blurred = points + marks.sigmas[at][:, None] * shift[c, p]
                again = found & kept[c, p] & camera.contains(blurred)
                if doubled[c, p] and again.any():
                    rows.append((*_hide(blurred, 0.8 * scores, again), nobody, unknown))
            rows += [(*ghost, nobody, unknown) for ghost in self._ghosts.appear(rng, c)]
            views.append(_sightings([rows[i] for i in rng.permutation(len(rows))]))
        return views


def _exchange(pick: Array, left: Array, right: Array) -> None:
    pick[np.concatenate([left, right])] = pick[np.concatenate([right, left])]


def _hide(points: Array, scores: Array, found: Array) -> tuple[Array, Array]:
    """Return rounded points and scores, with NaN and 0 where a joint is not found."""
    points = np.where(found[:, None], np.round(points, POINT_DIGITS), np.nan)
    return points, np.where(found, np.round(scores, SCORE_DIGITS), 0.0)


def _sightings(rows: list[tuple[Array, Array, Array, Array]]) -> Sightings:
    count, joints = len(rows), len(JOINTS)
    points, scores, sources, sigmas = zip(*rows) if rows else ((), (), (), ())
    return Sightings(
        np.array(points, np.float64).reshape(count, joints, 2),
        np.array(scores, np.float64).reshape(count, joints),
        np.array(sources, np.int64).reshape(count, joints, 2),
        np.array(sigmas, np.float64).reshape(count, joints),
    )
