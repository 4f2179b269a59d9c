"""Two rigid people who walk on circles before cameras of which each exposes at its own times."""

import captures
import numpy as np

from panoptic_ros.domain import DetectionSet, Rig, ViewDetections
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.stage import StageContext

START_NS = 1_000_000_000_000


def rig(cameras):
    angles = 2.0 * np.pi * (np.arange(cameras) + 0.2) / cameras
    return Rig(
        tuple(
            captures.look_at(f"cam{k}", (4.2 * np.cos(a), 4.2 * np.sin(a), 1.6 + 0.3 * (k % 3)))
            for k, a in enumerate(angles)
        )
    )


def people(time_s, speed=1.0):
    """(2, 19, 3) m: they walk in opposite directions on circles of 0.6 and 1.4 m."""
    angle = speed * time_s
    inner = captures.person((0.6 * np.cos(angle), 0.6 * np.sin(angle)), angle + np.pi / 2)
    outer = captures.person((1.4 * np.cos(angle), -1.4 * np.sin(angle)), -angle - np.pi / 2)
    return np.stack([inner, outer])


class FreeCapture:
    """Recording of one view per set, with the truth.

    Args:
        rate: (Hz) of each camera; their phases are evenly apart.
        offsets, drifts, lines: (C,) s, s/s and s per row of the cameras' clocks and shutters.
        there: function of person and time; whether the person is there.
        spoil: function of the pixels (2, 19, 2), the generator and the camera; changes them in place.
    """

    def __init__(
        self,
        cameras=6,
        rate=10.0,
        seconds=4.0,
        noise_px=0.7,
        speed=1.0,
        offsets=None,
        drifts=None,
        lines=None,
        there=lambda person, time: True,
        spoil=lambda pixels, rng, camera: None,
    ):
        self.rig, self.speed, self.seconds = rig(cameras), speed, seconds
        self.context = StageContext(self.rig, captures.SKELETON)
        zero = np.zeros(cameras)
        offsets, drifts, lines = (zero if v is None else np.asarray(v) for v in (offsets, drifts, lines))
        rng = np.random.default_rng(7)
        views = []
        for c, camera in enumerate(self.rig.cameras):
            for k in range(int(seconds * rate)):
                time = (k + (c * 5 % cameras + 0.5) / cameras) / rate
                pixels = self._pixels(camera, time, lines[c])
                pixels += noise_px * rng.standard_normal(pixels.shape)
                spoil(pixels, rng, c)
                present = [p for p in range(2) if there(p, time)]
                rng.shuffle(present)
                # time = stamp + offset + drift * (stamp - start)
                stamp = START_NS + round(1e9 * (time - offsets[c]) / (1.0 + drifts[c]))
                views.append((stamp, camera, pixels[present]))
        views.sort(key=lambda view: view[0])
        self.sets = [self._set(i, *view) for i, view in enumerate(views)]
        self.recording = InMemoryRecording({"detection_sets": self.sets})

    def joints(self, time_s):
        return people(time_s, self.speed)

    def _pixels(self, camera, time, line):
        pixels = np.stack([camera.project(body)[0] for body in self.joints(time)])
        for _ in range(3 if line else 0):
            for p in range(2):
                for j in range(19):
                    body = self.joints(time + line * pixels[p, j, 1])[p]
                    pixels[p, j] = camera.project(body[j : j + 1])[0][0]
        return pixels

    def _set(self, index, stamp, camera, points):
        points = points[np.isfinite(points).any(axis=(1, 2))]  # a camera does not see people behind it
        scores = np.where(np.isfinite(points).all(axis=-1), 0.9, 0.0)
        view = ViewDetections(
            camera.name,
            stamp,
            index,
            camera.image_size,
            captures.SKELETON.hash,
            points,
            scores,
            scores.mean(axis=1),
        )
        return DetectionSet(index, stamp, captures.SKELETON.hash, (view,))

    def errors(self, motion, times, shift_s=0.0):
        """(P, T, 19) m: errors of the two people at times in s; NaN where somebody is not reported."""
        stamps = [START_NS + round(1e9 * time) for time in times]
        found = np.full((2, len(times), 19), np.nan)
        for t, item in enumerate(motion.sets(stamps)):
            truth = self.joints(times[t] + shift_s)
            for body in item.positions:
                gaps = np.linalg.norm(truth - body, axis=-1)
                nearest = int(np.nanmean(gaps, axis=1).argmin())
                found[nearest, t] = gaps[nearest]
        return found


class CaptureWithBystander(FreeCapture):
    """The second person stands behind the first of five cameras, where only two of them look."""

    def joints(self, time_s):
        body, angle = super().joints(time_s)[0], 0.2 * 2.0 * np.pi / 5
        behind = 6.3 * np.array([np.cos(angle), np.sin(angle)])
        return np.stack([body, captures.person(tuple(behind), 0.3 * np.sin(time_s))])
