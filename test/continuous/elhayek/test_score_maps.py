"""Score maps as image term: cells, gradients, covariances, ambiguous maps and the whole pass."""

from dataclasses import replace
from functools import partial

import hinged_people
import numpy as np
import pytest
from hinged_people import MODEL, NAMES, SKELETONS, HingedCapture, freedoms

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.elhayek.energy import SegmentEnergy, minimise
from panoptic_ros.continuous.elhayek.passes import ElhayekPass
from panoptic_ros.continuous.elhayek.polynomials import basis
from panoptic_ros.continuous.elhayek.score_maps import (
    WIDTHS,
    ScoreMapMeasurements,
    ScoreMapTerm,
    timed_maps,
)
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.simulation.drawn_maps import MapDrawing, draw_maps
from panoptic_ros.stage import untold

SKELETON, DRAWING = SKELETONS[0], MapDrawing()
LEFT, RIGHT = NAMES.index("lAnkle"), NAMES.index("rAnkle")


def mapped(capture, spoil=lambda maps: maps):
    """Yield the views of a capture, in sets of one, with drawn score maps."""
    for item in capture.sets:
        yield replace(item, views=tuple(replace(v, maps=spoil(draw_maps(v, DRAWING))) for v in item.views))


def cells_of(capture, spoil=lambda maps: maps):
    """Rig, and the cells of all score maps, ordered by time."""
    arrays = RigArrays.of(capture.rig)
    views = [view for item in mapped(capture, spoil) for view in item.views]
    times = [1e-9 * (view.stamp_ns - hinged_people.START_NS) for view in views]
    return arrays, [
        timed_maps(time, arrays.index[view.camera], view.maps, len(NAMES), arrays)
        for time, view in zip(times, views)
    ]


def with_ankles_in_both_maps(maps):
    """Return maps of both ankles that show both of them; the right place has the smaller score."""
    ankles = np.isin(maps.joints, (LEFT, RIGHT))
    sizes = maps.sizes.prod(axis=1)
    own = np.repeat(ankles, sizes)
    data = maps.data.copy()
    data[own] = (0.9 * data[own]).astype(np.uint8)
    return replace(
        maps,
        joints=np.r_[maps.joints, (LEFT + RIGHT) - maps.joints[ankles]],
        persons=np.r_[maps.persons, maps.persons[ankles]],
        corners=np.r_[maps.corners, maps.corners[ankles]],
        sizes=np.r_[maps.sizes, maps.sizes[ankles]],
        data=np.r_[data, maps.data[own]],
    )


def fitted(views, segment, arrays, start):
    """Coefficients (D, L) near `start` that fit the score maps of a segment, and the last energy."""
    measured, found = ScoreMapMeasurements(views, SKELETON, arrays), start
    for fit in range(measured.fits):
        term = measured.term(fit, segment, partial(poses_of, found, segment))
        energy = SegmentEnergy(segment, term, SKELETON.limits, start)
        found = minimise(energy, found, start.shape[1])
    return found, energy


def true_motion(segment, count=5):
    """Coefficients (D, count) of the true motion."""
    times = np.linspace(*segment, 200)
    return np.linalg.lstsq(basis(times, segment, count), freedoms(times), rcond=None)[0].T


def poses_of(coefficients, segment, times):
    """Degrees of freedom (T, D) at times (T,) s."""
    return basis(times, segment, coefficients.shape[1]) @ coefficients.T


def errors_of(coefficients, segment):
    """Errors (T, J) m of the joints inside a segment."""
    times = np.linspace(*segment, 9)[1:-1]
    found = poses_of(coefficients, segment, times)
    return np.linalg.norm(SKELETON.joints(found) - SKELETON.joints(freedoms(times)), axis=-1)


def alone(person, time):
    return person == 0


def test_cells_lie_about_the_projections_of_the_joints():
    capture = HingedCapture(cameras=3, seconds=0.3, noise_px=0.0, there=alone)
    arrays, views = cells_of(capture)
    for view in views:
        joints = SKELETON.joints(freedoms([view.time]))[0]
        local = joints @ arrays.rotations[view.camera].T + arrays.translations[view.camera]
        for j, place in enumerate(local[:, :2] / local[:, 2:]):
            own = view.joints == j
            if own.any():
                centre = np.average(view.means[own], axis=0, weights=view.scores[own])
                assert np.linalg.norm(centre - place) < 0.1 * view.side
        assert view.side == pytest.approx(10.0 / 800.0) and view.scores.max() <= 0.9


def test_gradients_are_those_of_differences_and_matrices_bound_the_energy():
    arrays, views = cells_of(HingedCapture(seconds=0.3))
    poses = freedoms([view.time for view in views])
    for width in WIDTHS:
        term = ScoreMapTerm(views, poses, width, SKELETON, arrays)
        at = poses + 0.03 * np.random.default_rng(0).standard_normal(poses.shape)
        sums, step = term.sums(at), 1e-6
        assert -1.0 < sums.energy < -0.1
        for t, d in [(0, 0), (3, 2), (5, 4), (8, 12), (11, 15), (2, 23)]:
            way = np.zeros_like(at)
            way[t, d] = step
            slope = (term.sums(at + way).energy - term.sums(at - way).energy) / (2.0 * step)
            assert sums.gradients[t, d] == pytest.approx(slope, rel=1e-3, abs=1e-7)
        assert np.linalg.eigvalsh(sums.matrices).min() > -1e-9


def test_the_minimum_is_the_true_motion_and_its_covariance_that_of_the_errors():
    segment = np.array([0.2, 0.5])
    true, squares = true_motion(segment), []
    start = true.copy()
    start[3:, 0] += 0.1
    values = basis(np.array([0.35]), segment, 5)[0]
    for noise_px in (0.0, 1.5):
        arrays, views = cells_of(HingedCapture(seconds=0.6, noise_px=noise_px, there=alone))
        found, energy = fitted(views, segment, arrays, start)
        assert errors_of(found, segment).mean() < (0.003 if noise_px == 0.0 else 0.012)
        covariance = np.einsum("l,dlem,m->de", values, energy.covariance(found), values)
        squares.append(((found - true) @ values)[:3] ** 2 / np.diag(covariance)[:3])
    assert (squares[1] < 12.0).all() and squares[1].mean() > 0.01


def test_the_higher_one_of_two_peaks_does_not_pull_a_joint_away():
    segment = np.array([0.2, 0.5])
    arrays, views = cells_of(HingedCapture(seconds=0.6, there=alone), with_ankles_in_both_maps)
    start = true_motion(segment)
    start[:3, 0] += (0.05, -0.05, 0.03)
    found, _ = fitted(views, segment, arrays, start)
    assert errors_of(start, segment)[:, [LEFT, RIGHT]].mean() > 0.06
    assert errors_of(found, segment)[:, [LEFT, RIGHT]].mean() < 0.02


def test_no_score_near_the_person_is_no_measurement():
    arrays, views = cells_of(HingedCapture(seconds=0.3, there=alone))
    measured, segment = ScoreMapMeasurements(views, SKELETON, arrays), np.array([0.0, 0.3])

    def away(times):
        return freedoms(times) + np.r_[0.0, 0.0, 4.0, np.zeros(SKELETON.freedoms - 3)]

    assert measured.term(0, segment, freedoms) is not None
    assert measured.term(0, segment, away) is None and measured.term(0, segment + 9.0, freedoms) is None


def test_the_pass_follows_people_who_walk():
    capture, times = HingedCapture(seconds=1.6), np.arange(0.3, 1.3, 0.013)
    context = replace(capture.context, extras={"segments": MODEL})
    recording = InMemoryRecording({"detection_sets": list(mapped(capture))})
    motion = ElhayekPass(ContinuousConfig(), context, fitted="maps").run(recording, untold)
    errors = capture.errors(motion, times)
    assert np.isfinite(errors).all() and errors.mean() < 0.008 and errors.max() < 0.08
