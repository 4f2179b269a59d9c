"""Wands: their specification, their markers in images, and rigs from them."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from panoptic_ros.calibration.lens_start import LensModel
from panoptic_ros.calibration.projection import LENS
from panoptic_ros.calibration.rig_start import CameraInput
from panoptic_ros.calibration.solve import calibrate_from
from panoptic_ros.calibration.target_views import TargetView
from panoptic_ros.calibration.wand_start import start_wand
from panoptic_ros.calibration.wands import bright_spots, in_wand_order, parse_wand, without_lamps
from panoptic_ros.errors import CalibrationError, UsageError
from panoptic_ros.simulation.board_sessions import BoardScene, simulate_board
from panoptic_ros.study.calibration.boards import errors_of

WANDS = ["wand:500mm", "wand:0/150/500mm", "wand:0,0/150,-200/150,0/500,0mm"]


def known_lens(camera, rng, focal=0.005, centre_px=3.0, term=0.02):
    """Return a lens and its information, with errors drawn from it."""
    matrix = camera.intrinsics.matrix
    sd = np.array([focal * matrix[0, 0]] * 2 + [centre_px] * 2 + [term] * 5)
    lens, information = np.zeros(LENS), np.zeros((LENS, LENS))
    lens[:4] = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    lens[4:9] = camera.intrinsics.distortion
    lens[:9] += sd * rng.standard_normal(9)
    information[:9, :9] = np.diag(1.0 / sd**2)
    return lens, information


def calibrated(wand, scene, seed, flipped=False):
    session, rng = simulate_board(scene, wand.points, seed), np.random.default_rng(seed)
    inputs = [CameraInput(c.name, c.image_size, LensModel(), known_lens(c, rng)) for c in session.rig.cameras]
    views = [TargetView(*view) for view in session.views]
    if flipped:
        views = [replace(v, pixels=v.pixels[::-1]) if rng.random() < 0.5 else v for v in views]
    start = start_wand(inputs, views, wand.points)
    return calibrate_from(start, inputs, wand.points, scene.smooth), session


@pytest.mark.parametrize("text", WANDS)
def test_errors_are_as_large_as_stated(text):
    ratios, nees = [], []
    for seed in range(3):
        found, session = calibrated(
            parse_wand(text), BoardScene(4, 300, all_round=True), seed, len(text) < 12
        )
        errors = errors_of(found, session)
        ratios.append(errors["ratio"])
        nees.append(errors["nees"])
    assert 0.4 < np.median(ratios) < 1.6 and 0.4 < np.mean(nees) < 2.0


def test_clocks_are_found_with_a_wand_of_two_markers():
    scene = BoardScene(4, 200, all_round=True, smooth=True, lag_s=0.03, rate_hz=15)
    found, session = calibrated(parse_wand(WANDS[0]), scene, 1, flipped=True)
    late = found.state.cameras.offsets - (session.offsets - session.offsets[0])
    assert np.abs(late[1:]).max() < 0.002


def test_a_wand_needs_lenses_and_links():
    wand = parse_wand(WANDS[1])
    session = simulate_board(BoardScene(3, 40, all_round=True), wand.points, 0)
    views = [TargetView(*view) for view in session.views]
    inputs = [CameraInput(c.name, c.image_size) for c in session.rig.cameras]
    with pytest.raises(CalibrationError, match="a wand needs known lenses: cameras cam0, cam1, cam2"):
        start_wand(inputs, views, wand.points)
    rng = np.random.default_rng(0)
    inputs = [own._replace(known=known_lens(c, rng)) for own, c in zip(inputs, session.rig.cameras)]
    apart = [view if view.camera < 2 else replace(view, instant=view.instant + 100) for view in views]
    with pytest.raises(CalibrationError, match="camera cam2 and cam0 are not linked"):
        start_wand(inputs, apart, wand.points)


@pytest.mark.parametrize(
    "text, message",
    [
        ("wand:", "is not understood"),
        ("wand:5furlong", "is not understood"),
        ("wand:0/1/2/3/4mm", "a wand of 5 markers"),
        ("wand:0/5mm", "closer than 20 mm"),
        ("wand:0,0/250,-200/250,0/500,0mm", "the wand looks the same from both sides"),
        ("wand:0/1,2,3mm", "a marker has x, or x,y"),
        ("wand:0/1..5mm", "positions must be numbers"),
    ],
)
def test_wrong_specifications_are_named(text, message):
    with pytest.raises(UsageError, match=message):
        parse_wand(text)


def test_spots_are_found_to_a_tenth_of_a_pixel():
    rng = np.random.default_rng(0)
    true = rng.uniform([40, 40], [600, 440], (6, 2))
    rows, columns = np.mgrid[:480, :640]
    image = np.full((480, 640), 20.0)
    for x, y in true:
        image += 400.0 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 2.5**2))
    cv2.line(image, (100, 470), (500, 470), 255.0, 3)  # a lamp tube is not round
    found = bright_spots(np.clip(image, 0, 255).astype(np.uint8))
    apart = np.linalg.norm(found[:, None] - true[None], axis=2)
    assert len(found) == len(true) and apart.min(axis=0).max() < 0.15


def test_lamps_are_left_out():
    rng = np.random.default_rng(1)
    lamp = np.array([[300.0, 50.0]])
    moving = [rng.uniform(0, 400, (2, 2)) for _ in range(30)]
    found = without_lamps([np.concatenate([lamp + 0.3 * rng.standard_normal(2), own]) for own in moving])
    assert all(len(own) == 2 for own in found) and np.allclose(found[0], moving[0])


@pytest.mark.parametrize("text", WANDS[1:])
def test_markers_are_put_in_the_order_of_the_wand(text):
    wand = parse_wand(text)
    session = simulate_board(BoardScene(2, 60, all_round=True, noise_px=0.2), wand.points, 3)
    rng, right, whole = np.random.default_rng(0), 0, 0
    for view in session.views:
        if len(view.numbers) == len(wand.points):
            mixed = view.pixels[rng.permutation(len(view.pixels))]
            right += np.array_equal(in_wand_order(wand, mixed), view.pixels)
            whole += 1
    assert whole > 40 and right > 0.9 * whole
