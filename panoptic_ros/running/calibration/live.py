"""Record images of a board from live cameras, with a guide that says what to show next."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from panoptic_ros.calibration.boards import Board
from panoptic_ros.calibration.guide import CalibrationGuide, GuideState
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.capture.image_recorder import ImageRecorder
from panoptic_ros.domain import Rig
from panoptic_ros.errors import CalibrationError, EnvironmentProblem
from panoptic_ros.io.interruption import first_request_told, requests_held
from panoptic_ros.running.calibration.calibrate import MODELS, input_of
from panoptic_ros.running.calibration.live_cameras import ImageTopic, LiveCameras, find_cameras
from panoptic_ros.running.calibration.live_images import LiveBoardSearch, SearchedImage, files_of
from panoptic_ros.running.calibration.live_solver import LiveSolver
from panoptic_ros.running.plans.free_threads import free_threads
from panoptic_ros.running.viewer.serving import served
from panoptic_ros.view.guide_table import recorded_line
from panoptic_ros.view.page.guide_scene import GuideScene
from panoptic_ros.view.page.html import GUIDE, page
from panoptic_ros.view.page.live_talk import LiveTalk

RECORDING = "recording"  # folder of the images in the folder of the results
PERIOD_S = 0.2  # s between two searches
PATIENCE_S = 10.0  # s until all cameras have given an image
LOOK_S = 0.01  # s between two looks for images
CLOCK_S = 1.0  # s between stamps of cameras at one time that clocks of one host never reach


@dataclass(frozen=True)
class LiveOptions:
    """Options of a live calibration; see `calibrate_recording`.

    Args:
        cameras: Names of the cameras; empty = every camera with images.
        topics: File of the topics of drivers, see `io.driver_topics`.
        host, port: Address of the page; port 0 = any free one.
    """

    lens: str = "brown"
    known: Rig | None = None
    synchronous: bool = False
    cameras: Sequence[str] = ()
    topics: Path | None = None
    host: str = "127.0.0.1"
    port: int = 0


class LiveProgress(NamedTuple):
    """Progress of a live recording.

    Args:
        state: State of the guide.
        recorded: Line about the recording.
        notices: Lines about faults.
    """

    state: GuideState
    recorded: str
    notices: Sequence[str]


def record_with_guide(
    out: Path,
    board: Board,
    options: LiveOptions,
    show: Callable[[LiveProgress], None],
    ready: Callable[[str], None],
    tell: Callable[[str], None],
) -> Path:
    """Record until a request to end, and return the folder of the images. A page shows the guide meanwhile.

    Images are kept if they show a board that has moved. `panoptic calibrate` reads the folder again.

    Args:
        show: called after each search. ready: called with the address of the page. tell: called with lines
            for the user.

    Raises:
        UserError: if cameras or their images are missing, or the folder exists already.
    """
    path = out / RECORDING
    recorder = ImageRecorder(path)
    with first_request_told() as asked, ExitStack() as stack:
        found = find_cameras(options.cameras, options.topics, tell, asked)
        cameras = stack.enter_context(LiveCameras(found))
        pool = stack.enter_context(ThreadPoolExecutor(max(1, free_threads(1) - 1)))
        searches = [LiveBoardSearch(name, board, camera.encoding) for name, camera in found.items()]
        searcher = _Searcher(cameras, dict(zip(found, searches)), pool)
        sizes = _first_sizes(found, searcher, asked)
        if asked():
            raise KeyboardInterrupt
        inputs = [input_of(name, size, MODELS[options.lens], options.known) for name, size in sizes.items()]
        scene = GuideScene(sizes)
        ready(stack.enter_context(served(LiveTalk(scene), options.host, options.port, page(None, GUIDE))))
        session = _Session(inputs, board, recorder)
        tell(f"recording {path}: show the board to all cameras; Ctrl-C ends it and calibrates")
        solver = stack.enter_context(LiveSolver(inputs, board, options.synchronous))
        while not asked():
            images = searcher.next(asked)
            for name, image in images.items():
                scene.picture(name, image.preview, image.pixels)
            session.add(images)
            solver.update(session.guide)
            progress = session.progress(searcher)
            scene.tell(*progress)
            show(progress)
    seen = {inputs[view.camera].name for view in session.guide.views}
    if not seen:
        raise CalibrationError("no image showed the board; check --board, light and focus")
    for name in sizes.keys() - seen:
        tell(f"warning: camera {name} is left out, because no image of it showed the board")
    return path


class _Searcher:
    """Search in the images of all cameras at one time, at a bounded rate. Late images are dropped."""

    def __init__(
        self, cameras: LiveCameras, searches: Mapping[str, LiveBoardSearch], pool: ThreadPoolExecutor
    ):
        self._cameras, self._searches, self._pool = cameras, searches, pool
        self._due_s = time.monotonic()
        self._times: list[float] = []
        self.late = 0

    @property
    def faults(self) -> dict[str, int]:
        """Return the number of messages without a usable image, by camera."""
        return {name: search.faults for name, search in self._searches.items() if search.faults}

    @property
    def notices(self) -> list[str]:
        """Return lines about messages and images that are left out."""
        lines = list(self._cameras.notices)
        lines += [
            f"camera {name}: {count} messages have no usable image" for name, count in self.faults.items()
        ]
        lines += [
            f"camera {name}: {search.repeated} images show two identical boards; cover one"
            for name, search in self._searches.items()
            if search.repeated
        ]
        return lines

    @property
    def rate_hz(self) -> float:
        """Return the rate of the last searches."""
        own = self._times[-10:]
        return (len(own) - 1) / (own[-1] - own[0]) if len(own) > 1 else 0.0

    def next(self, stop: Callable[[], bool]) -> dict[str, SearchedImage]:
        """Return the next searched images by camera; {} if none came within a period or on a stop."""
        until = max(self._due_s, time.monotonic()) + PERIOD_S
        while not stop() and (now := time.monotonic()) < until:
            if now >= self._due_s and (messages := self._cameras.take()):
                missed = int((now - self._due_s) / PERIOD_S) if self._times else 0
                self.late += missed
                self._due_s = max(self._due_s + PERIOD_S * (1 + missed), now)
                self._times = [*self._times[-10:], now]
                tasks = {
                    name: self._pool.submit(self._searches[name].search, *message)
                    for name, message in messages.items()
                }
                found = {name: task.result() for name, task in tasks.items()}
                return {name: image for name, image in found.items() if image is not None}
            time.sleep(LOOK_S)
        return {}


def _first_sizes(
    cameras: Mapping[str, ImageTopic], searcher: _Searcher, stop: Callable[[], bool]
) -> dict[str, tuple[int, int]]:
    """Return the size (width, height) px of the images of each camera.

    Raises:
        EnvironmentProblem: if a camera gives no usable image in time.
    """
    sizes: dict[str, tuple[int, int]] = {}
    deadline = time.monotonic() + PATIENCE_S
    while len(sizes) < len(cameras) and not stop():
        sizes |= {name: image.size for name, image in searcher.next(stop).items()}
        missing = [name for name in cameras if name not in sizes]
        if missing and time.monotonic() > deadline:
            name = missing[0]
            what = "usable image" if name in searcher.faults else "image"
            raise EnvironmentProblem(
                f"no {what} of camera {name} came on {cameras[name].topic} within {PATIENCE_S:g} s; is its "
                "driver running? --cameras NAME,NAME chooses other cameras"
            )
    return {name: sizes[name] for name in cameras if name in sizes}


class _Session:
    """Recording with its guide."""

    def __init__(self, inputs: Sequence[CameraInput], board: Board, recorder: ImageRecorder):
        self.guide = CalibrationGuide(inputs, board.points)
        self._recorder = recorder
        self._numbers = {camera.name: c for c, camera in enumerate(inputs)}
        self._sizes = {camera.name: camera.size for camera in inputs}
        self._changed: set[str] = set()  # cameras with images of another size
        self._apart_s = 0.0
        self._start_ns: int | None = None

    def add(self, images: Mapping[str, SearchedImage]) -> None:
        """Add the images of one time; keep those with a board if one has moved."""
        self._changed |= {name for name, image in images.items() if image.size != self._sizes[name]}
        images = {name: image for name, image in images.items() if name not in self._changed}
        if not images:
            return
        stamps = [image.stamp_ns for image in images.values()]
        self._apart_s = 1e-9 * (max(stamps) - min(stamps))
        if self._start_ns is None:
            self._start_ns = min(stamps)
        seen = {name: image for name, image in images.items() if image.file is not None}
        views = [
            TargetView(
                self._numbers[name], 0, 1e-9 * (image.stamp_ns - self._start_ns), image.numbers, image.pixels
            )
            for name, image in seen.items()
        ]
        with requests_held():  # guide and files agree
            if self.guide.add(views):
                self._recorder.add(files_of(seen))

    def progress(self, searcher: _Searcher) -> LiveProgress:
        """Return the progress."""
        notices = searcher.notices
        notices += [f"camera {name}: the size of its images changed; start again" for name in self._changed]
        if self._apart_s > CLOCK_S:
            notices.append(
                f"stamps of the cameras differ by {self._apart_s:.1f} s at one time; synchronise their hosts"
            )
        recorded = recorded_line(self._recorder.counts, searcher.rate_hz, searcher.late)
        return LiveProgress(self.guide.state(), recorded, notices)
