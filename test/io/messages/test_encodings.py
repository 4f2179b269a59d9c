"""Images of every encoding that drivers publish come with their colours."""

from functools import partial
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from panoptic_ros.errors import DataError
from panoptic_ros.io.messages import bag_messages, frame_from_message
from panoptic_ros.io.messages.encodings import shown_by


def smooth_picture():
    """Colours that change slowly, so that mosaics and half the chroma lose little."""
    y, x = np.mgrid[:48, :64] / 64.0
    return np.stack([80 + 90 * x, 60 + 100 * y, 200 - 80 * x * y], axis=-1).astype(np.uint8)


def mosaic(picture, pattern):
    grey = np.zeros(picture.shape[:2], np.uint8)
    for k, colour in enumerate(pattern):
        row, column = divmod(k, 2)
        grey[row::2, column::2] = picture[row::2, column::2, "bgr".index(colour)]
    return grey


def packed_yuv(picture, luma):
    """4:2:2 of BT.601, studio range, with the luma in the first or second byte of each pixel."""
    by_bgr = np.array([[0.098, 0.504, 0.257], [0.439, -0.291, -0.148], [-0.071, -0.368, 0.439]])
    yuv = np.rint(picture @ by_bgr.T + [16, 128, 128]).astype(np.uint8)
    data = np.zeros((*picture.shape[:2], 2), np.uint8)
    data[..., luma] = yuv[..., 0]
    data[:, 0::2, 1 - luma], data[:, 1::2, 1 - luma] = yuv[:, 0::2, 1], yuv[:, 0::2, 2]
    return data


def sixteen(values, bits=16):
    """Return the same shades in some bits of 16."""
    return (np.ascontiguousarray(values).astype(np.uint32) * (2**bits - 1) // 255).astype(np.uint16)


def luma_and_pairs(picture, share):
    """Return planes of BT.601: brightness, then pairs of U and V of every pixel, or of a fourth of them."""
    packed = packed_yuv(picture, 0)
    luma, pairs = packed[..., 0], np.stack([packed[:, 0::2, 1], packed[:, 1::2, 1]], axis=-1)
    pairs = pairs[::2] if share == 2 else np.repeat(pairs, 2, axis=1)
    return luma, pairs.reshape(len(pairs), -1)


MOSAICS = ("rggb", "bggr", "gbrg", "grbg")
EIGHT = {
    "bgr8": lambda p: p,
    "8UC3": lambda p: p,
    "rgb8": lambda p: p[..., ::-1],
    "bgra8": lambda p: cv2.cvtColor(p, cv2.COLOR_BGR2BGRA),
    "8UC4": lambda p: cv2.cvtColor(p, cv2.COLOR_BGR2BGRA),
    "rgba8": lambda p: cv2.cvtColor(p, cv2.COLOR_BGR2RGBA),
    "yuv422": lambda p: packed_yuv(p, 1),
    "uyvy": lambda p: packed_yuv(p, 1),
    "yuv422_yuy2": lambda p: packed_yuv(p, 0),
    "yuyv": lambda p: packed_yuv(p, 0),
    "8UC2": lambda p: packed_yuv(p, 0),
    **{f"bayer_{pattern}8": partial(mosaic, pattern=pattern) for pattern in MOSAICS},
}
SIXTEEN = {
    **{name.replace("8", "16"): EIGHT[name] for name in ("bgr8", "rgb8", "bgra8", "rgba8")},
    **{name.replace("8", "16", 1): EIGHT[name] for name in ("8UC2", "8UC3", "8UC4")},
    **{f"bayer_{pattern}16": EIGHT[f"bayer_{pattern}8"] for pattern in MOSAICS},
}
GREY = ("mono8", "8UC1", "mono16", "16UC1")
PLANES = {"nv12": 2, "nv21": 2, "nv24": 1}
EXACT = ("bgr8", "8UC3", "rgb8", "bgra8", "8UC4", "rgba8")


def image(data, encoding, padding=0, big=False, **fields):
    """Return a message of rows (height, width, ...) of one or two bytes."""
    values = np.ascontiguousarray(data, ">u2" if big else data.dtype)
    rows = values.reshape(len(data), -1).view(np.uint8)
    rows = np.pad(rows, ((0, 0), (0, padding)))
    fields = {"width": data.shape[1], "height": len(data), "step": rows.shape[1], **fields}
    return SimpleNamespace(
        header=bag_messages().header(5, "left"),
        encoding=encoding,
        is_bigendian=int(big),
        data=rows.tobytes(),
        **fields,
    )


def planes(picture, encoding, padding=0):
    """Return the data of planes; padding: bytes behind each row of brightness."""
    luma, pairs = luma_and_pairs(picture, PLANES[encoding])
    if encoding == "nv21":
        pairs = pairs.reshape(*pairs.shape[:1], -1, 2)[..., ::-1].reshape(pairs.shape)
    wide = padding * pairs.shape[1] // luma.shape[1]
    return b"".join(np.pad(p, ((0, 0), (0, more))).tobytes() for p, more in ((luma, padding), (pairs, wide)))


def off(frame, picture):
    """Return the largest error of a frame, levels, away from the border."""
    return int(np.abs(frame.image.astype(int) - picture)[2:-2, 2:-2].max())


@pytest.mark.parametrize("padding", [0, 7])
@pytest.mark.parametrize("encoding", EIGHT)
def test_every_encoding_gives_the_picture(encoding, padding):
    picture = smooth_picture()
    frame = frame_from_message(image(EIGHT[encoding](picture), encoding, padding), "left", 3)
    assert (frame.camera, frame.stamp_ns, frame.frame_number) == ("left", 5, 3)
    assert off(frame, picture) <= (0 if encoding in EXACT else 6)


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("bits", [10, 12, 14, 16])
@pytest.mark.parametrize("encoding", SIXTEEN)
def test_sixteen_bits_are_stretched_by_those_in_use(encoding, bits, big):
    picture = smooth_picture()
    picture[0, 0] = 255  # something is bright
    message = image(sixteen(SIXTEEN[encoding](picture), bits), encoding, padding=6, big=big)
    worst = 1 if encoding[:3] in ("bgr", "rgb") else 7
    assert off(frame_from_message(message, "left", 0), picture) <= worst


@pytest.mark.parametrize("encoding", GREY)
def test_shades_of_grey(encoding):
    grey = smooth_picture()[..., 0]
    data = sixteen(grey, 12) if "16" in encoding else grey
    frame = frame_from_message(image(data, encoding, padding=4), "left", 0)
    assert np.abs(frame.image.astype(int) - grey[..., None]).max() <= 1


def test_bits_that_are_stated_count_in_place_of_those_in_use():
    dark = np.full((8, 8), 100, np.uint16)
    for name, expected in (("mono10", 100 >> 2), ("mono12", 100 >> 4), ("", 100)):
        assert (frame_from_message(image(dark, "16UC1"), "c", 0, name).image == expected).all()
    assert frame_from_message(image(dark * 100, "mono10"), "c", 0).image.max() == 255


@pytest.mark.parametrize("encoding", PLANES)
def test_planes_of_brightness_and_colour(encoding):
    """Read them tight or padded, with the height of the picture or that of both planes."""
    picture = smooth_picture()
    height, width = picture.shape[:2]
    lines = 3 * height // PLANES[encoding]
    layouts = (
        {"step": width},
        {"step": 0},
        {"step": 3 * width // 2},
        {"step": width + 8},
        {"height": lines, "step": width},
    )
    for fields in layouts:
        message = image(picture[..., 0], encoding, **fields)
        message.data = planes(picture, encoding, 8 if fields["step"] == width + 8 else 0)
        frame = frame_from_message(message, "left", 0)
        assert frame.image.shape == picture.shape and off(frame, picture) <= 6, fields


@pytest.mark.parametrize("words", ["RGB8", " rgb8", "Rgb 8\t"])
def test_case_and_blanks_mean_nothing(words):
    picture = smooth_picture()
    assert off(frame_from_message(image(picture[..., ::-1], words), "left", 0), picture) == 0


def test_rows_without_a_step_or_without_padding_at_the_end():
    picture = smooth_picture()
    message = image(picture, "bgr8", padding=10)
    message.data = message.data[:-10]
    assert off(frame_from_message(message, "left", 0), picture) == 0
    assert off(frame_from_message(image(picture, "bgr8", step=0), "left", 0), picture) == 0
    message.data = message.data[:-1]
    with pytest.raises(DataError, match="cannot have"):
        frame_from_message(message, "left", 0)


def test_an_encoding_that_the_driver_states_wrongly():
    picture = smooth_picture()
    message = image(mosaic(picture, "rggb"), "mono8")
    assert off(frame_from_message(message, "left", 0, "bayer_rggb8"), picture) <= 6


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("rgb9", "encoding 'rgb9', perhaps rgb8; supported: mono8"),
        ("32FC1", "encoding '32FC1'"),
        ("", "''"),
        ("bayer_rgbg8", "perhaps bayer_rggb8"),
    ],
)
def test_what_is_no_encoding_of_a_picture_is_named(name, told):
    with pytest.raises(DataError, match=told):
        frame_from_message(image(smooth_picture(), name), "left", 0)


@pytest.mark.parametrize(("encoding", "shape"), [("yuyv", (4, 3, 2)), ("nv12", (3, 4)), ("nv21", (4, 3))])
def test_sizes_that_cannot_be_encoded_so_are_refused(encoding, shape):
    message = image(np.zeros(shape, np.uint8), encoding)
    message.data += bytes(len(message.data) // 2) if "nv" in encoding else b""
    with pytest.raises(DataError, match="left"):
        frame_from_message(message, "left", 0)


def room(seed, colour=1.0, noise=2.0):
    """Return a picture with areas of colour, shades, textures and noise."""
    rng = np.random.default_rng(seed)
    areas = rng.normal(128, 60, (6, 8, 1)) + colour * rng.normal(0, 35, (6, 8, 3))
    areas = np.repeat(np.repeat(areas, 20, axis=0), 20, axis=1)
    y, x = np.mgrid[:120, :160]
    texture = 12 * np.sin(x / 1.7 + rng.uniform(0, 6)) * np.sin(y / 2.3)
    shades = areas + texture[..., None] * (rng.random((120, 160, 1)) < 0.7)
    seen = cv2.GaussianBlur(shades, (3, 3), 0) + rng.normal(0, noise, shades.shape)
    return np.clip(seen, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("colour", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("seed", range(4))
def test_brightness_where_the_stated_encoding_has_colour_is_seen(seed, colour):
    picture = room(seed, colour)
    for stated, luma in (("yuv422", 1), ("uyvy", 1), ("yuyv", 0), ("yuv422_yuy2", 0), ("8UC2", 0)):
        right = shown_by(image(packed_yuv(picture, luma), stated), "it")
        assert right.encoding == "" and (stated == "8UC2") == ("read as yuyv" in right.told)
        wrong = shown_by(image(packed_yuv(picture, 1 - luma), stated), "it")
        other = "uyvy" if luma == 0 else "yuyv"
        assert wrong.encoding == other and f"has encoding {stated}" in wrong.told and other in wrong.told


def test_pictures_without_details_tell_nothing_of_their_encoding():
    for picture in (np.zeros((60, 80, 3), np.uint8), np.full((60, 80, 3), 200, np.uint8)):
        assert shown_by(image(packed_yuv(picture, 0), "yuv422"), "it") is None
    assert shown_by(image(packed_yuv(smooth_picture(), 0), "yuyv"), "it").encoding == ""


def test_what_is_assumed_of_an_encoding_is_told():
    told = {
        name: shown_by(image(data, name), "it").told
        for name, data in (
            ("8UC4", np.zeros((4, 4, 4), np.uint8)),
            ("bgr8", np.zeros((4, 4, 3), np.uint8)),
            ("mono16", np.full((4, 4), 4000, np.uint16)),
            ("mono12", np.full((4, 4), 4000, np.uint16)),
        )
    }
    assert told["8UC4"] == "it has encoding 8UC4, which names no colours: read as bgra"
    assert told["mono16"] == "it has 12 bits in 16: scaled to the full range"
    assert told["bgr8"] == told["mono12"] == ""


class TestCompressed:
    """Pictures of CompressedImage."""

    def message(self, data, words):
        header = bag_messages().header(5, "left")
        return SimpleNamespace(header=header, format=words, data=cv2.imencode(".png", data)[1].tobytes())

    def test_of_sixteen_bits_are_stretched(self):
        grey = smooth_picture()[..., 0]
        message = self.message(sixteen(grey, 12), "mono16; png compressed ")
        assert np.abs(frame_from_message(message, "left", 0).image.astype(int) - grey[..., None]).max() <= 1

    @pytest.mark.parametrize("bits", [8, 12])
    @pytest.mark.parametrize(
        ("words", "encoding"),
        [
            ("bayer_rggb{}; png compressed ", ""),
            ("bayer_rggb{0}; png compressed bayer_rggb{0}", ""),
            ("mono{}; png compressed ", "bayer_rggb8"),
        ],
    )
    def test_mosaics_get_their_colours(self, words, encoding, bits):
        picture = smooth_picture()
        data = mosaic(picture, "rggb") if bits == 8 else sixteen(mosaic(picture, "rggb"), 12)
        message = self.message(data, words.format(8 if bits == 8 else 16))
        assert off(frame_from_message(message, "left", 0, encoding), picture) <= 7

    def test_that_were_demosaiced_stay_as_they_are(self):
        message = self.message(smooth_picture(), "bayer_rggb8; png compressed bgr8")
        assert off(frame_from_message(message, "left", 0), smooth_picture()) == 0

    def test_video_is_named_with_the_remedy(self):
        message = self.message(smooth_picture(), "h264")
        message.data = bytes(200)
        with pytest.raises(DataError, match=r"'h264'\) cannot be decoded, as it is video; .*republish"):
            frame_from_message(message, "left", 0)
