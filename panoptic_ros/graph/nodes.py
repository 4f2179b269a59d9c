"""Every stage of the graph: where its code is, what it takes and what it gives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from panoptic_ros.graph.topics import TOPICS

Queue = Literal["newest", "instant", "all", "late"]


@dataclass(frozen=True)
class Port:
    """One input of a stage.

    Args:
        topic: key of `TOPICS`. A stage may take its variants in place of it.
        optional: the stage works without it.
        feedback: it may come from a stage further down. What comes back is handed over after all that
            follows from the record at hand, and before the next one.
        ahead_ns: its records are handed over so much before those of other ports with the same stamp.
        patience_ns: live, a record of another port waits so long for it, in stamps.
        tells_end: the stage takes an `EndOfStream` when a camera or device gives no more.
        first: it takes a record before other stages do, and before what follows from it.
        switch: name of what in the stage's configuration says whether the port is used, or "stage.name" of
            what does in another's; "" = it always is.
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
        """Whether the topic keeps its messages for readers that come late. It has no end to wait for."""
        return TOPICS[self.topic].latched


@dataclass(frozen=True)
class NodeSpec:
    """One stage and the node around it.

    Args:
        name: of the stage, the node and the section of the parameters.
        stage, config: "module:class".
        inputs: ports. Records of one place (see `graph.schedule`) are handed over in this order.
        outputs: keys of `TOPICS`. A record goes to the topic of its type.
        apart: the inputs of every camera or device are merged on their own, as none waits for another.
        queue: of a live node that falls behind. "newest": a few messages of every topic; "instant": images
            of one instant together; "all": as every message counts; "late": a second of messages, as
            it is told that it is late, and leaves work out by itself.
        switch: name of the parameter that turns the stage on, or "stage.name" of another stage's; "" = it is
            always on.
    """

    name: str
    stage: str
    config: str
    inputs: tuple[Port, ...]
    outputs: tuple[str, ...]
    apart: bool = False
    queue: Queue = "newest"
    switch: str = ""

    def output_for(self, record: object) -> str:
        """The key of the topic that a record of this stage goes to.

        Raises:
            KeyError: if the stage gives no such record.
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
    """A row for a stage in the usual places: `<name>/stage.py`: <Name>Stage, `<name>/config.py`:
    <Name>Config.
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


# 1 ns more than an image and its depth map may be apart, so that the image comes last.
DEPTH = Port("depth", optional=True, ahead_ns=8_000_001, patience_ns=200_000_000)

# In the order in which records go down. A stage stands below those whose records it takes, but for feedback.
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
            "offsets",
            (Port("detections", first=True), Port("skeletons_raw")),
            ("clock_models",),
            queue="all",
            switch="active",
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
BESIDE_IMAGES = ("detection", "flow", "appearance")  # what looks at images: in the processes that have them
AFTER_DETECTION = (
    "sync",
    "association",
    "voting",
    "assembly",
    "tracking",
    "offsets",
    "kinematics",
    "patches",
    "refinement",
)
SOUND = ("timecode", "clocks")  # what comes of timecode in sound
SLOW = ("offsets", "kinematics")  # busy for long at times: live, nobody must wait for them
CHAIN = (*BESIDE_IMAGES, *AFTER_DETECTION)
