"""ROS's names of lens models, as in sensor_msgs/distortion_models.hpp."""
from __future__ import annotations

from panoptic_ros.geometry import Lens

DISTORTION_MODELS: dict[Lens, str] = {"brown": "plumb_bob", "fisheye": "equidistant"}
