"""The images of a simulated take as a capture folder. Apart from `simulate`, as numba loads slowly."""
from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

import numpy as np

from panoptic_ros.io.files import write_bytes
from panoptic_ros.io.motion_jpeg import MotionJpegWriter
from panoptic_ros.simulation import Simulation
from panoptic_ros.simulation.rendering import Studio
from panoptic_ros.view.video import write_image

Array = np.ndarray
MILLIMETRES = 1000.0


class _Sink(Protocol):
    def write(self, image: Array) -> None:
        """Take the next image."""
        ...

    def close(self) -> None:
        """Finish."""
        ...


class _ImageFolder:
    """Numbered PNG files."""

    def __init__(self, folder: Path):
        self._folder, self._count = folder, 0

    def write(self, image: Array) -> None:
        write_image(self._folder / f"{self._count:06d}.png", image)
        self._count += 1

    def close(self) -> None:
        """Nothing is open."""


def write_capture(folder: Path, take: Simulation, images: bool, depth: bool) -> Iterator[str]:
    """Render every camera into `<camera>.mp4` or, with `images`, `<camera>/000000.png`, ...

    Beside them timestamps.csv; with `depth` also `<camera>_depth/` (uint16 mm, 0 = beyond 65 m) and
    `<camera>_people/` (uint8, 0 = room, k + 1 = person k). Yields a camera's name when it is done.

    Raises:
        EnvironmentProblem: if a file cannot be written.
    """
    studio = Studio(take)
    rows: list[tuple[str, int, int]] = []
    for index, name in enumerate(take.rig.names):
        exposures, stamps = take.schedule.exposures[:, index], take.schedule.stamps[:, index]
        there = ~np.isnan(exposures)
        rows += [(name, number, take.stamp_ns(index, stamp)) for number, stamp in enumerate(stamps[there])]
        sink = _sink(folder, name, take, index, images)
        for number, view in enumerate(studio.camera(name).render(exposures[there])):
            sink.write(view.image)
            if depth:
                millimetres = np.rint(MILLIMETRES * view.depth)
                far = millimetres > np.iinfo(np.uint16).max
                file = f"{number:06d}.png"
                write_image(folder / f"{name}_depth" / file, np.where(far, 0, millimetres).astype(np.uint16))
                write_image(folder / f"{name}_people" / file, view.people)
        sink.close()
        yield name
    _write_stamps(folder / "timestamps.csv", rows)


def _sink(folder: Path, name: str, take: Simulation, index: int, images: bool) -> _Sink:
    if images:
        return _ImageFolder(folder / name)
    timing = take.scene.timing
    nominal = [float(generator.frame_rate.exact) for generator in timing.generators]
    rates = nominal or timing.camera_rates or (timing.rate,)
    rate = rates[index % len(rates)]
    return MotionJpegWriter(folder / f"{name}.mp4", take.rig.cameras[index].image_size, rate)


def _write_stamps(path: Path, rows: list[tuple[str, int, int]]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["camera", "frame", "stamp_ns"])
    writer.writerows(rows)
    write_bytes(path, text.getvalue().encode())
