"""Renders the images of a simulated take into a capture folder.

The module is separate from `takes`, as numba loads slowly.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from panoptic_ros.capture.sound import SOUND_NAMES
from panoptic_ros.io.files import write_bytes
from panoptic_ros.simulation import Simulation
from panoptic_ros.simulation.generators import SAMPLE_RATE, Generator, filmed
from panoptic_ros.simulation.rendering import Studio
from panoptic_ros.view.pictures import write_image
from panoptic_ros.view.video_file import FINE, VideoAudio, VideoFile

Array = np.ndarray
MILLIMETRES = 1000.0
LATE_S, LATES = 0.06, 3  # sound of camera k begins LATE_S * (k mod LATES) s after its first image


class _ImageFolder:
    """Sink that writes numbered PNG files."""

    def __init__(self, folder: Path):
        self._folder = folder

    def write(self, image: Array, number: int) -> None:
        write_image(self._folder / f"{number:06d}.png", image)

    def close(self) -> None:
        """Do nothing, as no file is open."""


def write_capture(
    folder: Path, take: Simulation, *, images: bool = False, depth: bool = False, tracks: bool = False
) -> Iterator[str]:
    """Render every camera into `<camera>.mp4` or, with `images`, into `<camera>/000000.png`, ...

    The folder also gets timestamps.csv or, with `tracks`, sound.yaml. With `tracks`, the sound of each video
    is the timecode of the generator that the camera is locked to; the first camera records all generators.
    With `depth`, the folder also gets `<camera>_depth/` (uint16 mm, 0 = beyond 65 m) and `<camera>_people/`
    (uint8, 0 = room, k + 1 = person k). Yields the name of each finished camera.

    Raises:
        EnvironmentProblem: if a file cannot be written.
    """
    studio = Studio(take)
    rows: list[tuple[str, int, int]] = []
    for index, name in enumerate(take.rig.names):
        exposures, stamps = take.schedule.exposures[:, index], take.schedule.stamps[:, index]
        there = ~np.isnan(exposures)
        rows += [(name, number, take.stamp_ns(index, stamp)) for number, stamp in enumerate(stamps[there])]
        sink = _ImageFolder(folder / name) if images else _video(folder, take, index, tracks)
        places = take.schedule.numbers(index) if tracks else np.arange(there.sum())
        for number, view in enumerate(studio.camera(name).render(exposures[there])):
            sink.write(view.image, int(places[number]))
            if depth:
                millimetres = np.rint(MILLIMETRES * view.depth)
                far = millimetres > np.iinfo(np.uint16).max
                file = f"{number:06d}.png"
                write_image(folder / f"{name}_depth" / file, np.where(far, 0, millimetres).astype(np.uint16))
                write_image(folder / f"{name}_people" / file, view.people)
        sink.close()
        yield name
    if tracks:
        names = [
            f"{name}.mp4: [{', '.join(g.clock for g in _heard(take, k))}]\n"
            for k, name in enumerate(take.rig.names)
        ]
        write_bytes(folder / SOUND_NAMES, "".join(names).encode())
    else:
        _write_stamps(folder / "timestamps.csv", rows)


def _video(folder: Path, take: Simulation, index: int, tracks: bool) -> VideoFile:
    """Open the video file of a camera, with a sound track if `tracks` is set."""
    timing, camera = take.scene.timing, take.rig.cameras[index]
    nominal = [float(generator.frame_rate.exact) for generator in timing.generators]
    rates = nominal or timing.camera_rates or (timing.rate,)
    rate, sound = rates[index % len(rates)], None
    if tracks:
        late = LATE_S * (index % LATES)
        begin = float(np.nanmin(take.schedule.exposures[:, index])) + late
        seconds = (int(take.schedule.numbers(index)[-1]) + 1) / rate - late
        samples = filmed(_heard(take, index), _locked(take, index), begin, seconds)
        sound = VideoAudio(samples, SAMPLE_RATE, late)
    return VideoFile(folder / f"{camera.name}.mp4", camera.image_size, rate, quality=FINE, sound=sound)


def _locked(take: Simulation, index: int) -> Generator:
    generators = take.scene.timing.generators
    return generators[index % len(generators)]


def _heard(take: Simulation, index: int) -> Sequence[Generator]:
    """Return the generators whose timecode the sound track of a camera carries."""
    return [_locked(take, index)] if index else take.scene.timing.generators


def _write_stamps(path: Path, rows: list[tuple[str, int, int]]) -> None:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["camera", "frame", "stamp_ns"])
    writer.writerows(rows)
    write_bytes(path, text.getvalue().encode())
