"""Live sources: the newest frame wins, losses are counted, cameras that come back are taken back."""

import http.server
import threading
import time

import cv2
import numpy as np
import pytest

from panoptic_ros.capture import device as module
from panoptic_ros.capture.device import DeviceOptions, DeviceSource
from panoptic_ros.capture.source import FrameSource
from panoptic_ros.errors import BackendError, UsageError

WAIT_S = 10.0


class FakeCamera:
    """A device whose frames the test lets through one by one; None = the cable is pulled."""

    def __init__(self, frames, opened=True):
        self.frames = frames
        self.opened = opened
        self.gate = threading.Semaphore(0)
        self.released = False
        self.position = 0

    def isOpened(self):  # noqa: N802
        return self.opened

    def get(self, which):
        return 50.0

    def read(self):
        while not self.gate.acquire(timeout=0.02):
            if self.released:
                return False, None
        level = self.frames[self.position] if self.position < len(self.frames) else None
        self.position += 1
        return (False, None) if level is None else (True, np.full((48, 64, 3), level, np.uint8))

    def release(self):
        self.released = True

    def let(self, count):
        for _ in range(count):
            self.gate.release()


def _until(condition):
    deadline = time.monotonic() + WAIT_S
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.002)
    assert condition()


@pytest.fixture
def start():
    """start(cameras, **arguments) opens a source whose devices are these, one after another."""
    sources, fakes = [], []

    def make(cameras, **arguments):
        fakes.extend(cameras)
        queue = list(cameras)
        options = arguments.pop("options", DeviceOptions(timeout_s=WAIT_S))
        arguments.setdefault("opener", lambda name, opts: queue.pop(0) if len(queue) > 1 else queue[0])
        source = DeviceSource("cam", "0", options=options, **arguments)
        sources.append(source)
        return source

    yield make
    for fake in fakes:
        fake.released = True
    for source in sources:
        source.close()


def test_only_the_newest_frame_is_handed_out_and_the_others_are_counted(start):
    camera = FakeCamera([10, 20, 30, 40, 50])
    camera.let(1)
    source = start([camera])
    assert isinstance(source, FrameSource)
    assert (source.image_size, source.frame_rate, source.frame_count) == ((64, 48), 50.0, None)
    frames = iter(source)
    assert next(frames).image[0, 0, 0] == 10
    camera.let(3)
    _until(lambda: source.dropped == 2)
    frame = next(frames)
    assert (frame.frame_number, frame.image[0, 0, 0], source.dropped) == (3, 40, 2)


def test_stamps_are_arrivals_minus_latency_and_never_go_back(start):
    times = iter([5_000_000_000, 5_100_000_000, 4_000_000_000, 5_300_000_000, 6_000_000_000])
    camera = FakeCamera([1, 2, 3, 4])
    camera.let(1)
    options = DeviceOptions(latency_ms=20.0, timeout_s=WAIT_S)
    source = start([camera], clock=lambda: next(times), options=options)
    frames, stamps = iter(source), []
    for i in range(4):
        stamps.append(next(frames).stamp_ns)
        if i < 3:
            camera.let(1)
    assert stamps == [4_980_000_000, 5_080_000_000, 5_080_000_001, 5_280_000_000]


def test_a_camera_that_comes_back_is_taken_back(start, monkeypatch):
    monkeypatch.setattr(module, "BACKOFF_S", (0.001,))
    first, closed, second = FakeCamera([1, None]), FakeCamera([], opened=False), FakeCamera([7])
    first.let(2)
    second.let(1)
    source = start([first, closed, second])
    frames = iter(source)
    levels = {int(next(frames).image[0, 0, 0])}
    if levels == {1}:
        levels.add(int(next(frames).image[0, 0, 0]))
    assert 7 in levels and source.reconnects == 1 and first.released and closed.released


def test_without_reconnecting_the_end_is_told(start):
    camera = FakeCamera([1, None])
    camera.let(1)
    source = start([camera], options=DeviceOptions(timeout_s=WAIT_S, reconnect=False))
    frames = iter(source)
    next(frames)
    camera.let(1)
    with pytest.raises(BackendError, match="camera cam at 0: it sends no more images"):
        next(frames)


def test_a_device_that_does_not_open_or_gives_nothing(start):
    with pytest.raises(BackendError, match="cannot be opened"):
        start([FakeCamera([], opened=False)])
    with pytest.raises(BackendError, match=r"no image within 0\.05 s"):
        start([FakeCamera([1])], options=DeviceOptions(timeout_s=0.05))


def test_closing_ends_a_waiting_iteration(start):
    camera = FakeCamera([1])
    camera.let(1)
    source = start([camera])
    frames = iter(source)
    next(frames)
    threading.Timer(0.05, source.close).start()
    assert list(frames) == []
    camera.let(1)  # the read that was under way comes back
    _until(lambda: camera.released)


def test_names_that_are_no_device():
    with pytest.raises(UsageError, match="a device is a number"):
        DeviceSource("cam", "video.mp4")
    with pytest.raises(BackendError, match="no such device"):
        DeviceSource("cam", "/dev/video987")


def test_a_real_stream_over_http(capfd):
    """OpenCV reads MJPEG over HTTP from a server in this process."""
    jpeg = cv2.imencode(".jpg", np.full((48, 64, 3), 90, np.uint8))[1].tobytes()
    stop = threading.Event()

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            try:
                while not stop.is_set():
                    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                    self.wfile.write(head.encode() + jpeg + b"\r\n")
                    time.sleep(0.01)
            except OSError:
                return

        def log_message(self, *args):
            return

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        url = f"http://127.0.0.1:{server.server_address[1]}/stream.mjpg"
        with DeviceSource("cam", url) as source:
            frame = next(iter(source))
            assert source.image_size == (64, 48) and abs(int(frame.image[20, 20, 0]) - 90) < 4
    finally:
        stop.set()
        server.shutdown()
        server.server_close()
    assert capfd.readouterr().err == ""


def test_an_address_that_nobody_answers():
    with pytest.raises(BackendError, match=r"cannot be opened|no image within"):
        DeviceSource("cam", "http://127.0.0.1:9/x", options=DeviceOptions(timeout_s=2.0))
