"""What all tests share: builders in test/support, and settings for ROS that disturb nobody."""
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "support"))
os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
os.environ.setdefault("ROS_DOMAIN_ID", str(20 + os.getpid() % 80))  # a domain of one's own
os.environ.setdefault("OMP_NUM_THREADS", "1")
