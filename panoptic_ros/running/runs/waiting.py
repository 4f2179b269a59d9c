"""What a run waits for that gives nothing yet."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

from panoptic_ros.graph.nodes import NODES


class Waiting:
    """Tells a person who sees nothing happen why, once.

    Args:
        tell: called with the text, on a thread of its own.
    """

    def __init__(self, tell: Callable[[str], None]):
        self._tell = tell
        self._timer: threading.Timer | None = None
        self.counted: Mapping[str, Mapping[str, str]] = {}  # what nodes tell on /diagnostics

    def begin(self, seconds: float) -> None:
        """Wait so long from now, if nobody waits already."""
        if self._timer is None:
            self._timer = threading.Timer(seconds, lambda: self._tell(why_waiting(dict(self.counted))))
            self._timer.daemon = True
            self._timer.start()

    def end(self) -> None:
        """There is something to see."""
        if self._timer is not None:
            self._timer.cancel()


def why_waiting(counted: Mapping[str, Mapping[str, str]]) -> str:
    """What the first skeletons wait for, as nodes tell on /diagnostics: the first stage that waits."""
    waits = [name for name, values in counted.items() if values.get("waiting_for")]
    if waits and not any(values.get("compiling") for values in counted.values()):
        first = min(waits, key=stage_order)
        return (
            f"waiting for the first skeletons: {first} waits for {counted[first]['waiting_for']}; "
            "`panoptic watch` shows more"
        )
    return (
        "waiting for the first skeletons: kernels are compiled once after an installation, which takes about "
        "a minute"
    )


def stage_order(name: str) -> int:
    """Return the place of a node in the graph by its name, e.g. detection_0; other nodes come last."""
    stage = name if name in NODES else name.rsplit("_", 1)[0]
    return list(NODES).index(stage) if stage in NODES else len(NODES)
