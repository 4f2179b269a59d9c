"""Images of cameras that measure depth wait for their depth maps."""
from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import Any, NamedTuple

SAME_NS = 8_000_000  # an image and a depth map whose stamps differ less belong together


class Pair(NamedTuple):
    """An image with its depth map, None = it has none."""

    camera: str
    stamp_ns: int
    image: Any
    depth: Any | None


class DepthPairing:
    """Puts images and depth maps together by their stamps; the images of a camera stay in order.

    What belongs together does not depend on which of the two topics is faster. An image waits until its depth
    map or a later one has come, the depth has ended, or an image has come that is later by more than the
    patience.

    Args:
        cameras: that have depth; the images of others do not wait.
        patience_ns: of images, and so long depth maps are kept for one; None = for ever (replay).
    """

    def __init__(self, cameras: Iterable[str], patience_ns: int | None):
        self._images: dict[str, deque[tuple[int, Any]]] = {camera: deque() for camera in cameras}
        self._depths: dict[str, deque[tuple[int, Any]]] = {camera: deque() for camera in self._images}
        self._over: set[str] = set()  # cameras whose depth has ended
        self._patience = patience_ns

    @property
    def cameras(self) -> set[str]:
        """Those whose images wait."""
        return set(self._images)

    def image(self, camera: str, stamp_ns: int, image: Any) -> list[Pair]:
        """An image has come; the pairs that are ready now."""
        if camera not in self._images:
            return [Pair(camera, stamp_ns, image, None)]
        self._images[camera].append((stamp_ns, image))
        late = None if self._patience is None else stamp_ns - self._patience
        return self._ready(camera, late)

    def depth(self, camera: str, stamp_ns: int, depth: Any) -> list[Pair]:
        """A depth map has come; the pairs that are ready now."""
        if camera not in self._images:
            return []
        depths = self._depths[camera]
        if self._patience is not None:  # those of a camera whose images fail must not pile up
            while depths and not 0 <= stamp_ns - depths[0][0] <= self._patience:
                depths.popleft()
        depths.append((stamp_ns, depth))
        return self._ready(camera, None)

    def end(self, camera: str) -> list[Pair]:
        """The camera gives no more depth maps: no image waits any more, those to come take what there is."""
        self._over.add(camera)
        return self._ready(camera, None) if camera in self._images else []

    def _ready(self, camera: str, late: int | None) -> list[Pair]:
        images, depths = self._images[camera], self._depths[camera]
        pairs: list[Pair] = []
        while images:
            stamp, image = images[0]
            found = _of(depths, stamp)
            waits = late is None or stamp >= late
            if found is None and not depths and waits and camera not in self._over:
                break
            images.popleft()
            pairs.append(Pair(camera, stamp, image, found))
        return pairs


def _of(depths: deque[tuple[int, Any]], stamp_ns: int) -> Any | None:
    """The first depth map that belongs to an image; takes it and earlier ones out."""
    while depths and depths[0][0] < stamp_ns - SAME_NS:
        depths.popleft()
    if depths and depths[0][0] <= stamp_ns + SAME_NS:
        return depths.popleft()[1]
    return None
