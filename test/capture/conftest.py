"""Small videos and rigs that the tests of capture make for themselves."""

import json
import struct
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from numbered_images import numbered as grey


def _numbered(number: int, size: tuple[int, int]) -> np.ndarray:
    """An image whose brightness tells its number; the left half is red, the right half blue."""
    width, height = size
    image = np.zeros((height, width, 3), np.uint8)
    image[:, : width // 2, 2] = 40 + 4 * (number % 50)
    image[:, width // 2 :, 0] = 40 + 4 * (number % 50)
    return image


@pytest.fixture
def make_video():
    """make_video(path, count=10, size=(64, 48), rate=30.0, codec="mp4v") writes a video."""

    def make(path: Path, count: int = 10, size=(64, 48), rate: float = 30.0, codec: str = "mp4v") -> Path:
        path.parent.mkdir(parents=True, exist_ok=True)
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), rate, size)
        assert writer.isOpened()
        for i in range(count):
            writer.write(_numbered(i, size))
        writer.release()
        return path

    return make


@pytest.fixture
def film():
    """film(path, times, ...) writes a video of images that are shown at times in 1/90000 s.

    They are textured, or numbered (see `number_of`); `reordered` frames between two of which they are made
    are stored later than they are shown.
    """

    def write(
        path: Path,
        times: Sequence[int],
        *,
        clockwise: int = 0,
        mirrored: bool = False,
        codec: str = "libx264",
        layout: str = "yuv420p",
        size: tuple[int, int] = (64, 48),
        reordered: int = 0,
        timecode: str = "",
        numbered: bool = False,
        gop: int = 12,
        rate: int = 30,
    ) -> Path:
        noise = np.random.default_rng(0)
        options = {"bf": str(reordered), "log-level": "none", "x265-params": "log-level=none", "g": str(gop)}
        options |= {"crf": "1", "sc_threshold": "0"} if codec == "libx264" and numbered else {}
        own = {"video_track_timescale": "90000"} if path.suffix in (".mp4", ".mov") else {}
        with av.open(str(path), "w", container_options=own) as file:
            if timecode:
                file.metadata["timecode"] = timecode
            stream = file.add_stream(codec, rate=rate, options=options)
            stream.width, stream.height, stream.pix_fmt = *size, layout
            if numbered:  # numbers must survive
                stream.bit_rate = 20_000_000
            even = codec in ("mpeg2video", "mpeg4") or path.suffix == ".avi"  # they keep no finer times
            stream.codec_context.time_base = Fraction(1, rate if even else 90000)
            if clockwise or mirrored:
                stream.set_display_rotation(-clockwise, hflip=mirrored)
            for number, time in enumerate(times):
                image = cv2.resize(noise.integers(0, 256, (6, 8, 3), dtype=np.uint8), size)
                image = grey(number, size) if numbered else image
                frame = av.VideoFrame.from_ndarray(image, format="bgr24").reformat(format=layout)
                frame.pts, frame.time_base = time, Fraction(1, 90000)
                file.mux(stream.encode(frame))
            file.mux(stream.encode())
        return path

    return write


@pytest.fixture
def make_rig_file():
    """make_rig_file(path, {name: size}) writes a rig.json of cameras on a ring that look inwards."""

    def make(path: Path, sizes: dict[str, tuple[int, int]]) -> Path:
        cameras = []
        for i, (name, (width, height)) in enumerate(sizes.items()):
            angle = 2 * np.pi * i / len(sizes)
            right = [-np.sin(angle), np.cos(angle), 0.0]
            forward = [-np.cos(angle), -np.sin(angle), 0.0]
            rotation = [right, [0.0, 0.0, -1.0], forward]
            centre = np.array([3 * np.cos(angle), 3 * np.sin(angle), 1.0])
            cameras.append(
                {
                    "name": name,
                    "image_size": [width, height],
                    "K": [[50.0, 0.0, width / 2], [0.0, 50.0, height / 2], [0.0, 0.0, 1.0]],
                    "distortion": [0.0] * 5,
                    "R": np.asarray(rotation).tolist(),
                    "t": (-np.asarray(rotation) @ centre).tolist(),
                }
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps({"format": "panoptic-rig-1", "units": "m", "cameras": cameras}))
        return path

    return make


@pytest.fixture
def patch_track_header():
    """patch_track_header(path, degrees, size) marks an MP4 as to be turned clockwise."""

    def patch(path: Path, degrees: int, size: tuple[int, int]) -> Path:
        data = bytearray(path.read_bytes())
        at = data.index(b"tkhd") + 4 + 40  # version 0: the matrix stands 40 bytes into the box
        one = 65536
        width, height = size[0] * one, size[1] * one
        matrix = {
            90: (0, one, 0, -one, 0, 0, height, 0, 1 << 30),
            180: (-one, 0, 0, 0, -one, 0, width, height, 1 << 30),
            270: (0, -one, 0, one, 0, 0, 0, width, 1 << 30),
        }[degrees]
        data[at : at + 36] = struct.pack(">9i", *matrix)
        path.write_bytes(data)
        return path

    return patch
