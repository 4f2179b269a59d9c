"""Marks of mirrored and turned images are obeyed; interlaced frames become whole images of one instant."""

from fractions import Fraction

import av
import numpy as np
import pytest
from av.filter import Graph

from panoptic_ros.capture.upright import Orientation, whole_images
from panoptic_ros.capture.video import VideoSource
from panoptic_ros.errors import DataError

WIDTH, HEIGHT, STEP = 128, 64, 6  # px; the last is what the edge moves in a field


@pytest.mark.parametrize("clockwise", [0, 90, 180, 270])
@pytest.mark.parametrize("suffix", [".mp4", ".mov"])
def test_a_mirrored_video_is_mirrored_back(film, tmp_path, clockwise, suffix):
    times = [0, 3000]
    stored = [frame.image for frame in VideoSource("cam", film(tmp_path / f"b{suffix}", times))]
    path = film(tmp_path / f"a{suffix}", times, clockwise=clockwise, mirrored=True)
    source = VideoSource("cam", path)
    matrix = matrix_of(path)  # of a point (x, y), as 2 x 2 of signs; y is down
    for frame, image in zip(source, stored):
        assert np.array_equal(frame.image, shown(image, matrix))
        assert source.image_size == frame.image.shape[1::-1]
    assert np.linalg.det(matrix) < 0
    assert len(source.notices) == 1 and "mirrored" in source.notices[0]
    assert ("turned" in source.notices[0]) == (abs(matrix[0, 0]) < 0.5)


def matrix_of(path):
    """The display matrix in the track header of an MP4."""
    data = path.read_bytes()
    at = data.index(b"tkhd") + 4 + 40
    a, b, _, c, d = np.frombuffer(data[at : at + 20], ">i4") / 65536
    return np.array([[a, c], [b, d]])


def shown(image, matrix):
    """Each pixel goes where the matrix says, and the picture's corner to (0, 0)."""
    height, width = image.shape[:2]
    y, x = np.mgrid[:height, :width]
    places = np.rint(np.einsum("ij,jhw->ihw", matrix, np.stack([x, y]))).astype(int)
    places -= places.min(axis=(1, 2))[:, None, None]
    out = np.zeros((places[1].max() + 1, places[0].max() + 1, 3), np.uint8)
    out[places[1], places[0]] = image
    return out


def test_other_angles_are_told_and_not_obeyed():
    image = np.zeros((4, 6, 3), np.uint8)
    assert Orientation(30).applied(image) is image
    assert "turned by 30 degrees, no quarter turn" in str(Orientation(30))
    assert str(Orientation(180, True)) == "images are mirrored top to bottom, as marked in the file"


def edge(field):
    """A bright area whose right border moves; it is the picture of one instant."""
    picture = np.full((HEIGHT, WIDTH, 3), 30, np.uint8)
    picture[:, : 12 + STEP * field] = 200
    return picture


def interlaced(path, top_first, count=8, codec="mpeg2video"):
    """A video of frames whose rows are of two instants."""
    marked = Graph()
    source = marked.add_buffer(
        width=WIDTH, height=HEIGHT, format=av.VideoFormat("yuv420p"), time_base=Fraction(1, 25)
    )
    mark = marked.add("setfield", "mode=tff" if top_first else "mode=bff")
    marked.link_nodes(source, mark, marked.add("buffersink"))
    marked.configure()
    with av.open(str(path), "w") as file:
        stream = file.add_stream(codec, rate=25, options={"flags": "+ildct+ilme", "qscale": "1", "bf": "0"})
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = WIDTH, HEIGHT, "yuv420p", 4_000_000
        for k in range(count):
            picture = edge(2 * k)
            picture[int(top_first) :: 2] = edge(2 * k + 1)[int(top_first) :: 2]
            frame = av.VideoFrame.from_ndarray(picture, format="bgr24").reformat(format="yuv420p")
            frame.pts, frame.time_base = k, Fraction(1, 25)
            marked.vpush(frame)
            file.mux(stream.encode(marked.vpull()))
        file.mux(stream.encode())
    return path


@pytest.mark.parametrize("top_first", [True, False])
@pytest.mark.parametrize(
    ("suffix", "codec"), [(".ts", "mpeg2video"), (".mts", "libx264"), (".mov", "mpeg2video")]
)
def test_an_interlaced_frame_becomes_the_picture_of_its_first_field(tmp_path, top_first, suffix, codec):
    source = VideoSource("cam", interlaced(tmp_path / f"a{suffix}", top_first, codec=codec))
    frames = list(source)
    assert source.notices == ("images are interlaced: each is made of its first field",)
    assert [frame.stamp_ns for frame in frames] == [40_000_000 * k for k in range(8)]
    assert [frame.frame_number for frame in frames] == list(range(8))
    for k, frame in enumerate(frames):
        places = (frame.image[8:-8, :, 1] > 115).sum(axis=1)  # of the edge, by row
        assert np.abs(places - (12 + STEP * 2 * k)).max() <= 1


def test_frames_of_one_instant_are_not_touched(film, tmp_path):
    path = film(tmp_path / "a.mp4", [3000 * k for k in range(5)])
    with av.open(str(path)) as file, av.open(str(path)) as again:
        for whole, plain in zip(whole_images(file.decode(video=0)), again.decode(video=0), strict=True):
            assert whole.pts == plain.pts and np.array_equal(whole.to_ndarray(), plain.to_ndarray())


def test_what_ends_the_file_comes_after_the_last_whole_image(tmp_path):
    path = interlaced(tmp_path / "a.ts", True)

    def broken(frames):
        yield from frames
        raise DataError("cannot be read on")

    got = []
    with av.open(str(path)) as file, pytest.raises(DataError, match="read on"):
        for frame in whole_images(broken(file.decode(video=0))):
            got.append(frame.pts)
    assert len(got) == 8
