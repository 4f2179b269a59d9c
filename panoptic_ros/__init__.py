"""Online multi-view, multi-person 3D pose as a ROS 2 node graph.

The folder tree is the architecture: see docs/architecture.md. Nothing but `os` is imported here, so that
`import panoptic_ros` costs nothing and needs neither ROS nor a model.

The import switches off the telemetry of onnxruntime, which is its only side effect. onnxruntime reads the
environment once, when it loads. Every entry point, child process and library user imports this package before
any of its modules, so the switch is set in time in all of them. Child processes inherit it. A value that the
user has set stays. `detection/backends/` holds the imports of onnxruntime and of openvino.
"""

import os

__version__ = "0.1.0"

# onnxruntime 1.29 and later on Linux: "1" prevents the uploader, the device identifier and the database.
# Its call disable_telemetry_events() comes too late: the import makes the identifier and the database.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
