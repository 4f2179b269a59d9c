"""Parameters of assembly."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class AssemblyConfig(Config):
    """Parameters for solving skeletons from 2D poses and 3D proposals."""

    method: str = param(
        "consensus",
        choices=("consensus", "dynamic_programming"),
        doc="How people are put together: from 2D people that agree; or from 3D parts and refined as in the "
        "paper (5.3), for which correspondence_px, initial_noise and node_sigma count and nothing else here.",
    )
    correspondence_px: float = param(
        10.0,
        unit="px",
        ge=0.1,
        le=1000.0,
        doc="With dynamic programming: how far a 2D joint may be from the projection of its node, in images "
        "of 640 x 480; in others the same share of the diagonal.",
    )
    capture_views: int = param(
        3,
        ge=2,
        le=1000,
        doc="New people must stand in the fields of view of so many cameras, else they are bystanders; "
        "rigs of up to three cameras need two.",
        when="people at the edge of the room are missing (2), or bystanders are reported (more).",
    )
    min_agreed_share: float = param(
        0.5,
        ge=0.0,
        le=1.0,
        doc="Share of the joints seen in two or more views on which these views must agree.",
    )
    initial_noise: float = param(
        0.0025,
        ge=1e-5,
        le=0.1,
        doc="Standard deviation of 2D joints before any was learnt, as a share of the image's diagonal.",
    )
    learn_noise: bool = param(
        True, doc="Learn the noise of 2D joints from residuals, by score, view and being hidden."
    )
    noise_memory: float = param(
        4000.0, unit="observations", ge=50.0, le=1e9, doc="How many residuals the noise table remembers."
    )
    truncation: float = param(
        4.0, unit="sigma", ge=1.0, le=100.0, doc="Residual beyond which an observation says nothing more."
    )
    cauchy: float = param(3.0, unit="sigma", ge=0.5, le=100.0, doc="Scale of the Cauchy weight.")
    gate: float = param(4.0, unit="sigma", ge=1.0, le=100.0, doc="Residual beyond which a view is left out.")
    foreign_penalty: float = param(
        4.0,
        unit="sigma^2",
        ge=0.0,
        le=100.0,
        doc="Cost of taking a joint from another 2D person of the view (merged people).",
    )
    image_borders: bool = param(
        True, doc="Leave out 2D joints that a detector reports although the joint lies outside of the image."
    )
    max_pairs: int = param(
        45, ge=1, le=1000, doc="Pairs of views whose intersection is tried as the start of a joint."
    )
    node_sigma: float = param(
        0.03,
        unit="m",
        ge=0.001,
        le=1.0,
        doc="Standard deviation of voted nodes, which stand for joints that are missing or placed elsewhere.",
    )
    vote_distance: float = param(
        0.1,
        unit="m",
        ge=0.0,
        le=1.0,
        doc="Joints that score maps show move towards the maps' soft vote if it is this near; 0 = never.",
    )
    vote_sigma: float = param(
        0.003,
        unit="m",
        ge=0.001,
        le=1.0,
        doc="Standard deviation of the soft vote about a joint, which counts against triangulation's.",
    )
    torso_vote_sigma: float = param(
        0.01,
        unit="m",
        ge=0.001,
        le=1.0,
        doc="The same of shoulders, hips and what else is in the torso, where votes err more.",
    )
    two_view_joints: bool = param(
        True,
        doc="Place joints of people whom two views show also where these disagree or one lacks the "
        "joint; their covariances are large.",
    )
    lost_people: bool = param(
        True, doc="Add people whom score maps show and no list of 2D people has, from voted nodes."
    )
    max_joint_sigma: float = param(
        0.3, unit="m", ge=0.01, le=10.0, doc="Joints that are less certain than this are missing."
    )
    held_sigma: float = param(
        0.2,
        unit="m",
        ge=0.0,
        le=1.0,
        doc="Joints of people whom one or two views show, and who were seen better before, are placed by the "
        "lengths of their bones until they are less certain than this (largest axis); 0 = never.",
    )
    covariance_inflation: float = param(
        0.8, ge=0.0, le=10.0, doc="Covariances grow by 1 + this / (views - 1)."
    )
    bias_table: str = param(
        "",
        doc="Table of the detector's constant biases that are taken out: its name or a YAML file; "
        "empty = none.",
        when="`panoptic bias measure` gave you one for your detector, or one is installed for it.",
    )
