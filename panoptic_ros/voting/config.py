"""Parameters of voting."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, param


@dataclass(frozen=True, kw_only=True)
class VotingConfig(Config):
    """Configuration of the search for node proposals and of part scores."""

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
        doc="With seeds: give each joint of associated people a node where the votes about it are, and look "
        "for further nodes only in what these joints leave unexplained. Exact searches all.",
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
    parts: bool = param(
        False, doc="Score parts between nodes; assembly.method=dynamic_programming switches it on."
    )
    part_threshold: float = param(0.05, ge=0.0, le=1.0, doc="Score that both ends of a part need in a view.")
    max_bone: float = param(0.8, unit="m", ge=0.01, doc="Longest part.")
