"""Parameters of association."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class AssociationConfig(Config):
    """Parameters for grouping the 2D poses of several views into people."""

    temporal_guidance: bool = param(
        True,
        doc="Guide association and choices by the people of the previous instant. Positions are never "
        "pulled.",
    )
    track_memory: float = param(
        0.5,
        unit="s",
        ge=0.0,
        le=60.0,
        doc="Time after the last observation of a person for which the person guides association.",
    )
    compensate_stamps: bool = param(
        True,
        doc="Shift each view to the instant of the set, by its own timestamp and the joint's velocity "
        "(needs temporal guidance).",
    )
    image_borders: bool = param(
        True,
        doc="Treat 2D joints of new people as possible artefacts if the joint lies outside of the image; "
        "see `assembly.image_borders`.",
    )
    min_joint_score: float = param(0.0, ge=0.0, le=1.0, doc="Score below which 2D joints are ignored.")

    agreement: float = param(
        0.05,
        unit="m",
        ge=0.005,
        le=0.5,
        doc="Distance at which the agreement of two observations falls to 0.6 (Gaussian).",
    )
    guided_agreement: float = param(
        0.08,
        unit="m",
        ge=0.005,
        le=0.5,
        doc="The same distance for the agreement of an observation with the predicted position of a person.",
    )
    guided_views: int = param(
        1,
        ge=1,
        le=100,
        doc="Views that must show a tracked person. One view is enough for bone lengths to place the joints.",
    )
    person_agreement: float = param(
        0.25,
        ge=0.05,
        le=0.9,
        doc="Least mean agreement of a 2D person with the skeleton that it is assigned to.",
    )
    min_views: int = param(
        3,
        ge=2,
        le=100,
        doc="Views that must support a new person, if enough views can see the person.",
        when="few cameras overlap and people are found late (2), or posters and mirrors are reported as "
        "people (4).",
    )
    view_share: float = param(
        0.25,
        ge=0.0,
        le=1.0,
        doc="Share of the views that should see a new person that must support the person.",
    )
    few_views_share: float = param(
        0.4,
        ge=0.0,
        le=1.0,
        doc="The same share if few views support a new person. With at least two views, it is enough if "
        "they agree well (few_views_agreement).",
    )
    few_views_agreement: float = param(
        0.4,
        ge=0.0,
        le=1.0,
        doc="Mean agreement at which that smaller number of views is enough for a new person; higher if "
        "other views should see the person and do not.",
    )
