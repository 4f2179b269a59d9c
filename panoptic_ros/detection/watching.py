"""Detection guided by tracks, where the network does not run on all of every image.

`RigDetector` decides for each image between the whole image, regions, a scan for new people and propagation
by optical flow. `TrackedPeople` holds the tracks. `ExpectedPeople` holds the image positions at which a
camera should see them.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from panoptic_ros.detection.allowance import Allowance
from panoptic_ros.detection.budget import DetectionPace
from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.detection.flow import COARSE, WIDTH, FlowReference, carried, is_cut, remembered
from panoptic_ros.detection.full_image import FullImageNetwork, ImageDetections
from panoptic_ros.detection.looking import DetectionMode, DetectionScheduler
from panoptic_ros.detection.people import DetectedPeople, boxes_of_points, concatenate, no_people
from panoptic_ros.detection.preprocess import ImageRotation, turn_by
from panoptic_ros.detection.regions import PeopleGroup, Region, groups_of, person_boxes
from panoptic_ros.detection.resemblance import apart
from panoptic_ros.domain import Camera, JointMap, Rig, TrackSet, ViewFrame
from panoptic_ros.errors import ConfigError

Array = np.ndarray
Joints = tuple[Array, Array]  # points (N, J, 2) px and scores (N, J) of N 2D poses, 0 = missing
MEMORY = 2.0  # s, how long regions are kept for people who are not seen
FARTHEST = 0.5  # s, longest prediction of motion
STRAY = 0.7  # m/s, growth of the position uncertainty of people who are not seen
NEAREST = 0.1  # m, least depth in front of a camera
DOORS = 8  # number of entry places (where people appeared) that are remembered
SAME_DOOR = 1.0  # m, distance within which two entry places are the same
BEGINNING_NS = 1_000_000_000
EXPLAINED = 0.2  # median joint distance between detection and prediction of one person, share of the height
# limit as EXPLAINED, for people so close that one track could explain the detection of another
IN_A_CROWD = 0.1
SURE_STRANGER = 0.25  # person score from which an unexplained detection raises an alarm
SCAN_HEIGHT = 90.0  # px of the network input, height of a median person in a scan (small whole image)
LEAST_SCAN = 128  # px of the network input, least longer side of a scan
CLOSER = 1.36  # height of people in a closer look at a crowd, relative to that in regions
ENLARGED = 2.0  # px of the network input per px of the image, greatest scale of a closer look
UNKNOWN_SCAN = 0.45  # side of a scan relative to the camera's usual side, where no heights are known

Whole = Callable[[ViewFrame], ImageDetections]  # detects the people in the whole image
Side = Callable[[ViewFrame], int]  # longer side of the network input that suits a camera


@dataclass(frozen=True, eq=False)
class ExpectedPeople:
    """Image positions at which a camera should see P people.

    Args:
        pixels: (P, J, 2) px of the joints.
        there: (P, J) which joints are known and in front of the camera.
        doubts: (P,) px, standard deviation of the positions.
        image_size: (width, height) px.
    """

    pixels: Array
    there: Array
    doubts: Array
    image_size: tuple[int, int]

    @classmethod
    def of_nobody(cls, image_size: tuple[int, int]) -> ExpectedPeople:
        """Return an instance without people."""
        return cls(np.zeros((0, 1, 2)), np.zeros((0, 1), bool), np.zeros(0), image_size)

    def turned(self, turn: ImageRotation) -> ExpectedPeople:
        """Map the people to the upright image."""
        return replace(self, pixels=turn.pixels(self.pixels), image_size=turn.size)

    @cached_property
    def _boxes(self) -> tuple[Array, Array, Array]:
        return person_boxes(self.pixels, self.there, self.doubts, self.image_size)

    @property
    def heights(self) -> Array:
        """Return the heights (N,) px of the people who are in the image."""
        return self._boxes[1]

    @cached_property
    def groups(self) -> list[PeopleGroup]:
        """Return the people who are in the image, grouped by overlap."""
        return groups_of(*self._boxes)

    def regions(self, tallest: float, multiple: int) -> list[Region]:
        """Return one region for each group of people in the image; see `PeopleGroup.region`."""
        return [group.region(self.image_size, tallest, multiple) for group in self.groups]

    @property
    def crowds(self) -> list[PeopleGroup]:
        """Return the groups of two or more people."""
        return [group for group in self.groups if len(group.people) > 1]

    def lacking(self, points: Array, scores: Array) -> list[PeopleGroup]:
        """Return the crowds with a person who is missing among the 2D poses (N,) of an image; see `apart`."""
        if not self.crowds:
            return []
        found = {who for _, who in self._pairs(points, scores)}
        return [crowd for crowd in self.crowds if not found.issuperset(crowd.people)]

    def further(self, first: Joints, second: Joints) -> Array:
        """Return indices of those of the second 2D poses (N,) that the first lack; both are of one image.

        Two detections of one person differ a little. So a second pose counts in two cases only. Either it
        matches an expected person whom no first pose matches; each such person counts once. Or it is near no
        expected person and near no first pose.
        """
        distances = apart(*second, self.pixels, self.there)
        new = np.asarray((distances > IN_A_CROWD).all(axis=1))
        new &= (apart(*second, *first) > IN_A_CROWD).all(axis=1)
        distances[:, [who for _, who in self._pairs(*first)]] = np.inf
        new[[one for one, _ in _paired(distances)]] = True
        return np.flatnonzero(new)

    def strangers(self, points: Array, scores: Array) -> Array:
        """Return which of the 2D poses (N,) no expected person explains; see `apart`."""
        distances = apart(points, scores, self.pixels, self.there)
        return np.asarray((distances > EXPLAINED).all(axis=1))

    def _pairs(self, points: Array, scores: Array) -> list[tuple[int, int]]:
        """Return pairs of a 2D pose and the expected person that it shows, one to one."""
        return _paired(apart(points, scores, self.pixels, self.there))


def _paired(distances: Array) -> list[tuple[int, int]]:
    """Match rows and columns of distances (N, P) greedily one to one, the closest first."""
    pairs: list[tuple[int, int]] = []
    left = distances.copy()
    while left.size:
        one, other = divmod(int(left.argmin()), left.shape[1])
        if left[one, other] > IN_A_CROWD:
            break
        pairs.append((one, other))
        left[one], left[:, other] = np.inf, np.inf
    return pairs


@dataclass
class TrackedPeople:
    """People who are tracked, and the places where people appeared.

    Args:
        tracks: The newest tracks; None before the first.
        places: (J, 3) m by identity, last known position of each joint.
        doors: (3,) m each, entry places, the newest last.
        begin_ns: Timestamp of the first tracks. People present at the beginning define no entry place.
    """

    tracks: TrackSet | None = None
    places: dict[int, Array] = field(default_factory=dict)
    doors: list[Array] = field(default_factory=list)
    begin_ns: int = 0

    def take(self, tracks: TrackSet) -> None:
        """Update with the tracks of an instant."""
        if self.tracks is None:
            self.begin_ns = tracks.stamp_ns
        self.tracks = tracks
        began = tracks.stamp_ns - self.begin_ns >= BEGINNING_NS
        kept: dict[int, Array] = {}
        for k, number in enumerate(tracks.ids.tolist()):
            if number < 0:
                continue
            known = np.isfinite(tracks.states[k, :, 0])
            before = self.places.get(number)
            if before is None and known.any() and began:
                self._add_door(tracks.states[k, known, :3].mean(axis=0))
            place = np.full((len(known), 3), np.nan) if before is None else before.copy()
            place[known] = tracks.states[k, known, :3]
            kept[number] = place
        self.places = kept

    def _add_door(self, place: Array) -> None:
        others = [door for door in self.doors if np.linalg.norm(door - place) > SAME_DOOR]
        self.doors = [*others, place][-DOORS:]

    def is_door(self, camera: Camera) -> bool:
        """Return whether a camera sees an entry place."""
        return bool(self.doors) and bool(camera.sees(np.array(self.doors)).any())

    @property
    def nobody(self) -> bool:
        """Return whether there are no tracks."""
        return self.tracks is None or not len(self.tracks.ids)

    def seen_by(self, camera: Camera, stamp_ns: int) -> ExpectedPeople:
        """Return the people whom a camera should see.

        Args:
            stamp_ns: Timestamp of an image. If it is far from that of the tracks, it is on another clock or
                after a gap: no motion is predicted then.
        """
        tracks = self.tracks
        if tracks is None or not len(tracks.ids):
            return ExpectedPeople.of_nobody(camera.image_size)
        dt = 1e-9 * (stamp_ns - tracks.stamp_ns)
        dt = dt if 0.0 <= dt <= FARTHEST else 0.0
        wanted = tracks.unseen + dt <= MEMORY
        moving = (tracks.ages <= 0.0)[..., None]
        places = tracks.states[..., :3] + np.where(moving, dt * tracks.states[..., 3:], 0.0)
        for k, number in enumerate(tracks.ids.tolist()):
            last = self.places.get(number)
            if last is not None:  # joints without a state are expected at their last known position
                places[k] = np.where(np.isfinite(places[k]), places[k], last)
        places = places[wanted]
        known = np.isfinite(tracks.states[wanted, :, 0])
        spread = np.sqrt(_median(np.where(known, tracks.variances[wanted, :, 0], np.nan)))
        spread += STRAY * np.where(tracks.unseen[wanted] > 0.0, tracks.unseen[wanted] + dt, 0.0)
        pixels, there = camera.project(places)
        depth = _median(np.where(there, camera.cam_from_world.apply(places)[..., 2], np.nan))
        focal = float(camera.intrinsics.matrix[0, 0])
        return ExpectedPeople(pixels, there, spread * focal / np.maximum(depth, NEAREST), camera.image_size)


def _median(values: Array) -> Array:
    """Return the median (P,) of the finite values in each row (P, J); 0 for rows without any."""
    found = np.isfinite(values)
    ordered = np.sort(np.where(found, values, np.inf), axis=1)
    middle = np.maximum(found.sum(axis=1) - 1, 0) // 2
    medians: Array = np.where(found.any(axis=1), ordered[np.arange(len(values)), middle], 0.0)
    return medians


class RigDetector:
    """Detection on the upright images of a rig, with propagation by optical flow between looks.

    Args:
        rolls: Degrees counter-clockwise by camera, which turn its images upright.
        whole: Detects the people in the whole image.
        side: Returns the longer side of the network input for the whole image, px.
        allowance: See `DetectionScheduler`.

    Raises:
        ConfigError: if regions are configured and the network takes one input size only.
    """

    def __init__(
        self,
        config: DetectionConfig,
        network: object,
        rig: Rig,
        rolls: Mapping[str, float],
        joint_map: JointMap,
        whole: Whole,
        side: Side,
        allowance: Allowance | None = None,
    ):
        self._regions = isinstance(network, FullImageNetwork) and network.any_size
        if config.regions == "on" and not self._regions:
            raise ConfigError(
                f"detection.regions = 'on', but model {config.model} takes inputs of one size; use 'off', or "
                "a model that takes any"
            )
        self._config, self._network = config, network
        self._rig, self._rolls, self._joint_map = rig, rolls, joint_map
        self._whole, self._side = whole, side
        self._region_height = config.region_height
        self.known = TrackedPeople()
        self._learning = threading.Lock()  # images may be processed while tracks arrive
        self.lookout = DetectionScheduler(
            rig.names, config.looks_per_s, config.guided and self._regions, allowance
        )
        self.memories: dict[str, FlowReference] = {}

    def reset(self) -> None:
        """Forget all tracks, schedules and images."""
        self.known = TrackedPeople()
        self.lookout.reset()
        self.memories.clear()

    def keep(self, pace: DetectionPace) -> None:
        """Set the rate of looks and the height of people in regions from now on."""
        self.lookout.looks_per_s, self._region_height = pace

    def take(self, tracks: TrackSet) -> None:
        """Update with the tracks of an instant."""
        with self._learning:
            self.known.take(tracks)

    def find(self, item: ViewFrame) -> tuple[ImageDetections, Array | None]:
        """Return the people in an image, and the time (P,) s since the network detected each.

        The times are None if the network detected all of them in this image.
        """
        before = self.memories.get(item.camera)
        with self._learning:
            nobody = self.known.nobody
            door = self.lookout.guided and self.known.is_door(self._rig.camera(item.camera))
        now = remembered(item.image, item.stamp_ns, WIDTH if self._config.rationed else COARSE)
        if before is not None and is_cut(before, now):
            before = None
        look, scan = self.lookout.look(item.camera, item.stamp_ns, nobody, door)
        if before is None:
            look, scan = DetectionMode.WHOLE, False
        elif look is DetectionMode.CARRY and before.people is None:
            look = DetectionMode.REGIONS
        look = self.lookout.allowed(item.camera, item.stamp_ns, item.frame_number, look)
        people = carried(before, now) if look is DetectionMode.CARRY and before is not None else None
        if look is DetectionMode.CARRY and people is None and self.lookout.allowance is None:
            look = DetectionMode.REGIONS
        expected = self._expected(item) if scan or look is not DetectionMode.CARRY else None
        look_ns = item.stamp_ns
        if look is not DetectionMode.CARRY and expected is not None:
            finding = self._look(item, look, expected)
            people = finding.people
        elif people is not None and before is not None:
            finding, look_ns = ImageDetections(people, None, 0.0), before.look_ns
        else:  # people are lost until the network runs again
            finding = ImageDetections(no_people(self._joint_map.source_count), None, 0.0)
        ages = np.full(len(finding.people), 1e-9 * (item.stamp_ns - look_ns))
        if self.lookout.guided and expected is not None:
            finding = self._with_strangers(item, expected, finding, scan, new=look is not DetectionMode.CARRY)
        kept = None if people is None else finding.people
        self.memories[item.camera] = replace(now, people=kept, look_ns=look_ns)
        ages = np.pad(ages, (0, len(finding.people) - len(ages)))
        return finding, ages if ages.any() else None

    def _expected(self, item: ViewFrame) -> ExpectedPeople:
        """Return the people whom the camera should see."""
        if not self.lookout.guided:
            return ExpectedPeople.of_nobody(item.image_size)
        camera, degrees = self._rig.camera(item.camera), self._rolls.get(item.camera)
        with self._learning:
            expected = self.known.seen_by(camera, item.stamp_ns)
        return expected if degrees is None else expected.turned(turn_by(degrees, camera.image_size))

    def _look(self, item: ViewFrame, look: DetectionMode, expected: ExpectedPeople) -> ImageDetections:
        """Detect people in the regions, or in the whole image if that costs less; look closer at crowds."""
        if look is DetectionMode.WHOLE or not self.lookout.guided or self.known.nobody:
            finding = self._whole(item)
            further = self._closer(item, expected, expected.crowds, finding.people)
            return replace(finding, people=concatenate([finding.people, further], further.scores.shape[1]))
        assert isinstance(self._network, FullImageNetwork)
        regions = expected.regions(float(self._region_height), self._network.multiple)
        if not regions:
            return ImageDetections(no_people(len(self._network.card.joints)), None, 0.0)
        rows, columns = self._network.size_of(self._side(item), item.image)
        if sum(region.cost for region in regions) >= rows * columns:
            return self._whole(item)
        return self._network.find_in(item.image, regions, lambda seen: self._missing(item, expected, seen))

    def _missing(self, item: ViewFrame, expected: ExpectedPeople, people: DetectedPeople) -> DetectedPeople:
        """Return those people of crowds whom `people` lacks, from a closer look if one is due."""
        crowds, known = expected.lacking(*self._joints(people)), self.lookout.cameras[item.camera]
        if not crowds or not known.closer():
            return people.select(np.zeros(0, int))
        others = self._closer(item, expected, crowds, people)
        known.looked_closer(len(others) > 0)
        return others

    def _closer(
        self, item: ViewFrame, expected: ExpectedPeople, crowds: list[PeopleGroup], people: DetectedPeople
    ) -> DetectedPeople:
        """Return the people that a closer look at these crowds finds in addition to `people`."""
        joint_count, parts = people.scores.shape[1], []
        for crowd in crowds:
            assert isinstance(self._network, FullImageNetwork)
            tallest = CLOSER * self._region_height
            region = crowd.region(item.image_size, tallest, self._network.multiple, ENLARGED)
            found = self._network.people_in(item.image, region)
            parts.append(found.select(expected.further(self._joints(people), self._joints(found))))
            people = concatenate([people, parts[-1]], joint_count)
        return concatenate(parts, joint_count)

    def _joints(self, people: DetectedPeople) -> tuple[Array, Array]:
        """Return points (P, J, 2) and scores (P, J) of people in the joints of the skeleton."""
        scores = np.where(people.scores >= self._config.joint_threshold, people.scores, 0.0)
        return self._joint_map.apply(people.points, scores)

    def _with_strangers(
        self, item: ViewFrame, expected: ExpectedPeople, finding: ImageDetections, scan: bool, new: bool
    ) -> ImageDetections:
        """Add the unexplained people of a scan to the finding, and raise an alarm for all unexplained people.

        Args:
            scan: Whether to scan the image for new people.
            new: Whether the network detected the people of the finding in this image.
        """
        people = finding.people
        strange = self._strangers(people, expected) if new else np.zeros(len(people), bool)
        if scan:
            found = self._scan(item, expected.heights)
            found = found.select(np.flatnonzero(self._strangers(found, expected)))
            people = concatenate([people, _others(found, people)], people.scores.shape[1])
            strange = np.pad(strange, (0, len(people) - len(strange)), constant_values=True)
        if strange.any():
            boxes = boxes_of_points(people.points[strange], people.scores[strange] > 0.0)
            self.lookout.raise_alarm(item.camera, boxes, item.stamp_ns)
        return replace(finding, people=people)

    def _strangers(self, people: DetectedPeople, expected: ExpectedPeople) -> Array:
        """Return which 2D poses (P,) have a high score and are explained by no track."""
        if not len(people):
            return np.zeros(0, bool)
        points, scores = self._joints(people)
        sure = (people.person_scores >= SURE_STRANGER) & (scores > 0.0).any(axis=1)
        strange: Array = sure & expected.strangers(points, scores)
        return strange

    def _scan(self, item: ViewFrame, heights: Array) -> DetectedPeople:
        """Detect people in a small version of the whole image, scaled for people of these heights (P,) px."""
        assert isinstance(self._network, FullImageNetwork)
        side, image_side = self._side(item), max(item.image_size)
        wanted = UNKNOWN_SCAN * side
        if len(heights):
            wanted = image_side * SCAN_HEIGHT / float(np.median(heights))
        multiple = self._network.multiple
        small = multiple * round(min(max(wanted, LEAST_SCAN), side) / multiple)
        return self._network.find(item.image, small, maps=False).people


def _others(found: DetectedPeople, people: DetectedPeople) -> DetectedPeople:
    """Return the people found whose box centres lie in no box of `people`."""
    if not len(found) or not len(people):
        return found
    seen = people.scores > 0.0
    people = people.select(np.flatnonzero(seen.any(axis=1)))
    around = boxes_of_points(people.points, people.scores > 0.0)
    own = boxes_of_points(found.points, found.scores > 0.0)
    middles = 0.5 * (own[:, :2] + own[:, 2:])
    inside = (middles[:, None] >= around[None, :, :2]) & (middles[:, None] <= around[None, :, 2:])
    return found.select(np.flatnonzero(~inside.all(axis=2).any(axis=1)))
