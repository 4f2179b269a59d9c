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
        doc="Basis of identities. joints: predictions of all joints and, after gaps, place and bones. "
        "head: last observed position of the head, as in the paper (5.3).",
    )
    max_distance: float = param(
        0.5,
        unit="m",
        ge=0.05,
        le=5.0,
        doc="Mean distance of joints from their predictions beyond which a skeleton is another person; "
        "with method head, the distance of the heads.",
    )
    memory: float = param(
        2.0,
        unit="s",
        ge=0.0,
        le=600.0,
        doc="Time for which the identity of a person who is not seen is kept.",
        when="people leave and return later and should keep their number (30), or others take their place "
        "(shorter).",
    )
    recognition_time: float = param(
        0.6,
        unit="s",
        ge=0.0,
        le=10.0,
        doc="Longest time for which a newcomer who may be a lost person is observed before the newcomer "
        "counts as a new person. Until then the newcomer is not reported.",
    )
    joint_memory: float = param(
        0.3,
        unit="s",
        ge=0.0,
        le=10.0,
        doc="Time for which single joints are predicted. After it, the middle of the body decides.",
    )
    return_distance: float = param(
        0.6,
        unit="m",
        ge=0.0,
        le=20.0,
        doc="Greatest distance from the place of loss at which a person is re-identified at once.",
    )
    return_speed: float = param(
        1.2, unit="m/s", ge=0.0, le=20.0, doc="Growth of that distance with the time of absence."
    )
    appearance: bool = param(
        False,
        doc="Re-identify people also by the colours of their clothes, if images are available. For use "
        "with a long memory.",
    )
    subjects: tuple[str, ...] = param(
        (),
        doc='Designated people, as "ID", or as "ID=X Y Z" with the position of the pelvis in metres when '
        "people are first seen. All others are bystanders. A message on /subjects replaces the list.",
        when="visitors or staff are in sight; `panoptic run --subject FILE` sets it.",
    )
    bystanders: bool = param(False, doc="Report bystanders too, under other ids.")
    confirm_views: float = param(
        2.0,
        ge=1.0,
        le=1000.0,
        doc="Least mean number of views per joint with which a new skeleton gets an identity at once.",
    )
    confirm_joints: float = param(
        0.6,
        ge=0.0,
        le=1.0,
        doc="Least share of the joints with which a new skeleton gets an identity at once.",
    )
    confirm_frames: int = param(
        5,
        ge=1,
        le=1000,
        doc="Number of sets, without a long gap, in which any other new skeleton must be seen before it "
        "gets an identity. It is a number and not a time, as ghosts of different sets are independent.",
    )

    def __post_init__(self) -> None:
        Config.__post_init__(self)
        subjects_of(self.subjects, "TrackingConfig.subjects")
