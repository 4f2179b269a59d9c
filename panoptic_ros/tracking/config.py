"""Parameters of tracking."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.identity.subjects import subjects_of
from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class TrackingConfig(Config):
    """Parameters for giving identities to skeletons over time."""

    method: str = param(
        "joints",
        choices=("joints", "head"),
        doc="What tells who is who: predictions of all joints and, after gaps, place and bones; or, as in "
        "the paper (5.3), where the head was seen last.",
    )
    max_distance: float = param(
        0.5,
        unit="m",
        ge=0.05,
        le=5.0,
        doc="Mean joint distance from its prediction beyond which a skeleton is somebody else; with method "
        "head the distance of the heads.",
    )
    memory: float = param(
        2.0,
        unit="s",
        ge=0.0,
        le=600.0,
        doc="How long an identity waits for somebody who is not seen.",
        when="people leave and come back later and should keep their number (30), or others take their "
        "place (shorter).",
    )
    recognition_time: float = param(
        0.6,
        unit="s",
        ge=0.0,
        le=10.0,
        doc="How long somebody who comes is looked at, where it may be one who was lost, before it is "
        "somebody new; until then nobody is reported.",
    )
    joint_memory: float = param(
        0.3,
        unit="s",
        ge=0.0,
        le=10.0,
        doc="How long single joints are predicted; after that the middle of the body decides.",
    )
    return_distance: float = param(
        0.6, unit="m", ge=0.0, le=20.0, doc="How far from where it was lost somebody may come back at once."
    )
    return_speed: float = param(
        1.2, unit="m/s", ge=0.0, le=20.0, doc="How that distance grows with the time of absence."
    )
    appearance: bool = param(
        False,
        doc="Recognise those who come back by the colours of their clothes, too, where images are at "
        "hand. With a long memory.",
    )
    subjects: tuple[str, ...] = param(
        (),
        doc='Designated people, as "ID" or, where the pelvis is when people are first seen, "ID=X Y Z" '
        "in metres. All others are bystanders. The topic /subjects says it anew.",
        when="visitors or staff are in sight; `panoptic run --subject FILE` gives it.",
    )
    bystanders: bool = param(False, doc="Report bystanders too, under other ids.")
    confirm_views: float = param(
        2.0,
        ge=1.0,
        le=1000.0,
        doc="Mean number of views per joint from which a new skeleton gets an identity at once.",
    )
    confirm_joints: float = param(
        0.6, ge=0.0, le=1.0, doc="Share of the joints from which a new skeleton gets an identity at once."
    )
    confirm_frames: int = param(
        5,
        ge=1,
        le=1000,
        doc="Otherwise it must be seen in so many sets without a long gap. It is no time, as ghosts of "
        "different sets are independent.",
    )

    def __post_init__(self) -> None:
        Config.__post_init__(self)
        subjects_of(self.subjects, "TrackingConfig.subjects")
