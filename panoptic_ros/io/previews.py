"""Making previews of images: small, and not of every one."""

from __future__ import annotations

from panoptic_ros.domain import Preview, ViewFrame

LONGEST_SIDE = 320  # px
PERIOD_NS = 100_000_000
JPEG_QUALITY = 75


class Previews:
    """Previews of the images of any cameras: the first image of each of them in every tenth of a second.

    The tenths are those of the stamps, so that cameras of one clock give previews of the same instants.
    """

    def __init__(self) -> None:
        self._last: dict[str, int] = {}

    def is_due(self, camera: str, stamp_ns: int) -> bool:
        """Whether the image of that stamp is the first of its tenth; it counts as shown then."""
        tenth = stamp_ns // PERIOD_NS
        due = self._last.get(camera) != tenth
        self._last[camera] = tenth
        return due

    def take(self, frame: ViewFrame) -> Preview | None:
        """The preview of an image, None if it is not due."""
        return make_preview(frame) if self.is_due(frame.camera, frame.stamp_ns) else None


def make_preview(frame: ViewFrame) -> Preview:
    """The whole image as a JPEG of `LONGEST_SIDE` px or less on its longer side."""
    import cv2  # 14 MB and 0.1 s, which a viewer of what others made does without

    height, width = frame.image.shape[:2]
    scale = min(1.0, LONGEST_SIDE / max(height, width))
    size = max(1, round(scale * width)), max(1, round(scale * height))
    image = frame.image
    block = int(min(width / size[0], height / size[1]) / 2)
    if block > 1:  # the mean of all pixels costs ten times as much as that of four
        middle = block // 2  # so that nothing moves by more than .25 px
        double = 2 * size[0], 2 * size[1]
        image = cv2.resize(image[middle:, middle:], double, interpolation=cv2.INTER_NEAREST)
    if image.shape[1::-1] != size:
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return Preview(frame.camera, frame.stamp_ns, data.tobytes())
