"""Layouts of other viewers name topics that the graph has, with the types that they draw."""

import json
import re

import yaml

from panoptic_ros.domain import Rig
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.io.resources import share_folder

FOLDER = share_folder() / "config" / "layouts"
DRAWN = {  # by what
    "rviz_default_plugins/MarkerArray": "visualization_msgs/msg/MarkerArray",
    "rviz_default_plugins/Image": "sensor_msgs/msg/CompressedImage",
}


def type_of(topic):
    """Of a topic of the graph, of whatever camera; KeyError if there is none."""
    for row in TOPICS.values():
        if re.fullmatch("/" + re.escape(row.name).replace(r"\{owner\}", "[^/]+"), topic):
            return row.message
    raise KeyError(topic)


def test_rviz():
    manager = yaml.safe_load((FOLDER / "panoptic.rviz").read_text())["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == Rig.__dataclass_fields__["frame_id"].default
    shown = [item for item in manager["Displays"] if "Topic" in item]
    assert {item["Class"] for item in shown} == set(DRAWN)
    for item in shown:
        assert type_of(item["Topic"]["Value"]) == DRAWN[item["Class"]]


def test_foxglove():
    layout = json.loads((FOLDER / "foxglove.json").read_text())
    panels = layout["configById"]

    def names(part):
        return [part] if isinstance(part, str) else [*names(part["first"]), *names(part["second"])]

    assert sorted(names(layout["layout"])) == sorted(panels)
    (people,) = panels["3D!people"]["topics"]
    assert type_of(people) == "visualization_msgs/msg/MarkerArray"
    assert type_of(panels["Image!camera"]["imageMode"]["imageTopic"]) == "sensor_msgs/msg/CompressedImage"
    assert panels["3D!people"]["followTf"] == Rig.__dataclass_fields__["frame_id"].default
