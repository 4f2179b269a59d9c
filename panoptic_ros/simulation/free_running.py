"""Captures of free-running cameras: every view has its own timestamp, and the truth is exact at any instant.

True time is in s since the start. Cameras have their own rates, phases, clocks and line delays. The detector
of each camera is the `SimulatedDetector`, with noise that persists for a time instead of a number of frames.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from panoptic_ros.domain import Camera, DetectionSet, Rig, ViewDetections
from panoptic_ros.errors import UsageError
from panoptic_ros.simulation.degradation import Degradation
from panoptic_ros.simulation.detector import Sightings, SimulatedDetector
from panoptic_ros.simulation.people import SimulatedPerson
from panoptic_ros.simulation.rigs import RigPlan
from panoptic_ros.simulation.skeleton import JOINTS, SKELETON

Array = np.ndarray
START_NS = 1_800_000_000_000_000_000  # timestamp of true time 0 on a clock without offset
NOISE_MEMORY_S = 0.25  # s, correlation time of the persistent part of the detector's noise
ROW_STEPS = 3  # iterations of the exposure time of a joint, which depends on the row where it is seen
NOBODY = -1  # owner of a 2D person that no true person caused

Cast = Callable[[np.random.Generator, float], Sequence[SimulatedPerson]]  # seed, duration (s) -> people


@dataclass(frozen=True)
class FreeRunning:
    """Timing of free-running cameras. The first camera has an exact clock.

    Args:
        rates: Frame rates (Hz), assigned to the cameras in rotation.
        staggered: Whether phases are evenly apart. Otherwise they are random.
        jitter_s: Standard deviation of timestamp minus exposure, s.
        lost: Share of frames that are lost.
        offset_s: Limit of the clock offsets, s.
        drift_ppm: Limit of the rate errors of the clocks, ppm.
        line_delays_us: Range of the line delays (us per row) of rolling shutters.
        global_every: Number n: cameras 0, n, 2 n, ... have a global shutter; 1 = all cameras.
    """

    rates: tuple[float, ...]
    staggered: bool = False
    jitter_s: float = 1e-4
    lost: float = 0.01
    offset_s: float = 0.0
    drift_ppm: float = 0.0
    line_delays_us: tuple[float, float] = (15.0, 30.0)
    global_every: int = 1


@dataclass(frozen=True)
class FreeRunningScene:
    """Scene of a capture. It defines everything except the seed."""

    name: str  # part of the seed, so that two scenes of the same seed differ
    about: str  # purpose in a few words
    cast: Cast
    rig: RigPlan
    timing: FreeRunning
    degradation: Degradation
    seconds: float


@dataclass(frozen=True)
class CameraTiming:
    """True timing of a camera.

    A frame at true time t has the timestamp START_NS + (t - offset_s) / (1 + drift), in s. So true time =
    offset_s + (1 + drift) * (time shown since START_NS).

    Args:
        rate: Hz.
        phase_s: True time of the first exposure, s.
        offset_s, drift: Offset (s) and relative rate error of the clock.
        line_s: Line delay, s per row. The timestamp is that of the first row.
    """

    rate: float
    phase_s: float
    offset_s: float = 0.0
    drift: float = 0.0
    line_s: float = 0.0

    def stamp_ns(self, seconds: float) -> int:
        """Return the time (ns) that the clock shows at a true time (s)."""
        return START_NS + round(1e9 * (seconds - self.offset_s) / (1.0 + self.drift))


@dataclass(frozen=True, eq=False)
class TimedView:
    """2D people of one view with their truth.

    Args:
        view: 2D people.
        camera: Index into the rig.
        seconds: True time of the exposure, of the first row with a rolling shutter.
        owners: (D,) index of the true person of each 2D person, `NOBODY` = false, duplicate.
    """

    view: ViewDetections
    camera: int
    seconds: float
    owners: Array


@dataclass(frozen=True)
class _RowByRow(SimulatedPerson):
    """Person as a camera with a rolling shutter sees it: each joint at the exposure time of its row."""

    whole: SimulatedPerson = field(kw_only=True)
    camera: Camera = field(kw_only=True)
    line_s: float = field(kw_only=True)

    def joints(self, t: Array) -> Array:
        """See `SimulatedPerson`; `t` (T,) s are exposures of the first row."""
        shape, height = (len(t), len(JOINTS)), self.camera.image_size[1]
        found = self.whole.joints(t)
        for _ in range(ROW_STEPS):
            rows = np.nan_to_num(self.camera.project(found)[0][..., 1])
            times = np.asarray(t)[:, None] + self.line_s * np.clip(rows, 0.0, height - 1.0)
            every = self.whole.joints(times.ravel()).reshape(*shape, len(JOINTS), 3)
            found = np.einsum("tjjk->tjk", every)
        return found


@dataclass(frozen=True, eq=False)
class FreeRunningCapture:
    """One capture of a scene.

    Args:
        scene: Its scene.
        seed: Root seed of all random numbers.
        rig: Calibrated cameras, whose line delays are not stated.
        people: True people, see `SimulatedPerson.is_present`.
        timings: True timing of each camera.
    """

    scene: FreeRunningScene
    seed: tuple[int, ...]
    rig: Rig
    people: tuple[SimulatedPerson, ...]
    timings: tuple[CameraTiming, ...]

    @cached_property
    def views(self) -> tuple[TimedView, ...]:
        """Return the 2D people of all views, ordered by timestamp."""
        found = [view for camera in range(len(self.rig)) for view in self._views_of(camera)]
        return tuple(sorted(found, key=lambda one: (one.view.stamp_ns, one.camera)))

    def sets(self) -> Iterator[DetectionSet]:
        """Yield one set per view, because no two views belong together."""
        for index, one in enumerate(self.views):
            yield DetectionSet(index, one.view.stamp_ns, SKELETON.hash, (one.view,))

    def in_step(self, rate: float) -> Iterator[tuple[float, list[Sightings]]]:
        """Yield what the same cameras see if they expose together: true time (s), and one view per camera.

        Args:
            rate: Hz.
        """
        detector = self._detector(self.rig, self.people, rate, 6)
        for index in range(int(self.scene.seconds * rate)):
            seconds = index / rate
            yield seconds, detector.detect(index, np.full(len(self.rig), seconds))

    def joints(self, times: Array) -> Array:
        """Return the true joints (P, T, 19, 3) m of all people at true times (T,) s, also while absent."""
        return np.stack([person.joints(times) for person in self.people])

    def present(self, times: Array) -> Array:
        """Return a mask (P, T) of the people who are there at true times (T,) s."""
        return np.stack([person.is_present(times) for person in self.people])

    def _views_of(self, camera: int) -> Iterator[TimedView]:
        lens, timing = self.rig.cameras[camera], self.timings[camera]
        people = self.people
        if timing.line_s:
            people = tuple(
                _RowByRow(
                    one.id,
                    one.body,
                    one.motion,
                    one.gesture,
                    one.present,
                    one.bystander,
                    whole=one,
                    camera=lens,
                    line_s=timing.line_s,
                )
                for one in people
            )
        detector = self._detector(Rig((lens,)), people, timing.rate, 7 + camera)
        rng = np.random.default_rng([*self.seed, 5, camera])
        count = int(np.ceil((self.scene.seconds - timing.phase_s) * timing.rate))
        lost = rng.random(count) < self.scene.timing.lost
        jitter = self.scene.timing.jitter_s * rng.standard_normal(count)
        for number in np.flatnonzero(~lost).tolist():
            seconds = timing.phase_s + number / timing.rate
            (seen,) = detector.detect(number, np.array([seconds]))
            joints_found = (seen.scores > 0.0).sum(1)
            view = ViewDetections(
                lens.name,
                timing.stamp_ns(seconds + jitter[number]),
                number,
                lens.image_size,
                SKELETON.hash,
                seen.points,
                seen.scores,
                seen.scores.sum(1) / np.maximum(joints_found, 1),
            )
            yield TimedView(view, camera, seconds, owners_of(seen))

    def _detector(
        self, rig: Rig, people: Sequence[SimulatedPerson], rate: float, stream: int
    ) -> SimulatedDetector:
        memory = float(np.exp(-1.0 / (rate * NOISE_MEMORY_S)))
        return SimulatedDetector(
            (*self.seed, stream), replace(self.scene.degradation, memory=memory), rig, people
        )


def owners_of(seen: Sightings) -> Array:
    """Return the true person (D,) of most joints of each 2D person, or `NOBODY`."""
    owners = np.full(len(seen.points), NOBODY)
    for row, sources in enumerate(seen.sources[..., 0]):
        known = sources[sources >= 0]
        if len(known):
            owners[row] = np.bincount(known).argmax()
    return owners


def simulate_free_running(scene: FreeRunningScene, seed: int) -> FreeRunningCapture:
    """Return one capture of a scene; the same scene and seed always give the same capture.

    Raises:
        UsageError: for a negative seed, or a scene without duration.
    """
    if seed < 0 or scene.seconds <= 0.0:
        raise UsageError(
            f"a capture needs a seed from 0 and a duration above 0 s, not {seed} and {scene.seconds:g} s"
        )
    root = (seed, zlib.crc32(scene.name.encode()))
    rig = scene.rig.build(np.random.default_rng([*root, 1]))
    people = tuple(scene.cast(np.random.default_rng([*root, 2]), scene.seconds))
    timings = _timings(np.random.default_rng([*root, 3]), scene.timing, len(rig))
    return FreeRunningCapture(scene, root, rig, people, timings)


def _timings(rng: np.random.Generator, timing: FreeRunning, cameras: int) -> tuple[CameraTiming, ...]:
    rates = np.resize(timing.rates, cameras)
    turns = rng.permutation(cameras) / cameras if timing.staggered else rng.uniform(0.0, 1.0, cameras)
    offsets = timing.offset_s * rng.uniform(-1.0, 1.0, cameras)
    drifts = 1e-6 * timing.drift_ppm * rng.uniform(-1.0, 1.0, cameras)
    lines = 1e-6 * rng.uniform(*timing.line_delays_us, cameras)
    lines[:: timing.global_every] = 0.0
    offsets[0] = drifts[0] = 0.0
    return tuple(
        CameraTiming(float(rate), float(turn / rate), float(offset), float(drift), float(line))
        for rate, turn, offset, drift, line in zip(rates, turns, offsets, drifts, lines)
    )
