"""Boards: specifications, prints, and their detection in images."""

import cv2
import numpy as np
import pytest

from panoptic_ros.calibration.board_artwork import black_rectangles
from panoptic_ros.calibration.board_detector import BoardAppearance, BoardDetector
from panoptic_ros.calibration.boards import Board, parse_board
from panoptic_ros.errors import UsageError

PIXELS_PER_M = 3000.0
BORDER_M = 0.03
SPECIFICATIONS = (
    "charuco:5x7:40mm",
    "charuco:6x8:30mm/22mm:DICT_5X5_100",
    "checkerboard:8x6:25mm",
    "aprilgrid:4x3:40mm",
    "aprilgrid:4x3:40mm/8mm",
)


def picture(board):
    """Return an image of the print on white paper, and the pixel of its upper left corner."""
    width, height = board.extent
    shape = [round((side + 2 * BORDER_M) * PIXELS_PER_M) for side in (height, width)]
    image = np.full(shape, 255, np.uint8)
    for x, y, w, h in black_rectangles(board):
        rows = [round((v + BORDER_M) * PIXELS_PER_M) for v in (y, y + h)]
        columns = [round((v + BORDER_M) * PIXELS_PER_M) for v in (x, x + w)]
        image[rows[0] : rows[1], columns[0] : columns[1]] = 0
    return image


def expected(board, numbers):
    """Return the pixels of points of the board in its picture."""
    flat = board.points[numbers, :2].copy()
    if board.kind == "aprilgrid":  # y points up from the lower left tag
        flat[:, 1] = board.extent[1] - board.part - flat[:, 1]
        flat[:, 0] += board.part
    else:
        flat += board.size  # from the outer corner to the first inner corner
    return (flat + BORDER_M) * PIXELS_PER_M - 0.5


@pytest.mark.parametrize("text", SPECIFICATIONS)
def test_a_print_is_detected_at_its_true_size(text):
    board = parse_board(text)
    numbers, pixels, appearance, _ = BoardDetector(board).detect(picture(board))
    assert len(numbers) == len(board.points) and appearance == BoardAppearance(False, False)
    np.testing.assert_allclose(pixels, expected(board, numbers), atol=0.3)


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("mirrored", [False, True])
def test_inverted_and_mirrored_prints_are_detected(inverted, mirrored):
    board = parse_board("charuco:5x7:40mm")
    image = picture(board)
    seen = 255 - image if inverted else image
    seen = np.ascontiguousarray(seen[:, ::-1]) if mirrored else seen
    numbers, pixels, appearance, _ = BoardDetector(board).detect(seen)
    assert appearance == BoardAppearance(inverted, mirrored)
    straight = expected(board, numbers)
    if mirrored:
        straight[:, 0] = image.shape[1] - 1 - straight[:, 0]
    np.testing.assert_allclose(pixels, straight, atol=0.3)


def test_tags_turned_by_half_a_turn_keep_their_corners():
    board = parse_board("aprilgrid:4x3:40mm")
    image = picture(board)
    side = round(board.size * PIXELS_PER_M)
    for x, y in {tuple(np.round(p - [0, 0]).astype(int)) for p in expected(board, np.arange(0, 48, 4)) + 0.5}:
        tag = image[y : y + side, x : x + side]
        image[y : y + side, x : x + side] = tag[::-1, ::-1]
    numbers, pixels, *_ = BoardDetector(board).detect(image)
    np.testing.assert_allclose(pixels, expected(board, numbers), atol=0.5)


def test_no_board_gives_nothing():
    noise = np.random.default_rng(0).integers(0, 255, (240, 320), dtype=np.uint8)
    for text in SPECIFICATIONS:
        assert BoardDetector(parse_board(text)).detect(noise) is None


def test_another_board_of_the_same_markers_is_not_taken():
    """Count its markers, by which the report names images of another board."""
    image, detector = picture(parse_board("charuco:7x7:40mm")), BoardDetector(parse_board("charuco:5x7:40mm"))
    assert detector.detect(image) is None
    assert detector.partial[0] == 0 and detector.partial[1] > 10


def test_corners_of_a_checkerboard_keep_their_numbers_in_any_turn():
    board = parse_board("checkerboard:9x6:25mm")
    first = None
    for turn in range(4):
        image = np.ascontiguousarray(np.rot90(picture(board), turn))
        _, pixels, *_ = BoardDetector(board).detect(image)
        for _ in range(turn):  # back to the picture
            pixels = np.stack([image.shape[0] - 1 - pixels[:, 1], pixels[:, 0]], axis=1)
            image = image.T
        first = pixels if first is None else first
        np.testing.assert_allclose(pixels, first, atol=0.3)


def test_points_are_those_of_opencv():
    board = parse_board("charuco:5x7:40mm")
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    theirs = cv2.aruco.CharucoBoard((5, 7), 0.04, 0.03, dictionary).getChessboardCorners()
    np.testing.assert_allclose(board.points, theirs - theirs[0], atol=1e-7)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("charuco", "is not understood; examples: charuco:5x7:40mm"),
        ("charuco:5x7:40", "is not understood"),
        ("charuco:5x7:40km", "unknown unit km; units are mm, cm, m, in"),
        ("circles:5x7:40mm", "unknown board circles; boards are charuco, checkerboard, aprilgrid"),
        ("charuco:1x7:40mm", "a board of 1 x 7; give 2 to 100"),
        ("charuco:5x7:40m", "squares of 40 m; give 0.1 mm to 10 m"),
        ("charuco:5x7:40mm/50mm", "markers of 50 mm do not fit in squares of 40 mm"),
        ("charuco:5x7:40mm:DICT_3X3", "unknown markers 'DICT_3X3'"),
        ("checkerboard:8x6:25mm/3mm", "a checkerboard has no markers"),
        ("charuco:5x7:4.0.0mm", "sizes must be numbers"),
    ],
)
def test_wrong_specifications_are_named(text, message):
    with pytest.raises(UsageError, match=message.replace("(", r"\(")):
        parse_board(text)


@pytest.mark.parametrize("columns, rows, turns", [(8, 6, 1), (7, 7, 3), (8, 5, 0)])
def test_turns_move_a_board_onto_itself(columns, rows, turns):
    board = Board("checkerboard", columns, rows, 0.03)
    assert len(board.turns) == turns
    for turn in board.turns:
        apart = np.linalg.norm(turn.apply(board.points)[:, None] - board.points[None], axis=2)
        np.testing.assert_allclose(apart.min(axis=1), 0.0, atol=1e-12)
        assert apart[0].argmin() != 0
    assert not Board("charuco", 8, 8, 0.03, 0.02, "DICT_4X4_50").turns


def test_two_identical_boards_in_an_image_are_seen():
    board = parse_board("charuco:5x7:40mm")
    one = picture(board)
    found = BoardDetector(board).detect(np.concatenate([one, one], axis=1))
    assert found.repeated > 10 and len(found.numbers) == 0
    assert BoardDetector(board).detect(one).repeated == 0
