"""What all tests share: builders in test/support, and settings that disturb nobody."""
import os
import sys
from pathlib import Path

from hypothesis import HealthCheck, settings

sys.path.insert(0, str(Path(__file__).parent / "support"))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_DOMAIN_ID", str(20 + os.getpid() % 80))  # a domain of one's own
os.environ.setdefault("OMP_NUM_THREADS", "1")

# Time is not what these tests assert: a kernel's first call compiles it. On a machine that decides about a
# change, the examples are the same every time.
settings.register_profile(
    "panoptic", deadline=None, suppress_health_check=[HealthCheck.too_slow],
    derandomize=bool(os.environ.get("CI")),
)  # fmt: skip
settings.load_profile("panoptic")
