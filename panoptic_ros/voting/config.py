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
        doc="Search for node proposals. seeds: at the intersections of rays of 2D peaks. exact: in the "
        "whole volume, coarse to fine. off: none.",
    )
    without_maps: bool = param(
        False,
        doc="Vote also at instants without score maps in any view, with a Gaussian around each 2D joint. "
        "assembly.method=dynamic_programming switches it on.",
    )
    explain_away: bool = param(
        True,
        doc="With seeds: give each joint of associated people a node at the votes around it, and search "
        "for further nodes only in votes that these joints do not explain. Method exact searches "
        "everywhere.",
    )
    voxel: float = param(0.04, unit="m", ge=0.005, le=0.5, doc="Side length of a voxel.")
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
        doc="Least number of views that support a node proposal; 0 = by the number of views (2 below 8, "
        "else 3).",
    )
    view_threshold: float = param(
        0.1, ge=0.0, le=1.0, doc="Score above which a view supports a node or has a 2D peak."
    )
    volume: tuple[float, ...] = param(
        (),
        unit="m",
        doc="Working volume: least x, y, z and greatest x, y, z. Empty = derived from the rig with method "
        "exact, unlimited with method seeds.",
        when="the whole volume is searched (`voting.method=exact`): the box that people use.",
    )
    parts: bool = param(
        False,
        doc="Compute scores of parts between nodes; assembly.method=dynamic_programming switches it on.",
    )
    part_threshold: float = param(
        0.05, ge=0.0, le=1.0, doc="Score that both ends of a part must exceed in a view."
    )
    max_bone: float = param(0.8, unit="m", ge=0.01, doc="Greatest length of a part.")
