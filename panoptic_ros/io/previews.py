"""Make small preview images at a reduced rate."""

from __future__ import annotations

from panoptic_ros.domain import Preview, ViewFrame

LONGEST_SIDE = 320  # px
PERIOD_NS = 100_000_000
JPEG_QUALITY = 75


class Previews:
    """Rate limiter of previews: one preview per camera, of its first image in every 0.1 s.

    The intervals come from the timestamps, so cameras with a common clock give previews of the same times.
    """

    def __init__(self) -> None:
        self._last: dict[str, int] = {}

    def is_due(self, camera: str, stamp_ns: int) -> bool:
        """Return whether an image is the first of its 0.1 s interval, and mark the interval as used."""
        tenth = stamp_ns // PERIOD_NS
        due = self._last.get(camera) != tenth
        self._last[camera] = tenth
        return due

    def take(self, frame: ViewFrame) -> Preview | None:
        """Return the preview of an image; None if none is due."""
        return make_preview(frame) if self.is_due(frame.camera, frame.stamp_ns) else None


def make_preview(frame: ViewFrame) -> Preview:
    """Return the whole image as a JPEG with a longer side of at most `LONGEST_SIDE` px."""
    import cv2  # 14 MB and 0.1 s, which a viewer of received previews need not load

    height, width = frame.image.shape[:2]
    scale = min(1.0, LONGEST_SIDE / max(height, width))
    size = max(1, round(scale * width)), max(1, round(scale * height))
    image = frame.image
    block = int(min(width / size[0], height / size[1]) / 2)
    if block > 1:  # averaging all pixels takes ten times as long as averaging four
        middle = block // 2  # sample block centres: the image then shifts by at most 0.25 px
        double = 2 * size[0], 2 * size[1]
        image = cv2.resize(image[middle:, middle:], double, interpolation=cv2.INTER_NEAREST)
    if image.shape[1::-1] != size:
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return Preview(frame.camera, frame.stamp_ns, data.tobytes())
