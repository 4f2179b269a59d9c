"""The ranks of the house and a checker for them; see docs/architecture.md."""

from __future__ import annotations

import ast
from pathlib import Path

STAGES = (
    "detection",
    "timecode",
    "calibration",
    "clocks",
    "sync",
    "offsets",
    "association",
    "voting",
    "assembly",
    "tracking",
    "health",
    "appearance",
    "patches",
    "refinement",
    "kinematics",
    "continuous",
    "simulation",
    "evaluation",
)
RANKS: dict[str, int] = {
    "errors": 0,
    "kernels": 0,
    "geometry": 1,
    "params": 1,
    "state": 1,
    "domain": 2,
    "stage": 3,
    "solving": 3,
    "identity": 3,
    "stamps": 3,
    **{stage: 4 for stage in STAGES},
    "io": 5,
    "capture": 5,
    "export": 5,
    "graph": 5,
    "nodes": 6,
    "view": 6,
    "running": 7,
    "study": 8,
    "cli": 9,
}
# kernels is free to find the cache of compiled code, on which no result depends
PURE = 4  # up to this rank, and graph: no printing, files, clocks, environment, global randomness
THIRD_PARTY: dict[str, set[str]] = {
    **{room: set() for room in ("errors", "params", "stage")},
    "kernels": {"numpy", "numba"},
    "geometry": {"numpy", "scipy", "cv2"},  # the last in optical_flow
    "state": {"numpy"},
    "domain": {"numpy"},
    **{name: {"numpy", "scipy", "cv2"} for name in STAGES},
    "solving": {"numpy"},
    "identity": {"numpy", "scipy"},
    "stamps": {"numpy"},
    "graph": {"numpy"},
    "io": {"numpy", "scipy", "cv2", "yaml", "rosbags", "onnx", "tomli", "backports", "compression"},
    "capture": {"numpy", "cv2", "av"},
    "export": {"numpy", "websockets"},  # the last for the live stream of bodies
    "view": {"numpy", "cv2", "av", "matplotlib", "mpl_toolkits", "rich", "websockets"},  # the last in page/
    "nodes": {"numpy", "scipy", "rclpy", "rcl_interfaces"},
    "study": {"numpy", "scipy", "cv2", "av", "rclpy", "websockets"},
    "running": {"numpy", "cv2", "av", "rclpy", "websockets"},  # those of the doctor among them
    "cli": set(),
}
THIRD_PARTY["detection"] = THIRD_PARTY["detection"] | {"onnxruntime"}  # in backends/
STANDARD_IMPURE = {"logging", "time", "datetime", "os", "random", "subprocess", "socket"}
IMPURE_CALLS = {"print", "open", "input"}
# outside of nodes: the only modules that import it
_NEED = (
    "calibration.live",
    "calibration.live_cameras",
    "plans.driver_plan",
    "processes.fork_server",
    "recordings.control",
    "recordings.facts",
    "recordings.record",
    "recordings.replay",
    "runs.listening",
    "runs.over_dds",
    "viewer.live",
    "watching",
)
_FED = (
    "bodies.fed_bodies",
    *(f"live.{n}" for n in ("failures", "fed_graph", "played_graph", "player", "viewed_graph")),
)
NEED_ROS = {f"panoptic_ros.running.{name}" for name in _NEED} | {
    f"panoptic_ros.study.{name}" for name in _FED
}
# A verb parses, calls running (or a study), and prints the records, tables and plots that come back: it knows
# no stage, no graph and no arrays.
THIN = {"errors", "domain", "stage", "io", "view", "running", "study"}
LONGEST_VERB = 100  # statements of a module of cli, which parses and prints only
# a capture folder holds files that io reads, and the correction of timestamps tells notices; not the reverse
SAME_RANK_ALLOWED = {("capture", "io"), ("stamps", "stage")}
# Rooms inside of a room: each imports itself and those before it. Modules beside them import all.
INNER_ROOMS = {
    "timecode": ("config", "signal", "word", "label", "follow"),
    "kinematics": ("config", "pose", "imus", "body", "people"),
    "nodes": ("middleware", "health", "stages", "listeners", "sources"),
}


def room_of(module: str) -> str:
    """ "voting" of "panoptic_ros.voting.stage"; "" for the package itself."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else ""


def violations(module: str, source: str, standard: frozenset[str]) -> list[str]:
    """What a module does against the rules of its room, one line each."""
    room = room_of(module)
    if room not in RANKS:
        return [f"{module}: the room {room!r} has no rank"]
    found = []
    tree = ast.parse(source)
    pure = (RANKS[room] <= PURE or room == "graph") and room != "kernels"
    if room == "cli":
        found += _check_thin(module, source, tree)
    for node in ast.walk(tree):
        for target in _imported(node, module):
            found += _check_import(module, room, target, pure, standard)
        if pure and isinstance(node, ast.Call):
            found += _check_call(module, node)
        if room == "running" and isinstance(node, ast.Call) and _name(node.func) == "print":
            found.append(f"{module}: prints; give it to the caller, cli prints")
    return found


def _check_thin(module: str, source: str, tree: ast.Module) -> list[str]:
    """What a module of cli does beyond parsing, calling and printing."""
    count = sum(isinstance(node, ast.stmt) for node in ast.walk(tree))
    found = [f"{module}: {count} statements, more than {LONGEST_VERB}"] if count > LONGEST_VERB else []
    for node in ast.walk(tree):
        for target in _imported(node, module):
            other = room_of(target) if target.split(".")[0] == "panoptic_ros" else ""
            if other in RANKS and other not in THIN | {"cli"}:
                found.append(f"{module}: imports {target}; let running call it")
    return found


def _imported(node: ast.AST, module: str) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        base = node.module or ""
        if node.level:
            package = module.split(".")[: -node.level]
            base = ".".join([*package, base] if base else package)
        if base == "panoptic_ros":
            return [f"panoptic_ros.{alias.name}" for alias in node.names]
        return [base]
    return []


def _check_import(module: str, room: str, target: str, pure: bool, standard: frozenset[str]) -> list[str]:
    top = target.split(".")[0]
    if top == "panoptic_ros":
        other = room_of(target)
        if other == room:
            return _check_inner(module, room, target)
        if other in ("", "__version__"):
            return []
        if other == "nodes" and module not in NEED_ROS:
            return [f"{module}: imports {target}, which needs ROS"]
        if other not in RANKS:
            return [f"{module}: imports {target}, a room without a rank"]
        if RANKS[other] >= RANKS[room] and (room, other) not in SAME_RANK_ALLOWED:
            return [f"{module}: rank {RANKS[room]} imports {target} of rank {RANKS[other]}"]
        return []
    if top in standard:
        return [f"{module}: imports {top} in a pure room"] if pure and top in STANDARD_IMPURE else []
    if top == "rclpy" and room == "running" and module not in NEED_ROS:
        return [f"{module}: imports {top}, which needs ROS"]
    return [] if top in THIRD_PARTY[room] else [f"{module}: imports {top}, not allowed in {room}"]


def _check_inner(module: str, room: str, target: str) -> list[str]:
    order = INNER_ROOMS.get(room, ())
    here, there = ((*name.split("."), "", "")[2] for name in (module, target))
    if here not in order or (there in order and order.index(there) <= order.index(here)):
        return []
    return [f"{module}: the room {here} of {room} imports {target}, which is not before it"]


def _name(called: ast.expr) -> str:
    """`np.random.normal` of its tree; what comes before a call or an index in it is left out."""
    if isinstance(called, ast.Attribute):
        return f"{_name(called.value)}.{called.attr}"
    return called.id if isinstance(called, ast.Name) else ""


def _check_call(module: str, node: ast.Call) -> list[str]:
    name = _name(node.func)
    if name in IMPURE_CALLS or name.endswith((".read_text", ".write_text", ".read_bytes", ".write_bytes")):
        return [f"{module}: calls {name} in a pure room"]
    seeded = ("default_rng", "SeedSequence", "Generator", "PCG64")
    if name.startswith(("np.random.", "numpy.random.")) and not any(word in name for word in seeded):
        return [f"{module}: {name} draws from a global generator"]
    if name.endswith("default_rng") and not node.args and not node.keywords:
        return [f"{module}: {name} without a seed"]
    return []


def modules(root: Path) -> dict[str, Path]:
    """All modules of the package by name."""
    found = {}
    for path in sorted(root.rglob("*.py")):
        parts = path.relative_to(root.parent).with_suffix("").parts
        found[".".join(part for part in parts if part != "__init__")] = path
    return found
