"""The mechanisms of voting, association, assembly, tracking and refinement, and what switches them off."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import numpy as np

from panoptic_ros.assembly.noise import NoiseCovariates, NoiseTable
from panoptic_ros.errors import UsageError
from panoptic_ros.solving.joint_records import PersonCandidates

Settings = dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Mechanism:
    """One mechanism that the core has in addition to the simplest method.

    Args:
        part: Part of the core, for the reader; the stage that has the parameter may be another.
        name: Unique name.
        about: Effect of the mechanism.
        off: Parameters that switch the mechanism off, {stage: {parameter: value}}.
        maps: Whether it acts on score maps alone.
    """

    part: str
    name: str
    about: str
    off: Settings
    maps: bool = False
    replaced: tuple[tuple[str, Any], ...] = ()


def _voting(name: str, about: str, **off: Any) -> Mechanism:
    return Mechanism("voting", name, about, {"voting": off}, maps=True)


def _association(name: str, about: str, **off: Any) -> Mechanism:
    return Mechanism("association", name, about, {"association": off})


def _assembly(name: str, about: str, maps: bool = False, **off: Any) -> Mechanism:
    return Mechanism("assembly", name, about, {"assembly": off}, maps)


def _tracking(name: str, about: str, **off: Any) -> Mechanism:
    return Mechanism("tracking", name, about, {"tracking": off})


def _refinement(name: str, about: str, **off: Any) -> Mechanism:
    return Mechanism("refinement", name, about, {"refinement": off})


def _code(part: str, name: str, about: str, place: str, substitute: Any) -> Mechanism:
    return Mechanism(part, name, about, {}, replaced=((f"panoptic_ros.{place}", substitute),))


NO_LIMIT = 100.0  # standard deviations
_learn, _covariates = NoiseTable.learn, NoiseCovariates.of


def _learnt_without(**values: float) -> Any:
    """Return a `NoiseTable.learn` that keeps these learnt values of the table at their start."""

    def learn(table: NoiseTable, *given: Any) -> None:
        _learn(table, *given)
        for name, value in values.items():
            getattr(table._learnt, name)[:] = value

    return learn


_learnt_by_score = _learnt_without(factors=1.0, growth=0.0)


def _none_hidden(found: PersonCandidates, bones: Any, cams: Any, rows: int) -> np.ndarray:
    return np.zeros((rows, found.places.shape[1]), np.int64)


def _no_tails(table: NoiseTable, marks: NoiseCovariates) -> np.ndarray:
    return np.ones(marks.scores.shape)


def _of_one_score(*given: Any) -> NoiseCovariates:
    """Return the covariates of 2D joints with one score for all."""
    found = _covariates(*given)
    return found._replace(scores=np.where(found.scores > 0.0, 0.5, 0.0))


_OF_PARAMETERS: tuple[Mechanism, ...] = (
    _voting("votes", "3D votes from score maps", method="off"),
    _voting("explain-away", "search only what known people leave", explain_away=False),
    _association("guidance", "known people first, from the last instant", temporal_guidance=False),
    _association("view-share", "new people need a share of the views that should see them", view_share=0.0),
    _association("three-views", "new people need three views where enough see them", min_views=2),
    _association(
        "two-views", "two views in accord make a new person where few see it", few_views_agreement=1.0
    ),
    _association("delays", "views are shifted to the instant by their stamps", compensate_stamps=False),
    _assembly("capture-space", "no people who stand in the view of two cameras alone", capture_views=2),
    _assembly(
        "learnt-noise", "the noise of 2D joints is learnt, by score, view and being hidden", learn_noise=False
    ),
    _assembly("cauchy", "large residuals count less", cauchy=NO_LIMIT),
    _assembly("gate", "views with large residuals are left out", gate=NO_LIMIT),
    _assembly(
        "robustness",
        "gate, Cauchy weight, and a limit of the cost of an observation",
        truncation=NO_LIMIT,
        gate=NO_LIMIT,
        cauchy=NO_LIMIT,
    ),
    Mechanism(
        "assembly",
        "image-borders",
        "2D joints whose joint lies outside of the image are left out",
        {"association": {"image_borders": False}, "assembly": {"image_borders": False}},
    ),
    _assembly("starts", "a joint is begun from many pairs of views", max_pairs=1),
    _assembly("foreign-joints", "joints are taken from other 2D people of the view", foreign_penalty=100.0),
    _assembly("map-votes", "joints go to the soft votes of the maps", True, vote_distance=0.0),
    _assembly("lost-people", "people who are in score maps only are added", True, lost_people=False),
    _assembly(
        "two-view-joints",
        "joints on which two views disagree, or that one shows, are placed",
        two_view_joints=False,
    ),
    _assembly("held-people", "predictions and bones place missing joints of tracked people", held_sigma=0.0),
    _assembly("longest-sigma", "joints that are too uncertain are missing", max_joint_sigma=10.0),
    _assembly("few-views-variance", "covariances grow where few views agree", covariance_inflation=0.0),
    _tracking("memory", "identities wait longer than 0.1 s for people who are not seen", memory=0.1),
    _tracking(
        "predicted-joints", "joints decide who is who, not the middle of the body alone", joint_memory=0.0
    ),
    _tracking(
        "returns",
        "lost people are re-identified near the place of loss",
        return_distance=0.0,
        return_speed=0.0,
    ),
    _tracking("recognition", "newcomers are observed before they get a new id", recognition_time=0.0),
    _tracking("confirmation", "doubtful skeletons must be seen often", confirm_frames=1),
    _refinement("smoothing", "motion is smoothed", enabled=False),
    _refinement("lag", "later views are used, too", lag=0.0),
    _refinement("limb-noise", "fast limbs are followed more quickly", limb_noise=0.0),
    _refinement("smoothed-cauchy", "large innovations count less", cauchy=NO_LIMIT),
    _refinement("predictions", "joints of people who are seen are predicted", max_prediction=0.0),
    _refinement("filled-sigma", "filled joints that are too uncertain are missing", max_sigma=10.0),
    _refinement("bone-lengths", "bones keep their learnt lengths", bone_sigma=0.0),
    _refinement("lasting-errors", "part of the errors persists", lasting_share=0.0),
    _refinement("bias-floor", "covariances include constant biases", bias_floor=0.0),
)

_OF_CODE = tuple(
    _code(*row)
    for row in (
        (
            "assembly",
            "hidden-noise",
            "the noise of hidden joints is learnt apart",
            "assembly.stage:hidden_marks",
            _none_hidden,
        ),
        (
            "assembly",
            "noise-by-score",
            "the noise is learnt by score",
            "assembly.noise:NoiseCovariates.of",
            _of_one_score,
        ),
        (
            "assembly",
            "noise-by-view",
            "each view has a factor on the noise",
            "assembly.noise:NoiseTable.learn",
            _learnt_without(factors=1.0),
        ),
        (
            "assembly",
            "noise-by-size",
            "the noise grows with the size of the person in the image",
            "assembly.noise:NoiseTable.learn",
            _learnt_without(growth=0.0),
        ),
        (
            "assembly",
            "noise-tails",
            "joints of two views count the tail of the noise",
            "assembly.noise:NoiseTable.tails",
            _no_tails,
        ),
        (
            "assembly",
            "first-twice",
            "the first instant is solved again with its noise",
            "assembly.noise:NoiseTable.learnt",
            property(lambda table: True, lambda table, value: None),
        ),
        (
            "assembly",
            "corrected-velocities",
            "views are shifted again by corrected velocities",
            "assembly.time_shift:likelier_velocities",
            lambda found, solved, motion, prediction: found.guide.shifts.copy(),
        ),
        (
            "tracking",
            "sides",
            "tracks exchange sides that most views see exchanged",
            "tracking.tracks:Tracks.exchange_sides",
            lambda tracks, limbs: None,
        ),
        (
            "tracking",
            "anatomy",
            "the nose counts in that vote",
            "assembly.stage:ANATOMY_VOTES",
            0.0,
        ),
        (
            "refinement",
            "learnt-process-noise",
            "the process noise of each person is learnt",
            "refinement.tuning:_change",
            lambda people, changes: None,
        ),
        (
            "refinement",
            "learnt-scale",
            "the scale of covariances is learnt",
            "refinement.filter_bank:scales",
            lambda people, lasting: np.ones_like(people.levels),
        ),
        (
            "refinement",
            "persistent-scale",
            "it grows with persistent errors",
            "refinement.filter_bank:scales",
            lambda people, lasting: people.levels.copy(),
        ),
    )
)
_COVARIATES = Mechanism(
    "assembly",
    "noise-covariates",
    "all of these but the score",
    {},
    replaced=(
        ("panoptic_ros.assembly.stage:hidden_marks", _none_hidden),
        ("panoptic_ros.assembly.noise:NoiseTable.learn", _learnt_by_score),
        ("panoptic_ros.assembly.noise:NoiseTable.tails", _no_tails),
    ),
)
PARTS = tuple(dict.fromkeys(mechanism.part for mechanism in _OF_PARAMETERS))
MECHANISMS = tuple(
    sorted((*_OF_PARAMETERS, *_OF_CODE, _COVARIATES), key=lambda mechanism: PARTS.index(mechanism.part))
)


def chosen(words: Collection[str]) -> tuple[Mechanism, ...]:
    """Return the mechanisms with these names or parts, in the order of the table; no words = all.

    Raises:
        UsageError: if a word is neither.
    """
    known = {mechanism.name for mechanism in MECHANISMS}
    for word in words:
        if word not in known and word not in PARTS:
            raise UsageError(
                f"--only {word}: there is no such mechanism; there are those of {', '.join(PARTS)}: "
                f"{', '.join(sorted(known))}"
            )
    return tuple(m for m in MECHANISMS if not words or m.name in words or m.part in words)
