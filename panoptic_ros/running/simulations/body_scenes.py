"""Defines the simulated body scenes by name."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from panoptic_ros.simulation.bodies.capture import BodyScene

BODY_SCENES = {  # {name: description}
    "body-punch": "a body with 8 cameras and 13 IMUs: punches and kicks",
    "body-wash": "the same: standing gestures",
    "body-walk": "the same: walking on uneven ground",
    "body-shake": "the same: walking and shaking hands",
    "body-jog": "the same: walking, jogging, jumping",
    "body-t-pose": "the same as body-punch; mounting from a T-pose, 4 degrees off per joint and axis",
}
# further scenes with less information: unknown headings, clocks or mountings, other people, or few views
OTHER_BODY_SCENES = {
    "body-heading": "the same as body-shake; the heading of the IMUs is unknown",
    "body-clocks": "the same as body-jog; the clock of the IMUs is up to 60 ms off",
    "body-strapped": "the same as body-wash; heading unknown, clock off, mounting from a T-pose",
    "body-pair": "two subjects with 13 IMUs each, and a bystander who walks between them",
    "body-crowd": "the same in less room, two bystanders; headings unknown, clocks off, mountings from "
    "T-poses",
    "body-leaves": "walking and jogging out of the sight of most of 8 cameras and back, twice",
}
SECONDS = 19.0
_CLIPS: dict[str, tuple[str, ...]] = {
    "body-punch": ("02_05",),
    "body-wash": ("02_10",),
    "body-walk": ("03_01", "03_02"),
    "body-shake": ("18_01",),
    "body-jog": ("02_01", "02_03", "02_04", "02_02"),
    "body-t-pose": ("02_05",),
    "body-heading": ("18_01",),
    "body-clocks": ("02_01", "02_03", "02_04", "02_02"),
    "body-strapped": ("02_10",),
    "body-pair": ("02_05",),
    "body-crowd": ("02_05",),
    "body-leaves": ("02_01", "02_02", "02_03", "02_01"),
}
_UNKNOWN: dict[str, Any] = {"heading": 180.0, "clock": 0.06, "mounts": False}
_MORE: dict[str, dict[str, Any]] = {
    "body-t-pose": {"mounts": False, "t_pose": 4.0},
    "body-heading": {"heading": 180.0},
    "body-clocks": {"clock": 0.06},
    "body-strapped": _UNKNOWN,
    "body-pair": {"at": (0.0, -0.9), "facing": 50.0},
    "body-crowd": {"at": (0.0, -0.65), "facing": 50.0, **_UNKNOWN},
    "body-leaves": {"path": (0.0, 180.0, 0.0, 180.0), "at": (1.5, 0.0), "focal": 1500.0},
}


def body_scene(name: str) -> BodyScene:
    """Return the scene of a name in `BODY_SCENES` or `OTHER_BODY_SCENES`."""
    from panoptic_ros.simulation.bodies.capture import BodyScene  # numba is slow to load

    found = BodyScene(_CLIPS[name], seconds=SECONDS, **_MORE.get(name, {}))
    if name not in ("body-pair", "body-crowd"):
        return found
    second = replace(found, clips=("02_10",), at=(0.3, -found.at[1]), facing=-100.0)
    walks: dict[str, Any] = {"clips": ("03_01", "03_02") * 2, "path": (0.0, 180.0) * 2, "designated": False}
    between, aside = (
        BodyScene(at=at, facing=facing, **walks) for at, facing in (((-1.1, 0.0), 0.0), ((1.3, -1.6), 90.0))
    )
    return replace(found, others=(second, between) if name == "body-pair" else (second, between, aside))
