"""Defines all checks of `panoptic doctor`, in the order of the report.

The checks cover Python, packages, models, video, disk, cameras, inference speed, and the network between
nodes (shared memory, multicast, a small graph). The ROS checks come from `doctor.ros`. The inference check
measures the default network with every execution provider, in milliseconds. A check imports its subject
inside its function, so that a missing package becomes a finding.
"""

from __future__ import annotations

import importlib.metadata
import os
import platform
import shutil
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from panoptic_ros.detection.model import DetectorModel
from panoptic_ros.errors import BackendError, UserError
from panoptic_ros.io.resources import cache_folder
from panoptic_ros.io.takes import OPEN, UnclosedTake, unclosed_take, unclosed_takes
from panoptic_ros.running.doctor.finding import Check, Finding, fail, finish, ok, start_python, warn
from panoptic_ros.running.doctor.ros import ROS_CHECKS
from panoptic_ros.running.processes.shared_memory import SHARED_MEMORY, leftovers

PROVIDERS = {  # execution providers of onnxruntime by their common names
    "CPU": "CPUExecutionProvider",
    "CUDA": "CUDAExecutionProvider",
    "TensorRT": "TensorrtExecutionProvider",
    "OpenVINO": "OpenVINOExecutionProvider",
}
SIZE = (256, 320)  # network input size, px (height, width): a region with one or two people
RUNS = 5  # timed runs; the minimum counts, as other processes may load the machine
GAIN = 1.2  # minimum speed-up over the CPU before another provider is recommended

Timer = Callable[[DetectorModel, str], float]  # returns the time of one run with a provider, ms
SUPPORTED = ((3, 10), (3, 13))  # first and last supported minor version of Python
PACKAGES = ("numpy", "scipy", "onnxruntime", "onnx", "rosbags", "PyYAML", "numba", "matplotlib")
# GB; less free space is a warning or a failure, as recordings and the download of a model need it
LITTLE_SPACE, NO_SPACE = 2.0, 0.3
LITTLE_SHARED_MEMORY = 256  # MiB; less free space causes a warning; Docker's default is 64
MUCH_LEFT_OVER = 64  # MiB; more left-over memory causes a warning
MULTICAST_GROUP = "239.255.0.1"  # multicast group of DDS discovery

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
    """Check the free space in /dev/shm, which carries images between processes."""
    if not SHARED_MEMORY.is_dir():
        return warn("no /dev/shm: images go over UDP", "mount a tmpfs at /dev/shm")
    usage = shutil.disk_usage(SHARED_MEMORY)
    found = f"/dev/shm has {usage.free >> 20} of {usage.total >> 20} MiB free"
    if usage.free >> 20 < LITTLE_SHARED_MEMORY:
        return warn(found, "free it, or start the container with --shm-size=1g")
    return ok(found)


def check_leftovers() -> Finding:
    """Check for shared-memory segments of killed processes."""
    stale = leftovers(SHARED_MEMORY)
    size = sum(path.stat().st_size for path in stale) >> 20
    if size >= MUCH_LEFT_OVER:
        remedy = "the next `panoptic run` or `record` of this user removes them"
        return warn(f"{len(stale)} files of killed processes in /dev/shm, {size} MiB", remedy)
    return ok(f"{len(stale)} files of killed processes in /dev/shm ({size} MiB)")


def check_multicast() -> Finding:
    """Check that this host receives its own multicast.

    Without multicast, nodes do not find nodes on other hosts.
    """
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
    return ok(f"multicast to {MULTICAST_GROUP} is received")


def check_graph() -> Finding:
    """Check that a message reaches another process over ROS."""
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
        return fail(f"a node failed: {broken}", "correct the failures above first")
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


def check_python() -> Finding:
    """Check the Python version and the platform."""
    first, last = (".".join(map(str, version)) for version in SUPPORTED)
    place = "a virtual environment" if sys.prefix != sys.base_prefix else "no virtual environment"
    found = f"{platform.python_version()} on {platform.system()} {platform.machine()}, {place}"
    if not SUPPORTED[0] <= sys.version_info[:2] <= SUPPORTED[1]:
        return fail(found, f"use Python {first} to {last}")
    if (platform.system(), platform.machine()) != ("Linux", "x86_64"):
        return warn(found, "the ROS wheels are for Linux on x86_64; elsewhere build with colcon in Jazzy")
    return ok(found)


def check_packages() -> Finding:
    """Check that the required Python packages are installed."""
    versions, missing = [], []
    for name in PACKAGES:
        try:
            versions.append(f"{name} {importlib.metadata.version(name)}")
        except importlib.metadata.PackageNotFoundError:
            missing.append(name)
    if missing:
        return fail(f"missing: {', '.join(missing)}", f"./run setup, or pip install {' '.join(missing)}")
    return ok(", ".join(versions))


def check_onnxruntime() -> Finding:
    """List the execution providers of onnxruntime."""
    from panoptic_ros.detection.backends.onnx import runtime_providers

    names = (name.removesuffix("ExecutionProvider") for name in runtime_providers())
    return ok(f"providers: {', '.join(names)}")


def check_model() -> Finding:
    """Check that the default pose model is downloaded."""
    from panoptic_ros.io.models import DEFAULT_MODEL, is_cached, read_card

    try:
        source = read_card(DEFAULT_MODEL)
        if is_cached(source):
            return ok(f"{DEFAULT_MODEL} in {source.model_path}")
    except UserError as error:
        return fail(str(error), "install the package again")
    return warn(f"{DEFAULT_MODEL} is not installed yet", "panoptic models fetch")


def check_video() -> Finding:
    """Check that a video can be written and read back."""
    import av
    import numpy as np

    from panoptic_ros.capture import VideoSource
    from panoptic_ros.view.video_file import VideoFile, codec

    count, height, width = 5, 48, 64
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "check.mp4"
        with VideoFile(path, (width, height), 25.0) as video:
            for index in range(count):
                video.write(np.full((height, width, 3), 40 * index, np.uint8))
        with VideoSource("check", path) as source:
            levels = [float(frame.image.mean()) for frame in source]
    if len(levels) == count and np.allclose(levels, 40 * np.arange(count), atol=8):
        return ok(f"mp4 ({codec()}) written and read back")
    return fail(
        f"PyAV {av.__version__} read {len(levels)} of {count} frames of its own mp4",
        "python -m pip install --force-reinstall av",
    )


def check_disk() -> Finding:
    """Check the free disk space in the current folder, where results go, and in the cache."""
    places = {"here": Path.cwd(), "cache": _existing(cache_folder())}
    free = {name: shutil.disk_usage(path).free / 1e9 for name, path in places.items()}
    found = ", ".join(f"{name} {space:.1f} GB free" for name, space in free.items())
    if min(free.values()) < NO_SPACE:
        return fail(found, "make room: a recording and the download of a model need some 100 MB each")
    if min(free.values()) < LITTLE_SPACE:
        return warn(found, "make room before you record")
    return ok(found)


def check_cache() -> Finding:
    """Check that models can be stored in the cache."""
    folder = cache_folder()
    if _writable(_existing(folder)):
        return ok(f"{folder} is writable")
    return fail(f"no permission to write in {folder}", "set PANOPTIC_CACHE to a folder of your own")


def check_kernels() -> Finding:
    """Check that the files of compiled kernels are intact."""
    from panoptic_ros import kernels  # numba takes half a second to load

    folder = kernels.cache_folder()
    damaged = kernels.damaged_files(folder)
    if damaged:
        found = f"{len(damaged)} files of compiled kernels in {folder} are cut or damaged"
        return warn(f"{found}; each is compiled again when it is needed", "panoptic warm-up")
    return ok(f"the compiled kernels in {folder} are intact")


def check_takes() -> Finding:
    """Check for live takes that no process closed."""
    takes = {take.path.resolve(): take for take in (*unclosed_takes(), *_unclosed_here())}
    if not takes:
        return ok("no interrupted recording")
    found = "; ".join(str(take) for take in takes.values())
    return warn(found, f"panoptic bag repair {next(iter(takes.values())).path}")


def _unclosed_here() -> list[UnclosedTake]:
    """Return the unclosed takes up to two levels below this folder.

    These include takes of other users and other machines.
    """
    marks = (mark for depth in ("*", "*/*") for mark in Path.cwd().glob(f"{depth}/{OPEN}"))
    return [take for mark in marks if (take := unclosed_take(mark.parent)) is not None]


def check_cameras() -> Finding:
    """Check that this user may open the video devices."""
    devices = sorted(Path("/dev").glob("video*"))
    closed = [str(device) for device in devices if not os.access(device, os.R_OK | os.W_OK)]
    if closed:
        return warn(f"no permission for {', '.join(closed)}", "join the group video and log in again")
    return ok(f"devices: {', '.join(map(str, devices)) or 'none (not needed for files and network streams)'}")


def _existing(path: Path) -> Path:
    """Return the path itself, or its nearest parent that exists."""
    return next(place for place in (path, *path.resolve().parents) if place.exists())


def _writable(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


MACHINE_CHECKS: dict[str, Check] = {
    "python": check_python,
    "packages": check_packages,
    "onnxruntime": check_onnxruntime,
    "model": check_model,
    "video": check_video,
    "disk": check_disk,
    "cache": check_cache,
    "kernels": check_kernels,
    "takes": check_takes,
    "cameras": check_cameras,
}


def run_ms(model: DetectorModel, provider: str) -> float:
    """Return the time of one run of a network, ms: the minimum of `RUNS` runs.

    An extra first run is not timed, as some providers compile in it.

    Raises:
        BackendError: if the provider cannot run the network.
    """
    from panoptic_ros.detection.backends.choice import open_network

    network = open_network(model.card, model.onnx_bytes, (provider,))
    if network.providers[:1] != (provider,):
        raise BackendError(f"{provider} could not be loaded; onnxruntime fell back to {network.providers[0]}")
    tensor = np.zeros((1, *SIZE, 3), np.uint8)
    times = []
    for _ in range(1 + RUNS):
        start = time.perf_counter()
        network.run(tensor)
        times.append(1e3 * (time.perf_counter() - start))
    return min(times[1:])


def check_inference() -> Finding:
    """Measure the default network with every available execution provider."""
    from panoptic_ros.detection.backends.choice import available_providers
    from panoptic_ros.io.models import DEFAULT_MODEL, is_cached, load_detector, read_card

    if not is_cached(read_card(DEFAULT_MODEL)):
        return warn(f"{DEFAULT_MODEL} is not installed yet, so nothing was measured", "panoptic models fetch")
    model = load_detector(DEFAULT_MODEL)
    return judged(model.card.name, *measured(model, available_providers(), run_ms))


def measured(
    model: DetectorModel, available: Sequence[str], timer: Timer
) -> tuple[dict[str, float], dict[str, str]]:
    """Measure a network with all providers.

    Args:
        available: onnxruntime names of the installed providers.
        timer: measures one provider, ms.

    Returns:
        times, ms, by provider name, and for each of the others the reason why it was not measured.
    """
    times: dict[str, float] = {}
    unmeasured: dict[str, str] = {}
    for name, provider in PROVIDERS.items():
        if provider not in available:
            unmeasured[name] = "not installed"
            continue
        try:
            times[name] = timer(model, provider)
        except BackendError as error:
            unmeasured[name] = str(error)
    return times, unmeasured


def judged(model: str, times: Mapping[str, float], unmeasured: Mapping[str, str]) -> Finding:
    """Return the finding about inference.

    It lists the measured and unmeasured providers, and recommends a provider that beats the CPU by the factor
    `GAIN`.
    """
    told = ", ".join(f"{name} {ms:.1f} ms" for name, ms in sorted(times.items(), key=lambda row: row[1]))
    found = f"{model} on {SIZE[1]} x {SIZE[0]} px: {told or 'nothing runs it'}"
    if unmeasured:
        found += f"; unmeasured: {', '.join(f'{name} ({why})' for name, why in unmeasured.items())}"
    if not times:
        return warn(found, "python -m pip install --force-reinstall onnxruntime")
    best = min(times, key=lambda name: times[name])
    if best == "CPU" or GAIN * times[best] > times.get("CPU", np.inf):
        return ok(found)
    choice = f"{PROVIDERS[best]},{PROVIDERS['CPU']}"
    return warn(found, f"--set detection.providers={choice}, unless the device is for something else")


CHECKS: dict[str, Check] = {
    **MACHINE_CHECKS,
    "inference": check_inference,
    **ROS_CHECKS,
    **NETWORK_CHECKS,
}
