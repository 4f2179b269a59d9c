"""Check that the views of a rig agree, and name the usual mistake in plain words if they do not.

Input: a rig and the 2D poses of some instants. Output: a `RigReport`. The rays of the same person in two
views must meet (`rig_agreement`). Where they do not, each usual mistake is undone on trial (`rig_mistakes`)
and reported if the rays then meet. Where they do, the size of the people determines the unit of length, and
their posture the up direction. The check needs no solver.

The residuals of a person's joints scatter about a smooth function by the detector noise. Rays that miss by
several times that noise do not agree, so the tolerances scale with the noise in the data.

Limits: a rig with smaller errors passes (see the residuals of the report). A rig also passes if it agrees
with itself for another reason, e.g. with all cameras shifted by one place in a symmetric ring.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import Camera, DetectionSet, Rig, SkeletonModel
from panoptic_ros.evaluation.rig_agreement import BEHIND, MatchedPairs, RayCache, camera_pairs, meet
from panoptic_ros.evaluation.rig_mistakes import (
    Instants,
    RigMistake,
    scaled_intrinsics,
    suspects,
)
from panoptic_ros.evaluation.rig_plausibility import (
    check_scale,
    implausible_cameras,
    sizes_that_differ,
)
from panoptic_ros.evaluation.rig_up import check_up, directions_of_people
from panoptic_ros.stage import Notice

MOST_INSTANTS = 12
LEAST_PEOPLE = 3  # smallest number of matched people for a camera pair to count
DROP = 0.4  # largest share of the residual that may remain when a mistake is undone
MOST_MISTAKES = 4
WORST = 300.0  # px, upper limit of residuals; larger ones are clipped
NOISES = 3.0  # largest residual of views that agree, in standard deviations of the noise
SUSPICION = 0.55  # share of the tolerance; a larger residual is suspicious
# smallest number of groups taken as rooms; of two groups that disagree, one is probably wrong
LEAST_ROOMS = 3
SURE = 0.8  # share of the noise; smaller residuals prove agreement, while noise alone gives 0.5
# a later suspect must reduce the residual below this share of the best, so that the first of equals wins
BETTER = 0.99


@dataclass(frozen=True)
class CameraFit:
    """Agreement of a camera with the others.

    Args:
        residual_px: Median residual over the other cameras, px; NaN without matched people.
        people: Number of matched people.
        noise_px: Scatter of the residuals of one person's joints, px; NaN if too few joints are visible.
    """

    camera: str
    residual_px: float
    people: int
    noise_px: float = float("nan")


@dataclass(frozen=True)
class RigReport:
    """Result of a rig check. Without warnings, the views agree or there is too little data."""

    notices: tuple[Notice, ...]
    cameras: tuple[CameraFit, ...]

    @property
    def warnings(self) -> tuple[Notice, ...]:
        """Return the notices that are more severe than information."""
        return tuple(notice for notice in self.notices if notice.severity != "info")


def tolerance_px(camera: Camera, noise_px: float = np.inf) -> float:
    """Return the largest residual (px) of a camera that agrees.

    It allows for detector noise and a slight misfit.

    Args:
        noise_px: Standard deviation of the residuals in the data.
    """
    longest = max(camera.image_size)
    return min(10.0 + 0.008 * longest, max(2.0 + 0.002 * longest, NOISES * noise_px))


def suspicion_px(camera: Camera, noise_px: float = np.inf) -> float:
    """Return the residual (px) above which mistakes are searched.

    Reporting a mistake also requires a clear drop of the residual.
    """
    return SUSPICION * tolerance_px(camera, noise_px)


def check_rig(rig: Rig, sets: Sequence[DetectionSet], skeleton: SkeletonModel) -> RigReport:
    """Check a rig against the 2D poses of some instants (the first seconds of a capture).

    Without people, only the numbers of the rig are checked.
    """
    notices = list(implausible_cameras(rig))
    every: Instants = [{view.camera: view for view in s.views if view.camera in rig.names} for s in sets]
    told = [own for own in every if sum(len(view.scores) > 0 for view in own.values()) > 1]
    instants = told[:: max(1, -(-len(told) // MOST_INSTANTS))] or every[:MOST_INSTANTS]
    trial = _RigTrial.of(_fitted(rig, instants), instants)
    for _ in range(MOST_MISTAKES):
        bad = trial.suspicious()
        found = _explanation(trial, bad, skeleton) if bad else None
        if found is None:
            break
        notice, trial = found[0], found[1].measured()
        notices = [note for note in notices if not _is_told_by(note, notice)] + [notice]
    notices += sizes_that_differ(rig, trial.instants)
    notices += [_disagreement(trial, name) for name in trial.blamed()]
    if trial.said() < LEAST_PEOPLE:
        notices.append(Notice("rig.few_people", "info", _FEW if sets else _NONE, {"people": trial.said()}))
        notices += check_up(rig, np.zeros((0, 3)))
    elif not trial.blamed():
        people = np.concatenate([met.points for met in trial.met.values() if trial.speaks(met)])
        at_once = int(np.median([len(view.scores) for own in trial.instants for view in own.values()]))
        notices += check_scale(people, skeleton, at_once)
        notices += check_up(rig, directions_of_people(people, skeleton))
    fits = [CameraFit(n, trial.residual(n), trial.people(n), trial.noise.get(n, np.nan)) for n in rig.names]
    return RigReport(tuple(notices), tuple(fits))


def _is_told_by(note: Notice, other: Notice) -> bool:
    """Return whether a notice based on the numbers of the rig is repeated by `other`, based on people.

    That is so if both have the same code, and `other` names all cameras of the notice.
    """
    cameras = set(note.values.get("cameras", ()))
    return note.code == other.code and bool(cameras) and cameras <= set(other.values["cameras"])


_FEW = "too few people are seen by two cameras at once to decide whether the views agree"
_NONE = "without 2D people only the numbers of the rig were checked, not whether the views agree"


def _fitted(rig: Rig, instants: Instants) -> Rig:
    """Return the rig with its intrinsics scaled to the actual image size, where only the scale differs."""
    cameras = []
    for camera in rig.cameras:
        sizes = [instant[camera.name].image_size for instant in instants if camera.name in instant]
        if sizes and sizes[0] != camera.image_size:
            wide, high = sizes[0][0] / camera.image_size[0], sizes[0][1] / camera.image_size[1]
            if abs(wide / high - 1.0) < 0.02:
                camera = replace(
                    camera, image_size=sizes[0], intrinsics=scaled_intrinsics(camera.intrinsics, wide)
                )
        cameras.append(camera)
    return Rig(tuple(cameras), rig.frame_id)


@dataclass(frozen=True)
class _RigTrial:
    """Rig on trial: its views, and the agreement of each camera pair.

    Args:
        noise: Noise by camera, px; cameras without enough people are absent.
    """

    rig: Rig
    instants: Instants
    met: dict[tuple[int, int], MatchedPairs]
    cache: RayCache
    noise: Mapping[str, float]

    @classmethod
    def of(cls, rig: Rig, instants: Instants) -> _RigTrial:
        cache = RayCache()
        met = {pair: _meet(rig, instants, pair, cache) for pair in camera_pairs(rig)}
        return cls(rig, instants, met, cache, _noise_of(rig, met))

    def changed(self, suspect: RigMistake) -> _RigTrial:
        """Return the trial with a mistake undone; only the pairs of its cameras are recomputed."""
        rig, instants = suspect.undo(self.rig, self.instants)
        touched = {self.rig.index(name) for name in suspect.cameras}
        met = {
            pair: _meet(rig, instants, pair, self.cache) if touched & set(pair) else old
            for pair, old in self.met.items()
        }
        return _RigTrial(rig, instants, met, self.cache, self.noise)

    def measured(self) -> _RigTrial:
        """Return the trial with the noise estimated from its own residuals."""
        return replace(self, noise=_noise_of(self.rig, self.met))

    def tolerance(self, name: str) -> float:
        return tolerance_px(self.rig.camera(name), self.noise.get(name, np.inf))

    def suspicion(self, name: str) -> float:
        return suspicion_px(self.rig.camera(name), self.noise.get(name, np.inf))

    def speaks(self, met: MatchedPairs) -> bool:
        return len(met.pixels) >= LEAST_PEOPLE

    def said(self) -> int:
        return sum(len(met.pixels) for met in self.met.values() if self.speaks(met))

    def people(self, name: str) -> int:
        at = self.rig.index(name)
        return sum(len(met.pixels) for pair, met in self.met.items() if at in pair)

    def residuals(
        self, name: str, in_metres: bool = False, others: Collection[str] | None = None
    ) -> list[float]:
        """Return the sorted residuals of a camera with each other camera, in px or in the unit of the rig.

        Args:
            others: Cameras to compare with. Default: all.
        """
        at = self.rig.index(name)
        partners = {self.rig.index(other) for other in (self.rig.names if others is None else others)} - {at}
        return sorted(
            met.typical[in_metres]
            for pair, met in self.met.items()
            if at in pair and partners & set(pair) and self.speaks(met)
        )

    def residual(self, name: str) -> float:
        """Return the lower median over the other cameras, so that one bad neighbour of two has no effect."""
        values = self.residuals(name)
        return values[(len(values) - 1) // 2] if values else float("nan")

    def suspicious(self) -> tuple[str, ...]:
        """Return the cameras that disagree with most others.

        They can include correct cameras, if wrong ones make them look bad.
        """
        names = self.doubtful()
        return tuple(name for name in names if _upper(self.residuals(name)) > self.suspicion(name))

    def doubtful(self) -> list[str]:
        """Return the cameras that may be wrong.

        The cameras may be in several rooms and see different people. This is assumed if most pairs disagree,
        but most cameras form at least three groups that agree within the noise. Cameras in such a group are
        then taken as correct.
        """
        group = {name: name for name in self.rig.names}  # group of each camera, named by its first camera
        apart = spoken = 0
        for pair, met in self.met.items():
            if self.speaks(met):
                names = [self.rig.names[index] for index in pair]
                spoken += 1
                apart += met.typical[0] > max(map(self.tolerance, names))
                if met.typical[0] < SURE * min(self.noise.get(name, 0.0) for name in names):
                    one, other = (group[name] for name in names)
                    group = {name: one if own == other else own for name, own in group.items()}
        sizes = Counter(group.values())
        alone = [name for name, own in group.items() if sizes[own] == 1]
        several = sum(size > 1 for size in sizes.values()) >= LEAST_ROOMS
        in_rooms = several and 2 * apart > spoken and 2 * len(alone) < len(self.rig)
        return alone if in_rooms else list(self.rig.names)

    def blamed(self) -> list[str]:
        """Return the cameras that still disagree with the others after the worse ones are left out."""
        left = self.doubtful()
        blamed: list[str] = []
        while True:
            values = {name: self.residuals(name, others=left) for name in left}
            bad = [n for n in left if _upper(values[n]) > self.tolerance(n)]
            if not bad:
                return blamed
            worst = max(bad, key=lambda name: float(np.mean(np.minimum(values[name], WORST))))
            blamed.append(worst)
            left.remove(worst)
            if len(left) < 2:
                return blamed + left  # if two cameras disagree, either may be wrong

    def total(self) -> float:
        values = [met.typical[0] for met in self.met.values() if self.speaks(met)]
        return float(np.mean(np.minimum(values, WORST))) if values else float("inf")

    def agrees(self, names: Sequence[str]) -> bool:
        """Return whether most pairs of each of these cameras agree; with two pairs, both must agree."""
        for name in names:
            values = self.residuals(name)
            if not values or _upper(values) > self.suspicion(name):
                return False
        return True


def _upper(values: Sequence[float]) -> float:
    """Return the upper median: at least half of the values do not exceed it; 0 without values."""
    return values[len(values) // 2] if values else 0.0


def _noise_of(rig: Rig, met: Mapping[tuple[int, int], MatchedPairs]) -> dict[str, float]:
    """Return the noise (px) by camera, the minimum over its pairs.

    A wrong pose of the other camera adds to the noise of a pair.
    """
    rows: dict[str, list[float]] = {}
    for pair, own in met.items():
        noise = own.noise()
        noise = noise[np.isfinite(noise)]
        for index in pair if len(noise) >= LEAST_PEOPLE else ():
            rows.setdefault(rig.names[index], []).append(float(np.median(noise)))
    return {name: min(row) for name, row in rows.items()}


def _meet(rig: Rig, instants: Instants, pair: tuple[int, int], cache: RayCache) -> MatchedPairs:
    a, b = (rig.cameras[i] for i in pair)
    views = [(i[a.name], i[b.name]) for i in instants if a.name in i and b.name in i]
    return meet(a, b, views, cache)


def _explanation(
    trial: _RigTrial, bad: tuple[str, ...], skeleton: SkeletonModel
) -> tuple[Notice, _RigTrial] | None:
    """Return a notice about the mistake that explains most, and the trial without it."""
    best: tuple[float, RigMistake, _RigTrial] | None = None
    for stage in suspects(trial.rig, bad, skeleton.mirror):
        for suspect in stage:
            other = trial.changed(suspect)
            if _helps(trial, other, suspect) and (best is None or other.total() < BETTER * best[0]):
                best = other.total(), suspect, other
        if best is not None and not best[2].suspicious():
            break
    if best is None:
        return None
    _, suspect, other = best
    given, undone = (_middle(t, suspect.cameras, True) for t in (trial, other))
    text = (
        f"{suspect.text}: the rays of people miss each other by {_length(given)} as given "
        f"and by {_length(undone)} without this mistake"
    )
    return Notice(suspect.code, "warning", text, {"cameras": list(suspect.cameras)}), other


def _helps(trial: _RigTrial, other: _RigTrial, suspect: RigMistake) -> bool:
    """Return whether the rays of the suspect's cameras meet far better without the mistake."""
    before, after = (_middle(t, suspect.cameras) for t in (trial, other))
    enough = other.said() >= 0.5 * trial.said()
    return enough and after < DROP * before and other.agrees(suspect.cameras)


def _middle(trial: _RigTrial, names: Sequence[str], in_metres: bool = False) -> float:
    values = [value for name in names for value in trial.residuals(name, in_metres)]
    return float(np.median(values)) if values else BEHIND


def _length(metres: float) -> str:
    return f"{metres:.3g} m" if metres >= 0.995 else f"{100 * metres:.2g} cm"


def _disagreement(trial: _RigTrial, name: str) -> Notice:
    residual, noise = _upper(trial.residuals(name)), trial.noise.get(name, np.nan)
    apart = f"by {residual:.0f} px" if residual < BEHIND / 2 else "altogether"
    if noise < residual < BEHIND / 2:
        apart += f", where the noise of 2D people explains {noise:.1f} px"
    text = (
        f"camera {name} does not agree with the others: the rays of people miss each other {apart}; "
        "calibrate it again, or check that its images are of the same instants"
    )
    return Notice("rig.disagrees", "warning", text, {"cameras": [name], "residual_px": residual})
