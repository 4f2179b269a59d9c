"""The whole pass on exact simulated truth."""

from dataclasses import replace

import free_cameras
import numpy as np
import pytest
from free_cameras import START_NS, CaptureWithBystander, FreeCapture

from panoptic_ros.continuous.config import ContinuousConfig
from panoptic_ros.continuous.passes import ContinuousPass
from panoptic_ros.domain import DetectionSet
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.graph.recording import InMemoryRecording
from panoptic_ros.stage import StageContext, untold


def solved(capture, **options):
    return ContinuousPass(ContinuousConfig(**options), capture.context).run(capture.recording, untold)


TIMES = np.arange(0.3, 3.7, 0.013)  # between the samples of all cameras


def test_motion_between_samples_of_cameras_that_never_expose_together():
    capture = FreeCapture()
    motion = solved(capture)
    errors = capture.errors(motion, TIMES)
    assert sorted(person.id for person in motion.people) == [0, 1]
    assert np.isfinite(errors).all() and errors.mean() < 0.004 and errors.max() < 0.025
    stamps = [START_NS + round(1e9 * time) for time in TIMES]
    inside = []
    for time, item in zip(TIMES, motion.sets(stamps)):
        for body, covariance in zip(item.positions, item.covariances):
            truth = min(capture.joints(time), key=lambda one: np.abs(one - body).mean())
            gaps = body - truth
            squares = np.einsum("ji,jik,jk->j", gaps, np.linalg.inv(covariance), gaps)
            inside.append((squares < 7.815).mean())
    assert 0.9 < np.mean(inside) < 0.999


def test_constant_biases_of_the_detector_are_in_the_covariances():
    capture = FreeCapture(seconds=1.0)
    floors = (0.01,) * len(free_cameras.captures.SKELETON)
    motion = solved(capture)
    (noise,) = motion.sets([START_NS + 500_000_000])
    skeleton = replace(capture.context.skeleton, bias_floors=floors)
    biased = ContinuousPass(ContinuousConfig(), replace(capture.context, skeleton=skeleton))
    (item,) = biased.run(capture.recording, untold).sets([START_NS + 500_000_000])
    assert np.allclose(item.covariances, noise.covariances + 1e-4 * np.eye(3))


def test_velocities_are_those_of_the_motion():
    capture = FreeCapture(noise_px=0.3)
    motion = solved(capture)
    times = TIMES - 1e-9 * (motion.reference_ns - START_NS)
    speeds = [np.linalg.norm(person.at(times, 1)[:, 2], axis=1) for person in motion.people]
    assert sorted(np.median(speed) for speed in speeds) == pytest.approx([0.6, 1.4], rel=0.05)


def test_views_that_lie_do_no_harm():
    def spoil(pixels, rng, camera):
        wild = rng.random(pixels.shape[:2]) < 0.02
        pixels[wild] += rng.normal(0.0, 60.0, (int(wild.sum()), 2))

    capture = FreeCapture(spoil=spoil)
    errors = capture.errors(solved(capture), TIMES)
    assert np.isfinite(errors).all() and errors.mean() < 0.006 and np.quantile(errors, 0.99) < 0.03


@pytest.mark.parametrize(  # px, by camera
    "wrong", [{2: (-34.0, -20.0), 4: (3.0, -40.0)}, {0: (16.0, 37.0), 3: (-22.0, 33.0)}]
)
def test_a_joint_that_two_cameras_see_elsewhere_for_long_is_where_the_others_see_it(wrong):
    wrist = free_cameras.captures.SKELETON.joint_names.index("lWrist")

    def spoil(pixels, rng, camera):
        pixels[:, wrist] += wrong.get(camera, (0.0, 0.0))

    capture = FreeCapture(rate=25.0, seconds=2.0, spoil=spoil)
    errors = capture.errors(solved(capture), TIMES[TIMES < 1.7])
    assert errors[:, :, wrist].mean() < 0.005


def test_sides_that_a_camera_exchanges_are_exchanged_back():
    mirror = np.array(free_cameras.captures.SKELETON.mirror)

    def spoil(pixels, rng, camera):
        if rng.random() < 0.15:
            pixels[0] = pixels[0][mirror]

    capture = FreeCapture(spoil=spoil)
    errors = capture.errors(solved(capture), TIMES)
    assert errors.mean() < 0.006


def test_people_come_and_go_and_keep_their_id_over_a_short_absence():
    def there(person, time):
        return time > 0.8 if person == 0 else not 1.6 < time < 2.6

    capture = FreeCapture(there=there)
    motion = solved(capture)
    shown = np.isfinite(capture.errors(motion, TIMES)[:, :, 0])
    assert not shown[0, TIMES < 0.75].any() and shown[0, TIMES > 0.85].all()
    assert not shown[1, (TIMES > 2.15) & (TIMES < 2.55)].any() and shown[1, TIMES > 2.7].all()
    assert len({person.id for person in motion.people}) == 2


def test_a_long_recording_is_one_smooth_curve():
    capture = FreeCapture(seconds=27.0, cameras=4)
    motion = solved(capture)
    times = np.arange(1.0, 26.0, 0.05)
    assert capture.errors(motion, times).mean() < 0.006
    person = motion.people[0]
    border = person.grid.origin + person.grid.step * round((person.grid.number - 4) / 2)
    before, after = (person.at(np.array([border + e]), 2)[0] for e in (-1e-6, 1e-6))
    np.testing.assert_allclose(before, after, atol=1e-2)


def test_clocks_and_drifts_are_found():
    rng = np.random.default_rng(3)
    offsets, drifts = rng.uniform(-0.05, 0.05, 5), rng.uniform(-6e-5, 6e-5, 5)
    offsets[0] = drifts[0] = 0.0
    capture = FreeCapture(cameras=5, rate=25.0, seconds=6.0, speed=2.0, offsets=offsets, drifts=drifts)
    motion = solved(capture, clocks=True, trusted_camera="cam0")
    middle = 1e-9 * (motion.reference_ns - START_NS)
    gaps = motion.clocks.values[0] - (offsets + drifts * middle)
    assert np.abs(gaps).max() < 1e-3 and motion.clocks.deviations[0].max() < 1e-3
    assert (np.abs(gaps[1:]) < 4.0 * motion.clocks.deviations[0, 1:]).all()
    assert capture.errors(motion, TIMES).mean() < 0.004


def test_line_delays_are_found_and_global_shutters_are_named():
    lines = np.array([0.0, 25e-6, 0.0, 18e-6, 0.0])
    capture = FreeCapture(cameras=5, rate=25.0, seconds=6.0, speed=2.0, lines=lines)
    motion = solved(capture, rolling_shutter=True)
    np.testing.assert_allclose(motion.clocks.values[2], lines, atol=4e-6)


def test_nothing_moves_so_no_clock_is_known():
    capture = FreeCapture(speed=0.0, offsets=[0.0, 0.03, -0.02, 0.01, 0.0, 0.02])
    motion = solved(capture, clocks=True, trusted_camera="cam0")
    assert motion.clocks.deviations[0, 1:].min() > 0.012


def test_one_camera_or_no_view_is_refused():
    capture = FreeCapture(seconds=1.0)
    with pytest.raises(UsageError, match="1 camera is not enough"):
        one = free_cameras.rig(1)
        ContinuousPass(ContinuousConfig(), StageContext(one, free_cameras.captures.SKELETON))
    with pytest.raises(DataError, match="no view"):
        ContinuousPass(ContinuousConfig(), capture.context).run(InMemoryRecording({}), untold)
    with pytest.raises(UsageError, match="cam9"):
        ContinuousPass(ContinuousConfig(trusted_camera="cam9"), capture.context)


def test_equal_input_gives_equal_curves_whatever_the_order_within_a_view():
    capture = FreeCapture(seconds=1.5)
    first, second = (solved(capture) for _ in range(2))
    for one, other in zip(first.people, second.people):
        np.testing.assert_array_equal(one.points, other.points)


def at_one_instant(capture):
    """Return the first view of each camera, all with the same timestamp."""
    views = {item.views[0].camera: item.views[0] for item in reversed(capture.sets)}
    moved = tuple(replace(view, stamp_ns=START_NS) for view in views.values())
    return DetectionSet(0, START_NS, capture.context.skeleton.hash, moved)


@pytest.mark.filterwarnings("error")
def test_people_of_one_instant_have_a_curve():
    capture = FreeCapture(rate=1000.0, seconds=0.002)
    recording = InMemoryRecording({"detection_sets": [at_one_instant(capture)]})
    motion = ContinuousPass(ContinuousConfig(), capture.context).run(recording, untold)
    found = np.concatenate([person.at(np.zeros(1)) for person in motion.people])
    gaps = np.linalg.norm(found[:, None] - capture.joints(0.0)[None], axis=-1).mean(axis=-1)
    assert gaps.min(axis=0).max() < 0.01


def test_instants_without_people_have_all_joints():
    capture = FreeCapture(there=lambda person, time: False)
    motion = solved(capture)
    (item,) = motion.sets([motion.first_ns])
    assert motion.people == () and item.positions.shape == (0, 19, 3)


def test_people_where_only_two_cameras_look_are_left_out_unless_asked_for():
    capture = CaptureWithBystander(cameras=5, rate=15.0, seconds=2.0)
    inside, found = solved(capture), solved(capture, capture_views=2)
    assert [person.id for person in inside.people] == [0]
    assert sorted(person.id for person in found.people) == [0, 1]
    errors = capture.errors(inside, TIMES[TIMES < 1.7])
    assert np.isfinite(errors[0]).all() and np.isnan(errors[1]).all()


def test_errors_that_all_joints_of_a_view_share_are_in_the_errors_of_clocks():
    squares = []
    for seed in (0, 1):
        own = np.random.default_rng(seed)

        def shift(pixels, rng, camera, own=own):
            pixels += 3.0 * own.standard_normal((2, 1, 2))

        times = solved(FreeCapture(seconds=10.0, spoil=shift), clocks=True).clocks
        squares.append((times.values[0] / times.deviations[0]) ** 2)
    assert np.mean(squares) < 4.0  # joints counted as independent give 18


def test_instants_begin_at_time_zero_where_clocks_move_views_before_it():
    found = solved(FreeCapture(seconds=2.0))
    early = replace(found, first_ns=-130_000_000, last_ns=2_000_000_000)
    np.testing.assert_array_equal(early.at_rate(10.0)[:3], [70_000_000, 170_000_000, 270_000_000])
