"""Online multi-view, multi-person 3D pose as a ROS 2 node graph.

The folder tree is the architecture: see docs/architecture.md. The names of `__all__` are the public Python
API, and README shows its use. Each is imported from its module on first access. So `import panoptic_ros`
costs nothing and needs neither ROS nor a model, and caches of kernels do not depend on all modules.

The import switches off the telemetry of onnxruntime, which is its only side effect. onnxruntime reads the
environment once, when it loads. Every entry point, child process and library user imports this package before
any of its modules, so the switch is set in time in all of them. Child processes inherit it. A value that the
user has set stays. `detection/backends/` holds the imports of onnxruntime and of openvino.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import Any

__all__ = [
    "PanopticError",
    "Person",
    "Rig",
    "UserError",
    "load_rig",
    "open_capture",
    "open_detections",
    "run",
    "solve",
    "write_skeletons",
]
__version__ = "0.1.0"

# modules of those public names that are not in running.api
_MODULES = {"PanopticError": "errors", "Person": "domain", "Rig": "domain", "UserError": "errors"}

# onnxruntime 1.29 and later on Linux: "1" prevents the uploader, the device identifier and the database.
# A call of disable_telemetry_events() comes too late: the import makes the identifier and the database.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")


def __getattr__(name: str) -> Any:
    """Import a public name on its first access.

    Raises:
        AttributeError: if there is no such name.
    """
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES.get(name, 'running.api')}"), name)


def __dir__() -> list[str]:
    """Return the public names, including those that are not imported yet."""
    return sorted({*globals(), *__all__})
