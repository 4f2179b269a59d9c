"""Parameters of association."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class AssociationConfig(Config):
    """Parameters for grouping the 2D poses of several views into people."""

    temporal_guidance: bool = param(
        True, doc="Let the people of the instant before guide association and choices; never pulls positions."
    )
    track_memory: float = param(
        0.5, unit="s", ge=0.0, le=60.0, doc="How long somebody guides after being seen last."
    )
    compensate_stamps: bool = param(
        True,
        doc="Shift each view to the instant of the set by its own stamp and the joint's velocity "
        "(needs temporal guidance).",
    )
    image_borders: bool = param(
        True,
        doc="2D joints of new people may be artefacts where the joint lies outside of the image; see "
        "`assembly.image_borders`.",
    )
    min_joint_score: float = param(0.0, ge=0.0, le=1.0, doc="2D joints with lower scores are ignored.")

    agreement: float = param(
        0.05,
        unit="m",
        ge=0.005,
        le=0.5,
        doc="Distance at which the agreement of two observations has fallen to 0.6 (Gaussian).",
    )
    guided_agreement: float = param(
        0.08, unit="m", ge=0.005, le=0.5, doc="The same for the agreement with where somebody should be now."
    )
    guided_views: int = param(
        1, ge=1, le=100, doc="Views that must show somebody who is followed; one is enough for bones to hold."
    )
    person_agreement: float = param(
        0.25, ge=0.05, le=0.9, doc="Mean agreement from which a 2D person belongs to a skeleton."
    )
    min_views: int = param(
        3,
        ge=2,
        le=100,
        doc="Views that must support a new person, where enough can see it.",
        when="few cameras overlap and people are found late (2), or posters and mirrors become people (4).",
    )
    view_share: float = param(
        0.25, ge=0.0, le=1.0, doc="Share of the views that should see a new person and must support it."
    )
    few_views_share: float = param(
        0.4,
        ge=0.0,
        le=1.0,
        doc="The same where few views can see it: that share, and at least two views, are enough.",
    )
    few_views_agreement: float = param(
        0.4,
        ge=0.0,
        le=1.0,
        doc="Mean agreement that makes so few views enough for a new person; more where others see nobody.",
    )
