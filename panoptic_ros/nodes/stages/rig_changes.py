"""Another /rig while the graph runs: taken over between two records, the newest if several have come."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from panoptic_ros.domain import Rig
from panoptic_ros.errors import ConfigError


class RigChanges:
    """Offers rigs that fit to the node.

    Args:
        cameras: only these are worked with; empty: all of the rig.
        note: has a function called between two records.
        change: takes a rig over; gives the stages that begin anew.
    """

    def __init__(
        self,
        node: Any,
        cameras: Sequence[str],
        note: Callable[[Callable[[], None]], None],
        change: Callable[[Rig], Sequence[str]],
    ):
        self._node, self._cameras, self._note, self._change = node, cameras, note, change
        self._next: Rig | None = None

    def offer(self, rig: Rig, now: Rig) -> None:
        """Take a rig over as soon as that is possible.

        Raises:
            ConfigError: if it has other cameras than the rig of now.
        """
        if self._named(rig) != self._named(now):
            raise ConfigError(
                f"another /rig has other cameras: restart node {self._node.get_name()} to work with it"
            )
        waits, self._next = self._next is not None, rig
        if not waits:
            self._note(self._take_over)

    def _take_over(self) -> None:
        rig, self._next = self._next, None
        assert rig is not None
        anew = self._change(rig)
        kept = f"; {', '.join(anew)} begin anew" if anew else ""
        self._node.get_logger().info(f"another /rig was taken over{kept}", throttle_duration_sec=5.0)

    def _named(self, rig: Rig) -> list[tuple[str, tuple[int, int]]]:
        wanted = self._cameras or list(rig.names)
        return [(camera.name, camera.image_size) for camera in rig.cameras if camera.name in wanted]
