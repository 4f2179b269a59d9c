"""Do the views of a rig agree? Says in plain words what is wrong, if it is one of the usual mistakes.

In: a rig and the 2D people of some instants. Out: a `RigReport`. The rays of the same person in two
views must meet (`rig_agreement`). Where they do not, each usual mistake is undone on trial
(`rig_mistakes`) and named if the rays meet then. Where they do, the size of the people tells the
unit of length, and their posture which way is up. All of it works before any solver.

Limits: a rig that is wrong by a few pixels passes (see the residuals of the report); so does one that
agrees with itself for another reason, e.g. cameras moved one place on in a symmetric ring.
"""
from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from panoptic_ros.domain import Camera, DetectionSet, Rig, SkeletonModel
from panoptic_ros.evaluation.rig_agreement import BEHIND, Met, RayCache, camera_pairs, meet
from panoptic_ros.evaluation.rig_mistakes import (
    Instants,
    Suspect,
    joints_above_and_below,
    scaled_intrinsics,
    suspects,
)
from panoptic_ros.evaluation.rig_plausibility import (
    check_scale,
    check_up,
    implausible_cameras,
    sizes_that_differ,
)
from panoptic_ros.stage import Notice

MOST_INSTANTS = 12
SHARE = 0.4  # of the matched people that must meet: others may be ghosts or seen once only
LEAST_PEOPLE = 3  # matched, for a pair to say anything
DROP = 0.4  # of the residual that may be left when a mistake is undone
MOST_MISTAKES = 4
WORST = 300.0  # px, all larger residuals count the same


@dataclass(frozen=True)
class CameraFit:
    """How well a camera agrees with the others: median over them, px; NaN if nobody was matched."""

    camera: str
    residual_px: float
    people: int


@dataclass(frozen=True)
class RigReport:
    """What was found; no warnings = the views agree, or there is nothing to tell from."""

    notices: tuple[Notice, ...]
    cameras: tuple[CameraFit, ...]

    @property
    def warnings(self) -> tuple[Notice, ...]:
        """The notices that are more than information."""
        return tuple(notice for notice in self.notices if notice.severity != "info")


def tolerance_px(camera: Camera) -> float:
    """Residual up to which a camera counts as agreeing: noise of detectors and a slight misfit."""
    return 10.0 + 0.008 * max(camera.image_size)


def suspicion_px(camera: Camera) -> float:
    """Residual from which on mistakes are looked for; naming one needs a clear drop besides."""
    return 6.0 + 0.004 * max(camera.image_size)


def check_rig(rig: Rig, sets: Sequence[DetectionSet], skeleton: SkeletonModel) -> RigReport:
    """Check a rig against the 2D people of some instants (the first seconds of a capture).

    Without people only the numbers of the rig are looked at.
    """
    notices = list(implausible_cameras(rig))
    instants: Instants = [{view.camera: view for view in s.views if view.camera in rig.names} for s in sets]
    instants = instants[:: max(1, -(-len(instants) // MOST_INSTANTS))]
    trial = _Trial.of(_fitted(rig, instants), instants)
    for _ in range(MOST_MISTAKES):
        bad = trial.suspicious()
        found = _explanation(trial, bad, skeleton) if bad else None
        if found is None:
            break
        notice, trial = found
        notices.append(notice)
    notices += sizes_that_differ(rig, trial.instants)
    notices += [_disagreement(trial, name) for name in trial.blamed()]
    if trial.said() < LEAST_PEOPLE:
        notices.append(Notice("rig.few_people", "info", _FEW if sets else _NONE, {"people": trial.said()}))
        notices += check_up(rig, np.zeros((0, 3)))
    elif not trial.blamed():
        people = np.concatenate([met.points for met in trial.met.values() if trial.speaks(met)])
        above, below = joints_above_and_below(skeleton)
        notices += check_scale(people)
        notices += check_up(rig, _mean(people[:, above]) - _mean(people[:, below]))
    fits = [CameraFit(n, trial.residual(n), trial.people(n)) for n in rig.names]
    return RigReport(tuple(notices), tuple(fits))


_FEW = "too few people are seen by two cameras at once to tell whether the views agree"
_NONE = "without 2D people only the numbers of the rig were checked, not whether the views agree"


def _fitted(rig: Rig, instants: Instants) -> Rig:
    """The rig with its intrinsics scaled to the images that came, where only their size differs."""
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
class _Trial:
    """A rig, its views, and how the rays of each pair of cameras meet."""

    rig: Rig
    instants: Instants
    met: dict[tuple[int, int], Met]
    cache: RayCache

    @classmethod
    def of(cls, rig: Rig, instants: Instants) -> _Trial:
        cache = RayCache()
        met = {pair: _meet(rig, instants, pair, cache) for pair in camera_pairs(rig)}
        return cls(rig, instants, met, cache)

    def changed(self, suspect: Suspect) -> _Trial:
        """The trial with a mistake undone; only the pairs of its cameras are computed anew."""
        rig, instants = suspect.undo(self.rig, self.instants)
        touched = {self.rig.index(name) for name in suspect.cameras}
        met = {
            pair: _meet(rig, instants, pair, self.cache) if touched & set(pair) else old
            for pair, old in self.met.items()
        }
        return _Trial(rig, instants, met, self.cache)

    def speaks(self, met: Met) -> bool:
        return len(met.pixels) >= LEAST_PEOPLE

    def said(self) -> int:
        return sum(len(met.pixels) for met in self.met.values() if self.speaks(met))

    def people(self, name: str) -> int:
        at = self.rig.index(name)
        return sum(len(met.pixels) for pair, met in self.met.items() if at in pair)

    def residuals(
        self, name: str, unit: str = "pixels", others: Collection[str] | None = None
    ) -> list[float]:
        """One residual for each other camera (of `others`), sorted."""
        at = self.rig.index(name)
        partners = {self.rig.index(other) for other in (self.rig.names if others is None else others)} - {at}
        return sorted(
            float(np.quantile(getattr(met, unit), SHARE))
            for pair, met in self.met.items()
            if at in pair and partners & set(pair) and self.speaks(met)
        )

    def residual(self, name: str) -> float:
        """Lower median over the other cameras: one bad neighbour of two does no harm."""
        values = self.residuals(name)
        return values[(len(values) - 1) // 2] if values else float("nan")

    def suspicious(self) -> tuple[str, ...]:
        """Cameras that do not meet most others, and perhaps some that others make look bad."""
        return tuple(c.name for c in self.rig.cameras if _upper(self.residuals(c.name)) > suspicion_px(c))

    def blamed(self) -> list[str]:
        """Cameras that do not agree with the others once the worse ones are left out."""
        left: list[str] = list(self.rig.names)
        blamed: list[str] = []
        while True:
            values = {name: self.residuals(name, others=left) for name in left}
            bad = [n for n in left if _upper(values[n]) > tolerance_px(self.rig.camera(n))]
            if not bad:
                return blamed
            worst = max(bad, key=lambda name: float(np.mean(np.minimum(values[name], WORST))))
            blamed.append(worst)
            left.remove(worst)
            if len(left) == 1:
                return blamed + left  # of two that disagree either may be wrong

    def total(self) -> float:
        values = [np.quantile(met.pixels, SHARE) for met in self.met.values() if self.speaks(met)]
        return float(np.mean(np.minimum(values, WORST))) if values else float("inf")

    def agrees(self, names: Sequence[str]) -> bool:
        """Whether most pairs of each of these cameras agree; of two, both."""
        for name in names:
            values = self.residuals(name)
            if not values or _upper(values) > suspicion_px(self.rig.camera(name)):
                return False
        return True


def _upper(values: Sequence[float]) -> float:
    """Upper median: half of the others, or more, are at most this far; 0 if there is none."""
    return values[len(values) // 2] if values else 0.0


def _meet(rig: Rig, instants: Instants, pair: tuple[int, int], cache: RayCache) -> Met:
    a, b = (rig.cameras[i] for i in pair)
    views = [(i[a.name], i[b.name]) for i in instants if a.name in i and b.name in i]
    return meet(a, b, views, cache)


def _explanation(
    trial: _Trial, bad: tuple[str, ...], skeleton: SkeletonModel
) -> tuple[Notice, _Trial] | None:
    """The mistake that explains most, and the trial without it."""
    best: tuple[float, Suspect, _Trial] | None = None
    for stage in suspects(trial.rig, bad, skeleton.mirror):
        for suspect in stage:
            other = trial.changed(suspect)
            if _helps(trial, other, suspect) and (best is None or other.total() < best[0]):
                best = other.total(), suspect, other
        if best is not None and not best[2].suspicious():
            break
    if best is None:
        return None
    _, suspect, other = best
    given, undone = (_middle(t, suspect.cameras, "metres") for t in (trial, other))
    text = (
        f"{suspect.text}: the rays of people miss each other by {_length(given)} as given "
        f"and by {_length(undone)} without this mistake"
    )
    return Notice(suspect.code, "warning", text, {"cameras": list(suspect.cameras)}), other


def _helps(trial: _Trial, other: _Trial, suspect: Suspect) -> bool:
    """Whether the rays of the suspect's cameras meet far better without the mistake."""
    before, after = (_middle(t, suspect.cameras, "pixels") for t in (trial, other))
    enough = other.said() >= 0.5 * trial.said()
    return enough and after < DROP * before and other.agrees(suspect.cameras)


def _middle(trial: _Trial, names: Sequence[str], unit: str) -> float:
    values = [value for name in names for value in trial.residuals(name, unit)]
    return float(np.median(values)) if values else BEHIND


def _length(metres: float) -> str:
    return f"{metres:.3g} m" if metres >= 0.995 else f"{100 * metres:.2g} cm"


def _mean(points: np.ndarray) -> np.ndarray:
    middles: np.ndarray = points.mean(axis=1)
    return middles


def _disagreement(trial: _Trial, name: str) -> Notice:
    residual = _upper(trial.residuals(name))
    apart = f"by {residual:.0f} px" if residual < BEHIND / 2 else "altogether"
    text = (
        f"camera {name} does not agree with the others: the rays of people miss each other {apart}; "
        "calibrate it again, or check that its images are of the same instants"
    )
    return Notice("rig.disagrees", "warning", text, {"cameras": [name], "residual_px": residual})
