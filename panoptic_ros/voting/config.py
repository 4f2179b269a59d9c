"""Parameters of voting."""
from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class VotingConfig(Config):
    """How node proposals are found, and whether parts are scored."""

    method: str = param(
        "seeds",
        choices=("seeds", "exact", "off"),
        doc="How to look for node proposals: where rays of 2D peaks meet; in all of the volume, coarse to "
        "fine; not at all.",
    )
    without_maps: bool = param(
        False,
        doc="Vote also at instants where no view has score maps, with a Gaussian round each 2D joint; "
        "assembly.method=dynamic_programming switches it on.",
    )
    explain_away: bool = param(
        True,
        doc="With seeds: first solve people roughly from the 2D people, give each of their joints a node, "
        "and look for further nodes only in what these joints leave unexplained. Exact searches all.",
    )
    voxel: float = param(0.04, unit="m", ge=0.005, le=0.5, doc="Side of a voxel.")
    threshold: float = param(
        0.0,
        ge=0.0,
        le=1.0,
        doc="Least mean score of a node proposal; 0 = by the number of views "
        "(0.06 below 8, 0.1 below 16, else 0.05).",
    )
    min_views: int = param(
        0,
        ge=0,
        doc="Least number of views that support a node proposal; 0 = by their number (2 below 8, else 3).",
    )
    view_threshold: float = param(
        0.1, ge=0.0, le=1.0, doc="Score above which a view supports a node, or has a 2D peak."
    )
    volume: tuple[float, ...] = param(
        (),
        unit="m",
        doc="Working volume: least x, y, z and largest x, y, z; empty = derived from the rig if "
        "exact, everywhere if seeds.",
        when="all of it is searched (`voting.method=exact`): the box that people use.",
    )
    ray_gap: float = param(
        0.15, unit="m", ge=0.0, le=1.0, doc="Largest distance between two rays that may be of one joint."
    )
    pair_views: int = param(
        10, ge=2, doc="Rays of at most so many views, spread over the rig, are paired for seeds."
    )
    max_depth: float = param(25.0, unit="m", ge=1.0, doc="Seeds farther from a camera are dropped.")
    keypoint_width: float = param(
        0.03,
        ge=0.001,
        le=0.5,
        doc="Without maps: standard deviation of a joint's Gaussian, as a fraction of the square root of "
        "the area of the person's box.",
    )
    person_gate: float = param(
        4.0,
        ge=0.5,
        doc="A map of all people counts for one person within so many of those standard deviations "
        "of the person's joint.",
    )
    parts: bool = param(
        False, doc="Score parts between nodes; assembly.method=dynamic_programming switches it on."
    )
    part_threshold: float = param(
        0.05, ge=0.0, le=1.0, doc="Score that both ends of a part need in a view."
    )
    max_bone: float = param(0.8, unit="m", ge=0.01, doc="Longest part.")
    max_skip: float = param(
        1.1, unit="m", ge=0.01, doc="Longest part across a missing joint, e.g. from hip to ankle."
    )
    skip_parts: bool = param(True, doc="Also score parts across one missing joint.")
    refine_nodes: bool = param(
        True, doc="With exact: refine node proposals below the voxel by a soft vote, as seeds always are."
    )
    merge_distance: float = param(
        0.03, unit="m", ge=0.0, doc="Refined proposals of one joint that are closer become one."
    )
