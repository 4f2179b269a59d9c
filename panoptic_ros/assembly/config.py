"""Parameters of assembly."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param
from panoptic_ros.solving.capture_space import CAPTURE_VIEWS


@dataclass(frozen=True, kw_only=True)
class AssemblyConfig(Config):
    """Parameters for solving skeletons from 2D poses and 3D proposals."""

    method: str = param(
        "consensus",
        choices=("consensus", "dynamic_programming"),
        doc="Assembly of people. consensus: from 2D people that agree. dynamic_programming: from 3D "
        "parts, refined as in the paper (5.3); of the parameters here, only correspondence_px, "
        "initial_noise and node_sigma apply to it.",
    )
    correspondence_px: float = param(
        10.0,
        unit="px",
        ge=0.1,
        le=1000.0,
        doc="With dynamic programming: greatest distance of a 2D joint from the projection of its node, "
        "in images of 640 x 480. In other images, the same share of the diagonal.",
    )
    capture_views: int = param(
        CAPTURE_VIEWS,
        ge=2,
        le=1000,
        doc="Cameras whose fields of view must contain a new person; with fewer, the person is a "
        "bystander. Rigs of up to three cameras need two.",
        when="people at the edge of the room are missing (2), or bystanders are reported (more).",
    )
    initial_noise: float = param(
        0.0025,
        ge=1e-5,
        le=0.1,
        doc="Standard deviation of 2D joints before any is learnt, as a share of the image's diagonal.",
    )
    learn_noise: bool = param(
        True, doc="Learn the noise of 2D joints from residuals, by score, view and occlusion."
    )
    noise_memory: float = param(
        4000.0,
        unit="observations",
        ge=50.0,
        le=1e9,
        doc="Number of residuals that the noise table remembers.",
    )
    truncation: float = param(
        4.0,
        unit="sigma",
        ge=1.0,
        le=100.0,
        doc="Residual beyond which the cost of an observation stays constant.",
    )
    cauchy: float = param(3.0, unit="sigma", ge=0.5, le=100.0, doc="Scale of the Cauchy weight.")
    gate: float = param(4.0, unit="sigma", ge=1.0, le=100.0, doc="Residual beyond which a view is left out.")
    foreign_penalty: float = param(
        4.0,
        unit="sigma^2",
        ge=0.0,
        le=100.0,
        doc="Cost of using a joint of another 2D person of the view (merged people).",
    )
    image_borders: bool = param(
        True,
        doc="Leave out 2D joints that a detector reports in the image although the joint lies outside of it.",
    )
    max_pairs: int = param(
        45,
        ge=1,
        le=1000,
        doc="Greatest number of pairs of views whose intersection is tried as the start of a joint.",
    )
    node_sigma: float = param(
        0.03,
        unit="m",
        ge=0.001,
        le=1.0,
        doc="Standard deviation of voted nodes that replace joints which are missing or lie elsewhere.",
    )
    vote_distance: float = param(
        0.1,
        unit="m",
        ge=0.0,
        le=1.0,
        doc="Greatest distance between a joint and the soft vote of the score maps at which the joint "
        "moves towards the vote; 0 = never.",
    )
    vote_sigma: float = param(
        0.003,
        unit="m",
        ge=0.001,
        le=1.0,
        doc="Standard deviation of the soft vote near a joint. It sets the weight of the vote against the "
        "triangulated position.",
    )
    torso_vote_sigma: float = param(
        0.01,
        unit="m",
        ge=0.001,
        le=1.0,
        doc="The same for shoulders, hips and other joints of the torso, where votes err more.",
    )
    two_view_joints: bool = param(
        True,
        doc="For people in two views, place joints also if the views disagree or one lacks the joint. "
        "Their covariances are large.",
    )
    lost_people: bool = param(
        True, doc="Add people who are in score maps but in no list of 2D people, from voted nodes."
    )
    max_joint_sigma: float = param(
        0.3, unit="m", ge=0.01, le=10.0, doc="Standard deviation above which a joint is missing."
    )
    held_sigma: float = param(
        0.2,
        unit="m",
        ge=0.0,
        le=1.0,
        doc="Standard deviation (largest axis) up to which predictions and bone lengths place missing "
        "joints of tracked people; 0 = never.",
    )
    covariance_inflation: float = param(
        0.8, ge=0.0, le=10.0, doc="Inflation of covariances, which grow by 1 + this / (views - 1)."
    )
    bias_table: str = param(
        "",
        doc="Table of the detector's constant biases, which are subtracted: its name or a YAML file; "
        "empty = none.",
        when="`panoptic bias measure` gave you one for your detector, or one is installed for it.",
    )
