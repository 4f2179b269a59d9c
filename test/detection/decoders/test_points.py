import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.detection.decoders.points import (
    decode_detections,
    decode_rtmo,
    decode_yolo,
    decode_yolo_end_to_end,
    decode_yolox,
)
from panoptic_ros.detection.people import suppress_overlaps

POINTS = np.array([[[1, 2, 0.5], [3, 4, 0.6]], [[5, 6, 0.7], [7, 8, 1.2]]], np.float32)
BOXES = np.array([[0, 0, 10, 20], [30, 30, 50, 80]], np.float32)


def test_rtmo():
    outputs = {"boxes": np.c_[BOXES, np.float32([0.4, 0.9])], "points": POINTS}
    people = decode_rtmo(outputs, 0.1, 0.5, 10)
    np.testing.assert_allclose(people.person_scores, [0.9, 0.4], atol=1e-6)  # best first
    np.testing.assert_allclose(people.points[0], [[5, 6], [7, 8]])
    np.testing.assert_allclose(people.scores[0], [0.7, 1.0], atol=1e-6)
    np.testing.assert_allclose(people.boxes, BOXES[::-1])
    assert len(decode_rtmo(outputs, 0.5, 0.5, 10)) == 1
    assert len(decode_rtmo({k: v[:0] for k, v in outputs.items()}, 0.1, 0.5, 10)) == 0


def test_yolo_gives_centres_and_sizes_and_needs_suppression():
    rows = []
    double = (BOXES[0] + 1, 0.7, POINTS[0])
    for box, score, points in ((BOXES[0], 0.8, POINTS[0]), (BOXES[1], 0.6, POINTS[1]), double):
        centre, size = (box[:2] + box[2:]) / 2, box[2:] - box[:2]
        rows.append(np.r_[centre, size, score, points.ravel()])
    people = decode_yolo({"people": np.array(rows, np.float32).T}, 0.25, 0.5, 10)
    assert len(people) == 2
    np.testing.assert_allclose(people.boxes, BOXES, atol=1e-5)
    np.testing.assert_allclose(people.points, POINTS[..., :2])


def test_yolo_end_to_end_keeps_people_only():
    rows = np.stack(
        [
            np.r_[BOXES[0], 0.8, 0, POINTS[0].ravel()],
            np.r_[BOXES[1], 0.9, 3, POINTS[1].ravel()],
            np.r_[np.zeros(6), POINTS[0].ravel()],
        ]
    ).astype(np.float32)
    people = decode_yolo_end_to_end({"people": rows}, 0.25, 10)
    assert len(people) == 1 and people.person_scores[0] == np.float32(0.8)


def test_yolox_grids():
    size = (64, 96)
    rows = np.zeros((8 * 12 + 4 * 6 + 2 * 3, 6), np.float32)  # strides 8, 16, 32
    row = 8 * 12 + 2 * 6 + 3  # stride 16, row 2, column 3
    rows[row] = [0.5, 0.25, np.log(2.0), np.log(1.5), 0.9, 0.8]
    people = decode_yolox({"people": rows}, size, 0.3, 0.5, 10)
    np.testing.assert_allclose(people.person_scores, [0.72], atol=1e-6)
    x, y = 3.5 * 16, 2.25 * 16
    np.testing.assert_allclose(people.boxes, [[x - 16, y - 12, x + 16, y + 12]], rtol=1e-6)
    assert people.points.shape == (1, 0, 2)


def test_detections_with_labels():
    outputs = {"boxes": np.c_[BOXES, np.float32([0.4, 0.9])], "labels": np.array([0, 17])}
    np.testing.assert_allclose(decode_detections(outputs, 0.1, 0.5, 10).boxes, BOXES[:1])
    del outputs["labels"]
    assert len(decode_detections(outputs, 0.1, 0.5, 10)) == 2


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000), st.integers(0, 12), st.sampled_from([0.2, 0.5, 0.8]))
def test_suppression_keeps_the_best_and_nothing_that_overlaps_it(seed, count, iou):
    rng = np.random.default_rng(seed)
    low = rng.uniform(0, 20, (count, 2))
    boxes = np.concatenate([low, low + rng.uniform(1, 20, (count, 2))], axis=1)
    scores = rng.random(count)
    kept = suppress_overlaps(boxes, scores, iou).tolist()

    def overlap(a, b):
        w, h = np.minimum(boxes[a, 2:], boxes[b, 2:]) - np.maximum(boxes[a, :2], boxes[b, :2])
        shared = max(w, 0) * max(h, 0)
        return shared / (np.prod(boxes[a, 2:] - boxes[a, :2]) + np.prod(boxes[b, 2:] - boxes[b, :2]) - shared)

    assert all(overlap(a, b) <= iou for a in kept for b in kept if a != b)
    for dropped in set(range(count)) - set(kept):
        assert any(scores[k] >= scores[dropped] and overlap(k, dropped) > iou for k in kept)
    assert kept == sorted(kept, key=lambda k: -scores[k])


def test_limits():
    boxes = np.arange(40, dtype=np.float32).reshape(10, 4) * 100
    rows = np.c_[boxes[:, :2], boxes[:, :2] + 5, np.full(10, 0.5)]
    outputs = {"boxes": rows, "points": np.zeros((10, 1, 3))}
    assert len(decode_rtmo(outputs, 0.1, 0.5, 3)) == 3
    assert pytest.approx(0.5) == decode_rtmo(outputs, 0.1, 0.5, 3).person_scores[0]
