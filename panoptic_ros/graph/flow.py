"""The two flow modes of the graph: live and replay.

Live: the newest data come first. Queues are short and drop their oldest entry; every drop is counted.
Replay: nothing is lost, however slow the machine is. A source waits for the output of the graph: at most
`window` of its frames are under way, and every queue is longer than that. Topics keep their messages for late
subscribers, so the start order of processes does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.errors import ConfigError


@dataclass(frozen=True)
class Flow:
    """Queue settings of a node.

    Args:
        name: "live" or "replay".
        depth: Length of the middleware's queues, messages per topic.
        image_depth: The same for images.
        keeps_for_late: Whether a late subscriber still gets earlier messages.
        queue_limit: Length of the node's own queue per topic. None: no limit here.
        window: Replay: most instants of a source between it and /skeletons.
        image_window: Replay: most images of a source between it and the detector.
    """

    name: str
    depth: int
    image_depth: int
    keeps_for_late: bool
    queue_limit: int | None
    window: int = 0
    image_window: int = 0


WINDOW = 64  # instants; a detector continues while the later stages compile their kernels
IMAGE_WINDOW = 4
# s; the lag is one set at 30 Hz. Views of one instant differ in latency by less than `wait_s`.
LIVE_DEFAULTS = {
    "sync": {"deadline_s": 0.5},
    "refinement": {"lag": 0.03},
    "continuous": {"wait_s": 0.03},
}
# messages, queue limit if every message counts, e.g. audio; a limit of 2 would overflow in a busy moment
PATIENT = 256
BUSY = 64  # messages, queue limit of a stage that skips work to catch up: about a second of IMU samples
# messages, except images: none is lost in a moment without processor time. The nodes' own short queues keep
# the data recent.
LIVE_DEPTH = 8
SPARE = 8  # messages by which the middleware's queues exceed the number under way


def make_flow(name: str, window: int = WINDOW) -> Flow:
    """Return the flow of a name.

    Args:
        window: See `Flow`. It must exceed the lag of refinement, in frames.

    Raises:
        ConfigError: if there is no such flow.
    """
    if name == "live":
        return Flow("live", depth=LIVE_DEPTH, image_depth=2, keeps_for_late=False, queue_limit=2)
    if name == "replay":
        return Flow("replay", window + SPARE, IMAGE_WINDOW + SPARE, True, None, window, IMAGE_WINDOW)
    raise ConfigError(f"there is no flow {name!r}; there are live and replay")


def live_defaults(flow: str, stage: str) -> dict[str, float]:
    """Return the defaults of a stage's parameters that apply to live flow only.

    A recording waits for all of its cameras. In live flow, a failed camera must not stop the others, and
    skeletons wait for at most one more set.
    """
    return dict(LIVE_DEFAULTS.get(stage, {})) if flow == "live" else {}
