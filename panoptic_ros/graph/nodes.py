"""Table of all stages of the graph: code location, input topics and output topics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from panoptic_ros.graph.topics import TOPICS

Queue = Literal["newest", "instant", "all", "late"]


@dataclass(frozen=True)
class Port:
    """Input of a stage.

    Args:
        topic: Key of `TOPICS`. A stage may take variants of the topic instead.
        optional: Whether the stage works without it.
        feedback: Whether it may come from a later stage. Feedback is passed on after everything that follows
            from the current record, and before the next record.
        ahead_ns: Time by which its records are passed on before those of other ports with the same timestamp.
        patience_ns: Live: longest wait of another port's record for this input, by timestamps.
        tells_end: Whether the stage takes an `EndOfStream` when a camera or device has ended.
        first: Whether this port gets a record before other stages do, and before everything that follows from
            it.
        switch: Parameter of the stage that switches the port on, or "stage.name" for one of another stage.
            "": always on.
    """

    topic: str
    optional: bool = False
    feedback: bool = False
    ahead_ns: int = 0
    patience_ns: int = 0
    tells_end: bool = False
    first: bool = False
    switch: str = ""

    @property
    def latched(self) -> bool:
        """Return whether the topic keeps its messages for late subscribers.

        Such a topic has no end to wait for.
        """
        return TOPICS[self.topic].latched


@dataclass(frozen=True)
class NodeSpec:
    """Stage and the node around it.

    Args:
        name: Name of the stage, the node and the parameter section.
        stage, config: "module:class".
        inputs: Ports. Records of one place (see `graph.schedule`) are passed on in this order.
        outputs: Keys of `TOPICS`. A record goes to the topic of its type.
        apart: Whether the inputs of each camera or device are merged separately, because none waits for
            another.
        queue: Policy of a live node that falls behind.
            "newest": A few messages per topic are kept.
            "instant": Images of one instant are taken together.
            "all": Every message counts.
            "late": A second of messages is kept. The stage is informed of its delay and skips work.
        switch: Parameter that switches the stage on, or "stage.name" for one of another stage. "": always on.
        service: ROS type of the service for requested instants (`stage.RequestStage`), with the name of the
            first output. "": none.
    """

    name: str
    stage: str
    config: str
    inputs: tuple[Port, ...]
    outputs: tuple[str, ...]
    apart: bool = False
    queue: Queue = "newest"
    switch: str = ""
    service: str = ""

    def output_for(self, record: object) -> str:
        """Return the key of the topic for an output record of this stage.

        Raises:
            KeyError: if the stage has no topic for the record.
        """
        kind = type(record).__name__
        for key in self.outputs:
            if TOPICS[key].record == kind:
                return key
        raise KeyError(f"stage {self.name} gives a {kind}, which is on none of its topics")


def stage_row(
    name: str,
    inputs: tuple[Port, ...],
    outputs: tuple[str, ...],
    *,
    apart: bool = False,
    queue: Queue = "newest",
    switch: str = "",
) -> NodeSpec:
    """Return the row of a stage in the usual modules.

    These are `<name>/stage.py` with <Name>Stage, and `<name>/config.py` with <Name>Config.
    """
    title = name.capitalize()
    return NodeSpec(
        name,
        f"panoptic_ros.{name}.stage:{title}Stage",
        f"panoptic_ros.{name}.config:{title}Config",
        inputs,
        outputs,
        apart,
        queue,
        switch,
    )


# ahead_ns is the largest time between an image and its depth map, 8 ms, plus 1 ns: the image comes last.
DEPTH = Port("depth", optional=True, ahead_ns=8_000_001, patience_ns=200_000_000)

# In the order of the data flow: a stage comes after the stages whose records it takes, except for feedback.
NODES: dict[str, NodeSpec] = {
    spec.name: spec
    for spec in (
        stage_row("timecode", (Port("audio"),), ("timecode",), apart=True, queue="all"),
        stage_row("clocks", (Port("timecode"),), ("clock_models",), queue="all"),
        stage_row(
            "detection",
            (Port("tracks", optional=True, feedback=True, switch="guided"), DEPTH, Port("image")),
            ("detections",),
            apart=True,
            queue="instant",
        ),
        NodeSpec(
            "flow",
            "panoptic_ros.patches.flow.stage:FlowStage",
            "panoptic_ros.patches.flow.config:FlowConfig",
            (Port("image"), Port("detections")),
            ("patch_tracks",),
            apart=True,
            queue="instant",
            switch="patches.active",
        ),
        stage_row(
            "appearance",
            (Port("image"), Port("detections")),
            ("appearance",),
            apart=True,
            queue="instant",
            switch="tracking.appearance",
        ),
        stage_row(
            "sync",
            (Port("clock_models", optional=True, feedback=True), Port("detections", tells_end=True)),
            ("detection_sets",),
        ),
        stage_row(
            "association",
            (Port("tracks", optional=True, feedback=True), Port("detection_sets")),
            ("associations",),
        ),
        stage_row("voting", (Port("associations"),), ("proposals",)),
        stage_row("assembly", (Port("proposals"),), ("poses",)),
        stage_row(
            "tracking",
            (
                Port("subjects", optional=True),
                Port("appearance", optional=True, switch="appearance"),
                Port("poses"),
            ),
            ("skeletons_raw", "tracks"),
        ),
        stage_row(
            "health",
            (Port("associations", first=True), Port("skeletons_raw")),
            ("repaired_rig",),
            switch="active",
        ),
        stage_row(
            "offsets",
            (Port("detections", first=True), Port("skeletons_raw")),
            ("clock_models",),
            queue="all",
            switch="active",
        ),
        NodeSpec(
            "continuous",
            "panoptic_ros.continuous.stage:ContinuousStage",
            "panoptic_ros.continuous.config:ContinuousStageConfig",
            (Port("subjects", optional=True), Port("clock_models", optional=True), Port("detections")),
            ("skeletons_at",),
            queue="late",
            switch="active",
            service="panoptic_msgs/srv/SkeletonsAt",
        ),
        stage_row(
            "kinematics",
            (
                Port("imu", optional=True),
                Port("detection_sets", optional=True, first=True),
                Port("skeletons_raw", optional=True),
            ),
            ("bodies",),
            queue="late",
            switch="runs",
        ),
        stage_row(
            "patches",
            (Port("patch_tracks", optional=True), Port("sensor_depth", optional=True), Port("skeletons_raw")),
            ("patches",),
            switch="active",
        ),
        stage_row(
            "refinement",
            (
                Port("patches", optional=True, patience_ns=100_000_000, switch="patches.active"),
                Port("bodies", optional=True, switch="bodies"),
                Port("skeletons_raw"),
            ),
            ("skeletons",),
        ),
    )
}

FUSION = ("association", "voting", "assembly", "tracking", "refinement")  # from detection sets to /skeletons
# stages that process images; they run in the processes that hold the images
BESIDE_IMAGES = ("detection", "flow", "appearance")
AFTER_DETECTION = (
    "sync",
    "association",
    "voting",
    "assembly",
    "tracking",
    "health",
    "offsets",
    "continuous",
    "kinematics",
    "patches",
    "refinement",
)
SOUND = ("timecode", "clocks")  # timecode in audio, and clocks from timecode
SLOW = (
    "offsets",
    "continuous",
    "kinematics",
)  # sometimes busy for long; in live flow, no other stage may wait for them
CHAIN = (*BESIDE_IMAGES, *AFTER_DETECTION)
