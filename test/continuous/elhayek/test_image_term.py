"""Similarity of blobs against integrals and differences, the colours of a body, and the energy of images."""

import hinged_people
import numpy as np
import pytest
from hinged_people import MODEL, SKELETONS, HingedCapture, freedoms, painted

from panoptic_ros.continuous.elhayek.blob_similarity import BlobPairs, PlaneBlobs, similarity
from panoptic_ros.continuous.elhayek.body_blobs import TimedBlobs, body_blobs, coloured
from panoptic_ros.continuous.elhayek.energy import SegmentEnergy, minimise
from panoptic_ros.continuous.elhayek.image_term import ImageTerm
from panoptic_ros.continuous.elhayek.polynomials import basis
from panoptic_ros.continuous.elhayek.quad_tree import image_blobs
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.io.body_models import read_body_shape

SKELETON = SKELETONS[0]


def some_blobs(seed=3):
    rng = np.random.default_rng(seed)
    image = PlaneBlobs(rng.normal(0.0, 1.0, (6, 2)), rng.uniform(0.3, 0.6, 6))
    means, sigmas = rng.normal(0.0, 1.0, (3, 2)), rng.uniform(0.3, 0.6, 3)
    pairs = BlobPairs(np.repeat(np.arange(6), 3), np.tile(np.arange(3), 6), rng.uniform(0.2, 1.0, 18))
    return image, rng.uniform(0.5, 1.0, 6), means, sigmas, pairs


def test_similarity_is_the_integral_of_products_up_to_the_similarity_to_itself():
    image, weights, means, sigmas, pairs = some_blobs()
    axis = np.linspace(-6.0, 6.0, 601)
    x = np.stack(np.meshgrid(axis, axis), -1)
    blobs = [np.exp(-0.5 * ((x - m) ** 2).sum(-1) / s**2) for m, s in zip(image.means, image.sigmas)]
    models = [np.exp(-0.5 * ((x - m) ** 2).sum(-1) / s**2) for m, s in zip(means, sigmas)]
    area = (axis[1] - axis[0]) ** 2
    expected = 0.0
    for i, blob in enumerate(blobs):
        own = sum(pairs.similar[3 * i + j] * (blob * model).sum() * area for j, model in enumerate(models))
        expected += weights[i] * min(own, (blob * blob).sum() * area)
    assert similarity(image, weights, means, sigmas, pairs).value == pytest.approx(expected, rel=1e-6)


def test_derivatives_of_the_similarity_are_those_of_differences():
    image, weights, means, sigmas, pairs = some_blobs()
    found, step = similarity(image, weights, means, sigmas, pairs), 1e-6
    for n in range(3):
        for axis in range(2):
            way = np.zeros((3, 2))
            way[n, axis] = step
            high, low = (similarity(image, weights, means + s * way, sigmas, pairs).value for s in (1, -1))
            assert found.by_means[n, axis] == pytest.approx((high - low) / (2 * step), abs=1e-6)
        way = step * (np.arange(3) == n)
        high, low = (similarity(image, weights, means, sigmas + s * way, pairs).value for s in (1, -1))
        assert found.by_sigmas[n] == pytest.approx((high - low) / (2 * step), abs=1e-6)


@pytest.fixture(scope="module")
def scene():
    """Rig, images of half a second and the coloured body of the first person."""
    capture = HingedCapture(seconds=0.4)
    arrays = RigArrays.of(capture.rig)
    images = sorted(
        (
            TimedBlobs(
                1e-9 * (frame.stamp_ns - hinged_people.START_NS),
                arrays.index[frame.camera],
                image_blobs(frame.image, capture.rig.cameras[arrays.index[frame.camera]]),
            )
            for frame in painted(capture)
        ),
        key=lambda image: image.time,
    )
    poses = freedoms([image.time for image in images])
    bare = body_blobs(SKELETON, read_body_shape(MODEL))
    return arrays, images, coloured(bare, SKELETON, poses, images, arrays), poses


def test_every_blob_of_a_person_gets_the_colour_of_its_segment(scene):
    _, _, body, _ = scene
    assert len(body.radii) == len(body_blobs(SKELETON, read_body_shape(MODEL)).radii)
    # the painter gives hues of 80 degrees per segment
    hues = np.degrees(np.arctan2(body.colours[:, 1], body.colours[:, 0]))
    gaps = (hues - 80.0 * body.segments + 180.0) % 360.0 - 180.0
    assert np.median(np.abs(gaps)) < 8.0


def test_the_gradient_of_the_images_is_that_of_differences(scene):
    arrays, images, body, poses = scene
    term = ImageTerm(images, poses, body, SKELETON, arrays)
    at = poses + 0.03 * np.random.default_rng(0).standard_normal(poses.shape)
    sums, step = term.sums(at), 1e-6
    assert -1.0 < sums.energy < -0.01
    for t, d in [(0, 0), (3, 2), (5, 4), (8, 12), (11, 15), (20, 17), (2, 23)]:
        way = np.zeros_like(at)
        way[t, d] = step
        slope = (term.sums(at + way).energy - term.sums(at - way).energy) / (2.0 * step)
        assert sums.gradients[t, d] == pytest.approx(slope, rel=1e-3, abs=1e-6)
    assert np.linalg.eigvalsh(sums.matrices).min() > -1e-9


def test_a_person_who_is_off_by_a_decimetre_is_pulled_back(scene):
    arrays, images, body, _ = scene
    times = np.array([image.time for image in images])
    segment = np.array([times[0], times[-1]])
    true = np.linalg.lstsq(basis(times, segment, 4), freedoms(times), rcond=None)[0].T
    start = true.copy()
    start[:3, 0] += (0.1, -0.08, 0.05)
    found = start
    for _ in range(2):
        term = ImageTerm(images, basis(times, segment, 4) @ found.T, body, SKELETON, arrays)
        found = minimise(SegmentEnergy(segment, term, SKELETON.limits, start), found, 4)
    errors = [
        np.linalg.norm(
            SKELETON.joints(basis(times, segment, 4) @ c.T) - SKELETON.joints(freedoms(times)), axis=-1
        )
        for c in (start, found)
    ]
    assert errors[0].mean() > 0.12 and errors[1].mean() < 0.03
