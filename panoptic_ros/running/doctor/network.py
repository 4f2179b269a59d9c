"""Checks of `panoptic doctor` about what nodes talk over: shared memory, multicast, a small graph."""

from __future__ import annotations

import os
import shutil
import socket

from panoptic_ros.running.doctor.finding import Check, Finding, fail, finish, ok, start_python, warn
from panoptic_ros.running.processes.shared_memory import SHARED_MEMORY, leftovers

LITTLE_SHARED_MEMORY = 256  # MiB; Docker's default is 64
MUCH_LEFT_OVER = 64  # MiB
MULTICAST_GROUP = "239.255.0.1"  # of DDS discovery

_TALK = """
import sys, time, rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
rclpy.init()
node = rclpy.create_node("panoptic_doctor_" + sys.argv[1])
kept = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
heard = []
if sys.argv[1] == "speaker":
    publisher = node.create_publisher(String, sys.argv[2], kept)
    publisher.publish(String(data="hello"))
else:
    node.create_subscription(String, sys.argv[2], heard.append, kept)
end = time.monotonic() + float(sys.argv[3])
while not heard and time.monotonic() < end:
    rclpy.spin_once(node, timeout_sec=0.1)
node.destroy_node()
rclpy.try_shutdown()
sys.exit(0 if heard else 3)
"""


def check_shared_memory() -> Finding:
    """Size of /dev/shm, over which images travel between processes."""
    if not SHARED_MEMORY.is_dir():
        return warn("no /dev/shm: images go over UDP", "mount a tmpfs at /dev/shm")
    usage = shutil.disk_usage(SHARED_MEMORY)
    found = f"/dev/shm has {usage.free >> 20} of {usage.total >> 20} MiB free"
    if usage.free >> 20 < LITTLE_SHARED_MEMORY:
        return warn(found, "free it, or start the container with --shm-size=1g")
    return ok(found)


def check_leftovers() -> Finding:
    """Segments that killed processes left behind."""
    stale = leftovers(SHARED_MEMORY)
    size = sum(path.stat().st_size for path in stale) >> 20
    if size >= MUCH_LEFT_OVER:
        remedy = "the next `panoptic run` or `record` of this user removes them"
        return warn(f"{len(stale)} files of killed processes in /dev/shm, {size} MiB", remedy)
    return ok(f"{len(stale)} files of killed processes in /dev/shm ({size} MiB)")


def check_multicast() -> Finding:
    """Whether this host hears its own multicast: without it nodes on other hosts are not found."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.settimeout(1.0)
        receiver.bind(("", 0))
        group = socket.inet_aton(MULTICAST_GROUP) + socket.inet_aton("0.0.0.0")
        try:
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                sender.sendto(b"panoptic", (MULTICAST_GROUP, receiver.getsockname()[1]))
            receiver.recv(16)
        except OSError as error:
            return warn(
                f"no multicast ({error}): nodes on other hosts are not found",
                "allow UDP multicast to 239.255.0.1, or name the hosts in ROS_STATIC_PEERS",
            )
    return ok(f"multicast to {MULTICAST_GROUP} is heard")


def check_graph() -> Finding:
    """Whether a message gets from one process to another."""
    domain = os.environ.get("ROS_DOMAIN_ID", "0") or "0"
    if not domain.isdigit() or int(domain) > 232:
        return fail(f"ROS_DOMAIN_ID={domain}", "choose a number from 0 to 101")
    reach = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET").upper()
    if reach == "OFF":
        return fail("ROS_AUTOMATIC_DISCOVERY_RANGE=OFF: nodes do not find each other", "set it to LOCALHOST")
    topic = f"panoptic_doctor/process_{os.getpid()}"
    speaker = start_python(_TALK, "speaker", topic, "20")
    listener = finish(start_python(_TALK, "listener", topic, "10"), timeout_s=25)
    if speaker.poll() is None:
        speaker.terminate()
    spoken = finish(speaker, timeout_s=10)
    where = f"domain {domain}, range {reach}"
    if listener.succeeded:
        return ok(f"two processes found each other ({where})")
    if listener.last_error or spoken.last_error:
        broken = listener.last_error or spoken.last_error
        return fail(f"a node broke: {broken}", "mend what fails above first")
    return fail(
        f"no message from one process to another within 10 s ({where})",
        "try ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST or FASTDDS_BUILTIN_TRANSPORTS=UDPv4",
    )


NETWORK_CHECKS: dict[str, Check] = {
    "shared memory": check_shared_memory,
    "leftovers": check_leftovers,
    "multicast": check_multicast,
    "graph": check_graph,
}
