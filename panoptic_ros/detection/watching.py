"""What is done with each image where not all of every image is looked at: looks, regions, scans, carrying."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from panoptic_ros.detection.allowance import Allowance
from panoptic_ros.detection.budget import Pace
from panoptic_ros.detection.config import DetectionConfig
from panoptic_ros.detection.flow import COARSE, WIDTH, Memory, carried, is_cut, remembered
from panoptic_ros.detection.full_image import Finding, FullImageNetwork
from panoptic_ros.detection.known import Expected, KnownPeople
from panoptic_ros.detection.looking import Look, Lookout
from panoptic_ros.detection.people import People, boxes_of_points, concatenate, no_people
from panoptic_ros.detection.preprocess import turn_by
from panoptic_ros.detection.regions import Group
from panoptic_ros.domain import JointMap, Rig, TrackSet, ViewFrame
from panoptic_ros.errors import ConfigError

Array = np.ndarray
SURE_STRANGER = 0.25  # score from which somebody whom nobody explains raises an alarm
SCAN_HEIGHT = 90.0  # net px of a person of middling height in a small whole image
LEAST_SCAN = 128  # net px of its longer side
CLOSER = 1.36  # times as tall as in regions are people in a closer look at a crowd
ENLARGED = 2.0  # scale to which its image is enlarged, at most
UNKNOWN_SCAN = 0.45  # of the side that suits the camera, where nobody tells how tall people are

Whole = Callable[[ViewFrame], Finding]  # finds the people in all of an image
Side = Callable[[ViewFrame], int]  # longer side of the network's input that suits a camera


class Watch:
    """Where and when to look in the upright images of a rig; between looks people are carried.

    Args:
        rolls: degrees counter-clockwise, by which images of cameras are turned to be upright.
        whole: looks at all of an image. side: net px, of that. allowance: see `Lookout`.

    Raises:
        ConfigError: if regions are asked for that the network cannot take.
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
        self.known = KnownPeople()
        self._learning = threading.Lock()  # images may be looked at while tracks come
        self.lookout = Lookout(rig.names, config.looks_per_s, config.guided and self._regions, allowance)
        self.memories: dict[str, Memory] = {}

    def reset(self) -> None:
        """Forget everything."""
        self.known = KnownPeople()
        self.lookout.reset()
        self.memories.clear()

    def keep(self, pace: Pace) -> None:
        """Look so often and so finely from now on."""
        self.lookout.looks_per_s, self._region_height = pace

    def take(self, tracks: TrackSet) -> None:
        """What tracking says of an instant."""
        with self._learning:
            self.known.take(tracks)

    def find(self, item: ViewFrame) -> tuple[Finding, Array | None]:
        """The people in an image, and for how long each was carried (P,) s; None: all are seen there."""
        before = self.memories.get(item.camera)
        with self._learning:
            nobody = self.known.nobody
            door = self.lookout.guided and self.known.is_door(self._rig.camera(item.camera))
        now = remembered(item.image, item.stamp_ns, WIDTH if self._config.rationed else COARSE)
        if before is not None and is_cut(before, now):
            before = None
        look, scan = self.lookout.look(item.camera, item.stamp_ns, nobody, door)
        if before is None:
            look, scan = Look.WHOLE, False
        elif look is Look.CARRY and before.people is None:
            look = Look.REGIONS
        look = self.lookout.allowed(item.camera, item.stamp_ns, item.frame_number, look)
        people = carried(before, now) if look is Look.CARRY and before is not None else None
        if look is Look.CARRY and people is None and self.lookout.allowance is None:
            look = Look.REGIONS
        expected = self._expected(item) if scan or look is not Look.CARRY else None
        look_ns = item.stamp_ns
        if look is not Look.CARRY and expected is not None:
            finding = self._look(item, look, expected)
            people = finding.people
        elif people is not None and before is not None:
            finding, look_ns = Finding(people, None, 0.0), before.look_ns
        else:  # lost, until it is looked at
            finding = Finding(no_people(self._joint_map.source_count), None, 0.0)
        ages = np.full(len(finding.people), 1e-9 * (item.stamp_ns - look_ns))
        if self.lookout.guided and expected is not None:
            finding = self._with_strangers(item, expected, finding, scan, new=look is not Look.CARRY)
        kept = None if people is None else finding.people
        self.memories[item.camera] = replace(now, people=kept, look_ns=look_ns)
        ages = np.pad(ages, (0, len(finding.people) - len(ages)))
        return finding, ages if ages.any() else None

    def _expected(self, item: ViewFrame) -> Expected:
        """Whom the camera should see."""
        if not self.lookout.guided:
            return Expected.of_nobody(item.image_size)
        camera, degrees = self._rig.camera(item.camera), self._rolls.get(item.camera)
        with self._learning:
            expected = self.known.seen_by(camera, item.stamp_ns)
        return expected if degrees is None else expected.turned(turn_by(degrees, camera.image_size))

    def _look(self, item: ViewFrame, look: Look, expected: Expected) -> Finding:
        """At regions if they cost less than all of the image; at crowds more closely where they need it."""
        if look is Look.WHOLE or not self.lookout.guided or self.known.nobody:
            finding = self._whole(item)
            further = self._closer(item, expected, expected.crowds, finding.people)
            return replace(finding, people=concatenate([finding.people, further], further.scores.shape[1]))
        assert isinstance(self._network, FullImageNetwork)
        regions = expected.regions(float(self._region_height), self._network.multiple)
        if not regions:
            return Finding(no_people(len(self._network.card.joints)), None, 0.0)
        rows, columns = self._network.size_of(self._side(item), item.image)
        if sum(region.cost for region in regions) >= rows * columns:
            return self._whole(item)
        return self._network.find_in(item.image, regions, lambda seen: self._missing(item, expected, seen))

    def _missing(self, item: ViewFrame, expected: Expected, people: People) -> People:
        """Who of a crowd is not among the people that were found, if a closer look may show him."""
        crowds, known = expected.lacking(*self._joints(people)), self.lookout.cameras[item.camera]
        if not crowds or not known.closer():
            return people.select(np.zeros(0, int))
        others = self._closer(item, expected, crowds, people)
        known.looked_closer(len(others) > 0)
        return others

    def _closer(self, item: ViewFrame, expected: Expected, crowds: list[Group], people: People) -> People:
        """Whom a closer look at these crowds shows besides the people that were found."""
        joint_count, parts = people.scores.shape[1], []
        for crowd in crowds:
            assert isinstance(self._network, FullImageNetwork)
            tallest = CLOSER * self._region_height
            region = crowd.region(item.image_size, tallest, self._network.multiple, ENLARGED)
            found = self._network.people_in(item.image, region)
            parts.append(found.select(expected.further(self._joints(people), self._joints(found))))
            people = concatenate([people, parts[-1]], joint_count)
        return concatenate(parts, joint_count)

    def _joints(self, people: People) -> tuple[Array, Array]:
        """Points (P, J, 2) and scores (P, J) of people in the joints of the skeleton."""
        scores = np.where(people.scores >= self._config.joint_threshold, people.scores, 0.0)
        return self._joint_map.apply(people.points, scores)

    def _with_strangers(
        self, item: ViewFrame, expected: Expected, finding: Finding, scan: bool, new: bool
    ) -> Finding:
        """The finding with people in a small whole image whom nobody explains; they raise an alarm.

        Args:
            new: whether the people of the finding were looked at now.
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

    def _strangers(self, people: People, expected: Expected) -> Array:
        """Which 2D people (P,) are surely there and nobody who is known."""
        if not len(people):
            return np.zeros(0, bool)
        points, scores = self._joints(people)
        sure = (people.person_scores >= SURE_STRANGER) & (scores > 0.0).any(axis=1)
        strange: Array = sure & expected.strangers(points, scores)
        return strange

    def _scan(self, item: ViewFrame, heights: Array) -> People:
        """The people in all of an image, at a scale that is small for people of these heights (P,) px."""
        assert isinstance(self._network, FullImageNetwork)
        side, image_side = self._side(item), max(item.image_size)
        wanted = UNKNOWN_SCAN * side
        if len(heights):
            wanted = image_side * SCAN_HEIGHT / float(np.median(heights))
        multiple = self._network.multiple
        small = multiple * round(min(max(wanted, LEAST_SCAN), side) / multiple)
        return self._network.find(item.image, small, maps=False).people


def _others(found: People, people: People) -> People:
    """Those found whose boxes do not lie on one of the people."""
    if not len(found) or not len(people):
        return found
    seen = people.scores > 0.0
    people = people.select(np.flatnonzero(seen.any(axis=1)))
    around = boxes_of_points(people.points, people.scores > 0.0)
    own = boxes_of_points(found.points, found.scores > 0.0)
    middles = 0.5 * (own[:, :2] + own[:, 2:])
    inside = (middles[:, None] >= around[None, :, :2]) & (middles[:, None] <= around[None, :, 2:])
    return found.select(np.flatnonzero(~inside.all(axis=2).any(axis=1)))
