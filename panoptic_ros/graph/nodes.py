"""Every stage of the graph: where its code is, what it takes and what it gives."""
from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class NodeSpec:
    """One stage and the node around it.

    Args:
        name: of the stage, the node and the section of the parameters.
        stage, config: "module:class".
        takes, gives: keys of `TOPICS`. A node does not need what is latched among the former, and does not
            wait for its end in replay.
    """

    name: str
    stage: str
    config: str
    takes: tuple[str, ...]
    gives: str


def _spec(name: str, takes: tuple[str, ...], gives: str) -> NodeSpec:
    """The usual places: `<name>/stage.py` with <Name>Stage, `<name>/config.py` with <Name>Config."""
    title = name.capitalize()
    return NodeSpec(
        name,
        f"panoptic_ros.{name}.stage:{title}Stage",
        f"panoptic_ros.{name}.config:{title}Config",
        takes,
        gives,
    )


NODES: dict[str, NodeSpec] = {
    spec.name: spec
    for spec in (
        _spec("timecode", ("audio",), "timecode"),
        _spec("clocks", ("timecode",), "clock_models"),
        _spec("detection", ("image", "depth"), "detections"),
        _spec("offsets", ("detections", "skeletons_raw"), "clock_models"),
        _spec("sync", ("detections", "clock_models"), "detection_sets"),
        _spec("voting", ("detection_sets",), "proposals"),
        _spec("assembly", ("proposals",), "poses"),
        _spec("tracking", ("poses",), "skeletons_raw"),
        _spec("refinement", ("skeletons_raw",), "skeletons"),
    )
}

FUSION = ("voting", "assembly", "tracking", "refinement")  # from detection sets to /skeletons
