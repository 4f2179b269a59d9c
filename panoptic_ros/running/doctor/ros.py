"""Checks the ROS installation for `panoptic doctor`: environment, rclpy, messages, logs.

Everything that touches rclpy runs in a child process. So a library that cannot be loaded becomes a finding
and does not end the doctor.
"""

from __future__ import annotations

import importlib.util
import os
import sys
from pathlib import Path

from panoptic_ros.io.resources import share_folder
from panoptic_ros.running.doctor.finding import Check, Finding, fail, finish, ok, start_python, warn

GUARD = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"  # set by the ROS wheels after they have set LD_LIBRARY_PATH

_IMPORT = """
import rclpy
print(rclpy.get_rmw_implementation_identifier(), "with", *rclpy.__path__)
"""
_TYPES = """
import panoptic_msgs.msg as messages
from rclpy.type_support import check_for_type_support
names = [name for name in dir(messages) if name[0].isupper()]
for name in names:
    check_for_type_support(getattr(messages, name))
print(len(names))
"""


def check_environment() -> Finding:
    """Check for variables that break the ROS wheels or mix two ROS installations."""
    libraries = [part for part in os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep) if part]
    if not _from_wheels():
        return ok("ROS is that of the system")
    own = str(Path(sys.prefix) / "lib")
    if os.environ.get(GUARD) and own not in libraries:
        return fail(f"{GUARD} is set and LD_LIBRARY_PATH lacks {own}", f"unset {GUARD}")
    others = [part for part in libraries if part != own and (Path(part) / "librcl.so").exists()]
    others += [part for part in sys.path if part.startswith("/opt/ros/")]
    if others:
        return warn(f"another ROS is in reach: {others[0]}", "start a shell without setup.bash of ROS")
    chosen = os.environ.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
    if chosen != "rmw_fastrtps_cpp":
        return fail(
            f"RMW_IMPLEMENTATION={chosen}, the ROS wheels hold rmw_fastrtps_cpp alone",
            "unset RMW_IMPLEMENTATION",
        )
    profile = os.environ.get("FASTRTPS_DEFAULT_PROFILES_FILE")
    if profile and not Path(profile).is_file():
        return warn(f"FASTRTPS_DEFAULT_PROFILES_FILE: no file {profile}", "correct it or unset it")
    return ok("no variable of another ROS or DDS installation")


def check_rclpy() -> Finding:
    """Check that rclpy and its middleware load."""
    if importlib.util.find_spec("rclpy") is None:
        return fail("rclpy is not installed", "./run setup, or source /opt/ros/jazzy/setup.bash")
    outcome = finish(start_python(_IMPORT), timeout_s=30)
    if outcome.succeeded:
        return ok(outcome.output)
    remedy = "./run setup"
    if "rmw_fastrtps" in outcome.last_error:
        remedy = "python -m pip install ros-jazzy-rmw-fastrtps-cpp==8.4.3"
    elif ".so" in outcome.last_error:
        remedy = f"unset {GUARD}"
    return fail(f"rclpy does not load: {outcome.last_error}", remedy)


def check_messages() -> Finding:
    """Check that panoptic_msgs is installed, loads, and was built from the definitions of this repository."""
    found = importlib.util.find_spec("panoptic_msgs")
    remedy = "./run setup, or python -m pip install ./msg_defs, or colcon build --base-paths . msg_defs"
    if found is None or found.origin is None:
        return fail("panoptic_msgs is not installed", remedy)
    outcome = finish(start_python(_TYPES), timeout_s=30)
    if not outcome.succeeded:
        return fail(f"panoptic_msgs does not load: {outcome.last_error}", remedy)
    here = share_folder() / "msg_defs" / "msg"
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    folders = [Path(found.origin).parent / "msg", *(p / "share/panoptic_msgs/msg" for p in prefixes)]
    built = next((folder for folder in folders if list(folder.glob("*.msg"))), None)
    if here.is_dir() and built is not None:
        changed = _differences(here, built)
        if changed:
            return fail(f"built from other definitions than {here}: {', '.join(changed)}", remedy)
        return ok(f"{outcome.output} messages, built from {here}")
    return ok(f"{outcome.output} messages in {Path(found.origin).parent}")


def check_log_folder() -> Finding:
    """Check that the ROS log folder is writable. No node starts without a log file."""
    environment = os.environ
    if environment.get("ROS_LOG_DIR"):
        folder = Path(environment["ROS_LOG_DIR"])
    elif environment.get("ROS_HOME"):
        folder = Path(environment["ROS_HOME"]) / "log"
    elif environment.get("HOME"):
        folder = Path(environment["HOME"]) / ".ros" / "log"
    else:
        return fail("neither HOME nor ROS_LOG_DIR is set: no node would start", "export ROS_LOG_DIR=FOLDER")
    existing = next(place for place in (folder, *folder.resolve().parents) if place.exists())
    if existing.is_dir() and os.access(existing, os.W_OK | os.X_OK):
        return ok(f"{folder} is writable")
    return fail(f"no permission to write in {folder}", "export ROS_LOG_DIR=FOLDER")


def _from_wheels() -> bool:
    return importlib.util.find_spec("ros_wheels_bootstrapper") is not None


def _differences(one: Path, other: Path) -> list[str]:
    """Return the names of definitions that exist in only one folder or differ between both.

    Services are in the folder `srv` beside the folder of the messages.
    """
    files = [[*folder.glob("*.msg"), *folder.parent.glob("srv/*.srv")] for folder in (one, other)]
    texts = [{path.name: path.read_bytes() for path in paths} for paths in files]
    return sorted(
        name for name in texts[0].keys() | texts[1].keys() if texts[0].get(name) != texts[1].get(name)
    )


ROS_CHECKS: dict[str, Check] = {
    "environment": check_environment,
    "rclpy": check_rclpy,
    "messages": check_messages,
    "log folder": check_log_folder,
}
