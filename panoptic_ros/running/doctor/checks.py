"""All checks of `panoptic doctor`, in the order in which they are told."""

from __future__ import annotations

from panoptic_ros.running.doctor.finding import Check
from panoptic_ros.running.doctor.inference import check_inference
from panoptic_ros.running.doctor.machine import MACHINE_CHECKS
from panoptic_ros.running.doctor.network import NETWORK_CHECKS
from panoptic_ros.running.doctor.ros import ROS_CHECKS

CHECKS: dict[str, Check] = {
    **MACHINE_CHECKS,
    "inference": check_inference,
    **ROS_CHECKS,
    **NETWORK_CHECKS,
}
