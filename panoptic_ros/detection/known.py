"""Whom tracking follows, and where a camera should see them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from panoptic_ros.detection.preprocess import Turn
from panoptic_ros.detection.regions import Group, Region, groups_of, person_boxes
from panoptic_ros.detection.resemblance import apart
from panoptic_ros.domain import Camera, TrackSet

Array = np.ndarray
Joints = tuple[Array, Array]  # of N 2D people: points (N, J, 2) px, scores (N, J), 0 = missing
MEMORY = 2.0  # s, how long people who are not seen are looked for
FARTHEST = 0.5  # s, over which motion is predicted
STRAY = 0.7  # m/s, at which those who are not seen may have gone anywhere
NEAREST = 0.1  # m, depth before a camera
DOORS = 8  # places where people appeared that are remembered
SAME_DOOR = 1.0  # m
BEGINNING_NS = 1_000_000_000
EXPLAINED = 0.2  # of a person's height: the median distance of one person's joints, seen and predicted
IN_A_CROWD = 0.1  # the same where people stand so close that one would explain another


@dataclass(frozen=True, eq=False)
class Expected:
    """Where a camera should see P people.

    Args:
        pixels: (P, J, 2). there: (P, J) which of them are known and before the camera.
        doubts: (P,) px, standard deviation.
    """

    pixels: Array
    there: Array
    doubts: Array
    image_size: tuple[int, int]

    @classmethod
    def of_nobody(cls, image_size: tuple[int, int]) -> Expected:
        """Nobody is expected."""
        return cls(np.zeros((0, 1, 2)), np.zeros((0, 1), bool), np.zeros(0), image_size)

    def turned(self, turn: Turn) -> Expected:
        """Move the people to the upright image."""
        return replace(self, pixels=turn.pixels(self.pixels), image_size=turn.size)

    @cached_property
    def _boxes(self) -> tuple[Array, Array, Array]:
        return person_boxes(self.pixels, self.there, self.doubts, self.image_size)

    @property
    def heights(self) -> Array:
        """Of those (N,) px who are in the image."""
        return self._boxes[1]

    @cached_property
    def groups(self) -> list[Group]:
        """Those who are in the image, by who overlaps whom."""
        return groups_of(*self._boxes)

    def regions(self, tallest: float, multiple: int) -> list[Region]:
        """Where to look for those who are in the image; see `Group.region`."""
        return [group.region(self.image_size, tallest, multiple) for group in self.groups]

    @property
    def crowds(self) -> list[Group]:
        """Groups of several."""
        return [group for group in self.groups if len(group.people) > 1]

    def lacking(self, points: Array, scores: Array) -> list[Group]:
        """Crowds of which somebody is not among the 2D people (N,) of an image; see `apart`."""
        if not self.crowds:
            return []
        found = {who for _, who in self._pairs(points, scores)}
        return [crowd for crowd in self.crowds if not found.issuperset(crowd.people)]

    def further(self, first: Joints, second: Joints) -> Array:
        """Which of the second 2D people (N,) the first lack, all being of the same image.

        People who are found twice differ a little. So of the second those count who show somebody who is
        expected and not among the first, each once; and those who are near nobody.
        """
        distances = apart(*second, self.pixels, self.there)
        new = np.asarray((distances > IN_A_CROWD).all(axis=1))
        new &= (apart(*second, *first) > IN_A_CROWD).all(axis=1)
        distances[:, [who for _, who in self._pairs(*first)]] = np.inf
        new[[one for one, _ in _paired(distances)]] = True
        return np.flatnonzero(new)

    def strangers(self, points: Array, scores: Array) -> Array:
        """Which of the 2D people (N,) nobody explains who is expected; see `apart`."""
        distances = apart(points, scores, self.pixels, self.there)
        return np.asarray((distances > EXPLAINED).all(axis=1))

    def _pairs(self, points: Array, scores: Array) -> list[tuple[int, int]]:
        """2D people and those who are expected, whom they show; each once."""
        return _paired(apart(points, scores, self.pixels, self.there))


def _paired(distances: Array) -> list[tuple[int, int]]:
    """Rows and columns of distances (N, P) that belong together, each once, the closest first."""
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
class KnownPeople:
    """Everybody who is followed, and the places where people appeared.

    Args:
        tracks: the newest; None: none have come.
        places: (J, 3) m, where each identity was seen last. doors: (3,) m, the newest last.
        begin_ns: stamp of the first tracks; who is there at the beginning came through no door.
    """

    tracks: TrackSet | None = None
    places: dict[int, Array] = field(default_factory=dict)
    doors: list[Array] = field(default_factory=list)
    begin_ns: int = 0

    def take(self, tracks: TrackSet) -> None:
        """What tracking says of an instant."""
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
        """Whether a camera sees a place where people appeared."""
        return bool(self.doors) and bool(camera.sees(np.array(self.doors)).any())

    @property
    def nobody(self) -> bool:
        """Whether nobody is followed."""
        return self.tracks is None or not len(self.tracks.ids)

    def seen_by(self, camera: Camera, stamp_ns: int) -> Expected:
        """Whom a camera should see.

        Args:
            stamp_ns: of an image. One that is far from that of the tracks is on another clock, or after a
                gap: nobody is moved then.
        """
        tracks = self.tracks
        if tracks is None or not len(tracks.ids):
            return Expected.of_nobody(camera.image_size)
        dt = 1e-9 * (stamp_ns - tracks.stamp_ns)
        dt = dt if 0.0 <= dt <= FARTHEST else 0.0
        wanted = tracks.unseen + dt <= MEMORY
        moving = (tracks.ages <= 0.0)[..., None]
        places = tracks.states[..., :3] + np.where(moving, dt * tracks.states[..., 3:], 0.0)
        for k, number in enumerate(tracks.ids.tolist()):
            last = self.places.get(number)
            if last is not None:  # joints that are forgotten are looked for where they were
                places[k] = np.where(np.isfinite(places[k]), places[k], last)
        places = places[wanted]
        known = np.isfinite(tracks.states[wanted, :, 0])
        spread = np.sqrt(_median(np.where(known, tracks.variances[wanted, :, 0], np.nan)))
        spread += STRAY * np.where(tracks.unseen[wanted] > 0.0, tracks.unseen[wanted] + dt, 0.0)
        pixels, there = camera.project(places)
        depth = _median(np.where(there, camera.cam_from_world.apply(places)[..., 2], np.nan))
        focal = float(camera.intrinsics.matrix[0, 0])
        return Expected(pixels, there, spread * focal / np.maximum(depth, NEAREST), camera.image_size)


def _median(values: Array) -> Array:
    """Median (P,) of what is not NaN in each row (P, J); 0 where all is."""
    found = np.isfinite(values)
    ordered = np.sort(np.where(found, values, np.inf), axis=1)
    middle = np.maximum(found.sum(axis=1) - 1, 0) // 2
    medians: Array = np.where(found.any(axis=1), ordered[np.arange(len(values)), middle], 0.0)
    return medians
