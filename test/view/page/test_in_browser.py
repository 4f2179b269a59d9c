"""The page in a headless browser without a GPU: people at their pixels, images, no word to others."""

import asyncio
import threading
from contextlib import contextmanager

import numpy as np
import pytest
from browser import Browser, find_browser
from recorded_scene import GREY, SIZE, START_NS, make_patches, make_poses, make_rig, places, write_scene

from panoptic_ros.io.colors import rgb_of
from panoptic_ros.view.page.one_file import one_file
from panoptic_ros.view.page.recorded import RecordedScene
from panoptic_ros.view.page.recorded_talk import RecordedTalk
from panoptic_ros.view.page.server import PageServer

pytestmark = pytest.mark.skipif(
    find_browser() is None, reason="NO BROWSER: the viewer's page is not tested (apt-get install chromium)"
)
RIG = make_rig()


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Browser(tmp_path_factory.mktemp("profile")) as found:
        yield found


@contextmanager
def serving(bag):
    """The address of a server in a thread."""
    scene, told, over = RecordedScene(bag, "test"), [], threading.Event()
    ready = threading.Event()

    async def serve():
        async with PageServer(RecordedTalk(scene), "127.0.0.1", 0).listening() as where:
            told.append(where)
            ready.set()
            while not over.is_set():
                await asyncio.sleep(0.05)

    thread = threading.Thread(target=lambda: asyncio.run(serve()))
    thread.start()
    assert ready.wait(10)
    yield told[0]
    over.set()
    thread.join()


@pytest.fixture(scope="module")
def address(recording):
    with serving(recording) as found:
        yield found


@pytest.fixture
def page(browser, address):
    found = browser.open(address)
    found.wait("panoptic.ready")
    yield found
    assert found.complaints() == []
    assert found.hosts() <= {"127.0.0.1"}
    found.call("Page.close")


def picture(page, tmp_path):
    """The window, (H, W, 3) RGB."""
    import cv2

    data = page.screenshot(tmp_path / "page.png")
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


def is_colored(image, pixel, identity, away=2):
    """Whether the colour of a person, in any light, is within some px of a place."""
    return has_color(image, pixel, rgb_of(identity), away)


def has_color(image, pixel, rgb, away=2):
    x, y = np.round(pixel).astype(int)
    near = image[max(0, y - away) : y + away + 1, max(0, x - away) : x + away + 1]
    near = near.reshape(-1, 3).astype(float)
    wanted = np.array(rgb) - np.mean(rgb)
    found = near - near.mean(1, keepdims=True)
    strength = np.linalg.norm(found, axis=1)
    cosine = found @ wanted / np.maximum(strength * np.linalg.norm(wanted), 1e-9)
    return bool(((cosine > 0.9) & (strength > 25)).any())


@pytest.mark.parametrize("index", [0, 45, 99])
def test_people_are_where_they_are_projected_to(page, tmp_path, index):
    page.evaluate(f"panoptic.seek({round(index * 1e9 / 30)} + 1000)")
    people = places(index)
    page.wait(f"panoptic.ready && panoptic.page.instant.index === {index}")
    page.wait(f"panoptic.tilePixels('cam0', 2).index === {index}")
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    poses, image = make_poses(RIG, index, START_NS), picture(page, tmp_path)
    seen = 0
    for person, identity in enumerate(people):
        for camera in RIG.cameras:
            pixels, _ = camera.project(poses.positions[person])
            told = page.evaluate(f"panoptic.tilePixels('{camera.name}', {identity})")
            assert told["frame"] == 1000 + index and told["t"] - told["preview"] == 2_000_000
            assert np.abs(np.array(told["pixels"]) - pixels).max() < 1e-3
            box, scale = told["box"], told["box"]["width"] / SIZE[0]
            for pixel in pixels[camera.contains(pixels)]:
                assert is_colored(image, (pixel + 0.5) * scale + [box["x"], box["y"]], identity), camera.name
                seen += 1
        for pixel in page.evaluate(f"panoptic.spacePixels({identity})"):
            assert is_colored(image, pixel, identity)
    assert seen >= 20 * len(people)


def test_every_tile_has_its_image(page, tmp_path):
    page.wait("panoptic.stats().images === 4")
    image = picture(page, tmp_path)
    for camera in RIG.names:
        box = page.evaluate(f"panoptic.tilePixels('{camera}', 2)")["box"]
        corner = image[int(box["y"]) + 4, int(box["x"]) + 4]
        assert np.abs(corner.astype(int) - GREY).max() < 6


def test_ids_are_marked_on_the_time_line_and_people_come_and_go(page):
    page.evaluate("panoptic.seek(0.5e9)")
    assert page.wait("panoptic.ready && panoptic.stats().ids.join() === '2'")
    page.evaluate("panoptic.seek(3.5e9)")
    assert page.wait("panoptic.ready && panoptic.stats().ids.join() === '7'")


def test_after_a_seek_people_and_images_come_in_one_picture(page):
    page.wait("panoptic.stats().images === 4 && [0, 1].every((k) => panoptic.page.blocks.isThere(k * 1e9))")
    page.evaluate("panoptic.page.holdMs = 1e6; panoptic.seek(0.5e9)")  # however slow it is here
    page.wait("panoptic.ready && panoptic.page.instant.index === 15")
    page.evaluate("""(() => {
        const seen = window.seen = [], page = panoptic.page, before = page.drawn;
        const look = () => {
            const told = panoptic.stats();
            seen.push([page.drawn - before, page.instant.t, ...told.tiles.map(([, t]) => t)]);
            if (seen.at(-1)[0] < 1 || !page.blocks.isThere(3.6e9)) requestAnimationFrame(look);
            else seen.whole = true;
        };
        panoptic.seek(3.5e9);
        requestAnimationFrame(look);
    })()""")
    page.wait("window.seen.whole")
    seen = np.array(page.evaluate("window.seen"))
    assert set(seen[:, 0]) == {0, 1}
    assert np.all(np.abs(seen[:, 1:] - np.where(seen[:, :1] == 1, 3.5e9, 0.5e9)) < 0.2e9)


def test_playing_stepping_and_keys(page):
    page.press(" ", "Space")
    page.wait("panoptic.page.player.t > 0.3e9")
    page.press(" ", "Space")
    page.press("Home")
    page.wait("panoptic.stats().t === 0")
    page.press("ArrowRight")
    page.press("ArrowRight")
    page.wait("panoptic.page.instant.index === 2")
    page.press("ArrowLeft")
    page.wait("panoptic.page.instant.index === 1")
    assert page.evaluate("panoptic.page.player.t") < 0.1e9  # a step is an instant, not a second


def test_a_click_on_a_joint_tells_its_views_and_residuals(page):
    page.evaluate("panoptic.seek(1.5e9)")
    page.wait("panoptic.ready && panoptic.page.instant.index === 45 && panoptic.spacePixels(7)")
    x, y = page.evaluate("panoptic.spacePixels(7)[1]")
    page.click(x, y)
    panel = "document.getElementById('inspector')"
    text = page.wait(f"!{panel}.hidden && {panel}.innerText")
    assert "id 7" in text and "head" in text
    assert text.count("5.0 (3, -4)") == 4
    assert "10.0, 20.0, 30.0" in text
    (xa, ya), (xb, yb) = page.evaluate("panoptic.spacePixels(7).slice(0, 2)")
    page.click(0.5 * (xa + xb), 0.5 * (ya + yb))
    text = page.wait(f"{panel}.innerText.includes('rms px') && {panel}.innerText")
    assert "id 7" in text and text.count("5.0") == 4
    page.press("Escape")
    page.wait("document.getElementById('inspector').hidden")


def test_every_layer_can_be_switched_on(page):
    layers = page.evaluate("[...document.querySelectorAll('#layers button')].map((b) => b.textContent)")
    assert layers == ["Skeletons", "Covariance", "Trails", "Cameras", "2D people", "Score maps", "Depth"]
    for number in (5, 6):
        page.evaluate(f"document.querySelectorAll('#layers button')[{number}].click()")
    page.evaluate("panoptic.seek(2e9)")
    page.wait("panoptic.ready && panoptic.page.instant.index === 60")


def test_patches_lie_where_they_are_projected_to_once_they_are_shown(browser, tmp_path):
    write_scene(tmp_path / "bag", 10, patches=True)
    with serving(tmp_path / "bag") as address:
        page = browser.open(address)
        page.wait("panoptic.ready")
        positions = make_patches(RIG, 0, START_NS).positions

        def drawn():
            page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
            image, found = picture(page, tmp_path), {}
            for camera in RIG.cameras:
                pixels, _ = camera.project(positions)
                box = page.evaluate(f"panoptic.tilePixels('{camera.name}', 2)")["box"]
                spots = (pixels + 0.5) * (box["width"] / SIZE[0]) + [box["x"], box["y"]]
                found[camera.name] = [
                    has_color(image, spot, colors[part], 1)
                    for part, spot in enumerate(spots)
                    if camera.contains(pixels)[part]
                ]
            space = page.evaluate(f"panoptic.pixelsOf({positions.tolist()})")
            found["space"] = [has_color(image, spot, rgb, 1) for spot, rgb in zip(space, colors)]
            return found

        colors = page.evaluate("Array.from({ length: 6 }, (_, part) => panoptic.rgbOfPart(part))")
        before = drawn()
        page.evaluate("panoptic.switchLayer('patches')")
        page.wait("panoptic.ready && panoptic.page.store.otherAt('patches', 0)")
        after = drawn()
        last = RIG.names[-1]
        assert all(all(found) for name, found in after.items() if name != last) and len(after["cam1"]) == 6
        assert not any(any(found) for found in before.values()) and after[last] == before[last]
        assert page.complaints() == [] and page.hosts() <= {"127.0.0.1"}
        page.call("Page.close")


def test_one_file_is_opened_from_a_disk(browser, recording, tmp_path):
    scene = RecordedScene(recording, "a file")
    scene.scan(lambda: False, lambda: None)
    path = tmp_path / "result.html"
    path.write_bytes(one_file(scene))
    page = browser.open(path.as_uri())
    page.wait("panoptic.ready && panoptic.stats().images === 4")
    page.evaluate("panoptic.seek(3.5e9)")
    page.wait("panoptic.ready && panoptic.stats().ids.join() === '7' && panoptic.stats().images === 4")
    assert page.complaints() == []
    assert page.hosts() <= {None}
    page.call("Page.close")
