"""The two ways in which data flow through the graph, in one place.

Live: newest first. Queues are short and drop the oldest; every drop is counted.
Replay: nothing is lost however slow the machine. Sources wait for what comes out: a source has at
most `window` frames under way, and every queue is longer than that. Topics keep their messages for
readers that are matched late, so nothing depends on the order in which processes start.
"""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.errors import ConfigError


@dataclass(frozen=True)
class Flow:
    """How one node queues.

    Args:
        name: "live" or "replay".
        depth: of the middleware's queues, messages per topic; image_depth: the same for images.
        keeps_for_late: whether a reader that is matched late still gets what was sent before.
        queue_limit: of the node's own queue per topic; None: not limited here.
        window: replay: instants that a source may have under way between it and /skeletons.
        image_window: replay: images that it may have under way between it and the detector.
    """

    name: str
    depth: int
    image_depth: int
    keeps_for_late: bool
    queue_limit: int | None
    window: int = 0
    image_window: int = 0


WINDOW = 64  # instants: a detector runs on while the stages after it compile their kernels
IMAGE_WINDOW = 4
LIVE_DEFAULTS = {"sync": {"deadline_s": 0.5}, "refinement": {"lag": 0.03}}  # lag: one set at 30 Hz
PATIENT = 256  # messages: of sound every block counts, and a busy moment is longer than two
BUSY = 64  # messages for a stage that catches up by itself: samples of an IMU of about a second
LIVE_DEPTH = 8  # messages without images: a moment without a processor loses none; own queues keep them new
SPARE = 8  # the middleware's queues are longer than what can be under way


def make_flow(name: str, window: int = WINDOW) -> Flow:
    """The flow of that name.

    Args:
        window: see `Flow`; must exceed the lag of refinement, in frames.

    Raises:
        ConfigError: if there is no such flow.
    """
    if name == "live":
        return Flow("live", depth=LIVE_DEPTH, image_depth=2, keeps_for_late=False, queue_limit=2)
    if name == "replay":
        return Flow("replay", window + SPARE, IMAGE_WINDOW + SPARE, True, None, window, IMAGE_WINDOW)
    raise ConfigError(f"there is no flow {name!r}; there are live and replay")


def live_defaults(flow: str, stage: str) -> dict[str, float]:
    """Defaults of a stage's parameters that hold in live flow only.

    A recording waits for all of its cameras; live, one that fails must not stop the others, and skeletons
    wait for one more set at most.
    """
    return dict(LIVE_DEFAULTS.get(stage, {})) if flow == "live" else {}
