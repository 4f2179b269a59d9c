"""The page of the calibration guide shows images, corners, covered cells, links and the next steps."""

import struct

import cv2
import numpy as np
import pytest
from browser import Browser, find_browser

from panoptic_ros.calibration.guide import CameraGuide, GuideState
from panoptic_ros.running.viewer.serving import served
from panoptic_ros.view.guide_table import ENOUGH, NOT_USABLE, USABLE, guide_lines
from panoptic_ros.view.page.guide_scene import FINE, GuideScene, guide_document, packed_picture
from panoptic_ros.view.page.html import GUIDE, page
from panoptic_ros.view.page.live_talk import LiveTalk

SIZES = {"left": (640, 480), "right": (320, 240)}


def covered(*cells):
    found = np.zeros((3, 4), bool)
    for cell in cells:
        found[cell] = True
    return found


def state_of(error_m=None, enough=False):
    """Return a state in which left is ready and right needs more."""
    right = "" if enough else "cover the left edge"
    return GuideState(
        (
            CameraGuide("left", 20, covered((0, 0), (2, 3)), 5, (0.8, 2.25), True, ""),
            CameraGuide("right", 3, covered(), 0, None, False, right),
        ),
        {(0, 1): 4},
        error_m,
        "" if error_m else "camera right sees the board in 1 images",
        "",
        bool(error_m),
        enough,
    )


def jpeg_of(grey=200):
    return cv2.imencode(".jpg", np.full((120, 160, 3), grey, np.uint8))[1].tobytes()


def test_the_table_names_the_next_step_of_each_camera():
    lines = guide_lines(state_of(), "9 images recorded", ["camera left: no image for 3 s"])
    assert lines[1].split() == "left 20/15 17% 5 0.8 to 2.2 yes enough".split()
    assert lines[2].split()[:6] == "right 3/15 0% 0 - no".split() and "cover the left edge" in lines[2]
    assert "seen at once: left+right 4" in lines and "9 images recorded" in lines
    assert "not yet solvable: camera right sees the board in 1 images" in lines
    assert "camera left: no image for 3 s" in lines
    assert guide_lines(state_of(2e-3, True), "", [])[-1] == ENOUGH
    assert (lines[-1], guide_lines(state_of(2e-3), "", [])[-1]) == (NOT_USABLE, USABLE)


def test_the_document_has_what_the_page_draws():
    document = guide_document(state_of(2.5e-3), "r", [])
    assert document["error_mm"] == pytest.approx(2.5) and document["links"] == [[0, 1, 4]]
    assert document["cameras"][0]["covered"] == [[1, 0, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1]]
    assert guide_document(state_of(), "r", [])["error_mm"] is None


def test_corners_are_packed_before_the_image():
    data = packed_picture(b"jpeg", np.array([[-0.5, 239.5], [639.5, 479.5]]), (640, 480))
    assert struct.unpack("<I4H", data[:12]) == (2, 0, round(FINE / 2), FINE, FINE) and data[12:] == b"jpeg"


def test_a_slow_page_receives_the_newest_image_of_each_camera():
    scene = GuideScene(SIZES)
    client = scene.attach(lambda: None)
    for name in ("left", "right", "left"):
        scene.picture(name, name.encode(), np.zeros((0, 2)))
    assert [message.topic for message in scene.collect(client)] == [0, 1]
    scene.detach(client)
    scene.picture("left", b"", np.zeros((0, 2)))


@pytest.mark.skipif(find_browser() is None, reason="NO BROWSER: apt-get install chromium")
def test_a_browser_shows_all(tmp_path):
    scene = GuideScene(SIZES)
    scene.tell(state_of(2.5e-3), "9 images recorded", ["<b>camera left</b>: no image for 3 s"])
    with served(LiveTalk(scene), "127.0.0.1", 0, page(None, GUIDE)) as address, Browser(tmp_path) as browser:
        window = browser.open(address)
        window.wait("guide.guide")
        scene.picture("left", jpeg_of(), np.array([[320.0, 240.0]]))
        window.wait("guide.drawn > 0")
        assert window.evaluate("document.getElementById('views').scrollHeight <= innerHeight")
        text = window.evaluate("document.body.innerText")
        for words in (
            "2.5 mm",
            "cover the left edge",
            "9 images recorded",
            "20/15 views",
            "<b>camera left</b>",
        ):
            assert words in text, words
        assert window.complaints() == [] and window.hosts() <= {"127.0.0.1"}
        colour = "[...guide.views[0].canvas.getContext('2d').getImageData({}, {}, 1, 1).data]"
        shown = np.array([window.evaluate(colour.format(*at)) for at in ((80, 80), (240, 80), (320, 240))])
        assert (shown[0, 1] > shown[0, 0]) and (shown[1, 0] > shown[1, 1])  # covered: green, else red
        assert (shown[2, :2] > 200).all() and shown[2, 2] < 130  # the corner
