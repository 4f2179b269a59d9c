"""The stage: which data belong to an instant, when it is given, and what is done about bad IMUs."""

from dataclasses import replace

import numpy as np
import pytest
from rolling import with_line_delays
from stage_cases import SECOND, cases, chain, imu_samples

from panoptic_ros.domain import BodySource, ImuSample
from panoptic_ros.errors import DataError
from panoptic_ros.kinematics.imus.streams import ImuStreams
from panoptic_ros.kinematics.people.seen_people import JointPositions, PersonSamples, ViewJoints
from panoptic_ros.kinematics.timeline import InstantSchedule

UP = np.array([0.0, 0.0, 9.81])


def turned(angle):
    return np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])


def sample(stamp, angle=0.0, force=UP, device="back"):
    return ImuSample(device, stamp, turned(angle), np.zeros(3), force)


def run(name, items, **values):
    stage = cases()[name].stage(**values)
    results = [stage.step(item) for item in items] + [stage.flush()]
    return [o for r in results for o in r.outputs], [n for r in results for n in r.notices]


def test_bodies_of_tracked_people_stand_where_their_joints_are():
    frames = chain(14)
    tracked = {item.stamp_ns: item for item in frames["refinement"]}
    items = [item for pair in zip(frames["detection_sets"], frames["refinement"]) for item in pair]
    bodies, _ = run("kinematics", items, rate_hz=30.0, lag=0.0)
    assert [body.index for body in bodies] == list(range(len(bodies)))
    compared = [body for body in bodies if body.stamp_ns in tracked][4:]
    for body in compared:
        assert body.ids.tolist() == [1] and body.sources[0] == BodySource.TRACK and body.views[0] == 4
        poses = tracked[body.stamp_ns]
        k = poses.ids.tolist().index(1)
        apart = np.linalg.norm(body.keypoints[0] - poses.positions[k], axis=-1)
        assert np.nanmedian(apart) < 0.06
    assert len(compared) >= 8


def test_joints_in_space_serve_where_there_is_nothing_in_2d():
    bodies, _ = run("kinematics", chain(14)["refinement"], rate_hz=30.0, lag=0.0)
    last = bodies[-1]
    poses = chain(14)["refinement"][-1]
    apart = np.linalg.norm(last.keypoints[0] - poses.positions[poses.ids.tolist().index(1)], axis=-1)
    assert last.sources[0] == BodySource.JOINTS and np.nanmedian(apart) < 0.06


def test_no_instant_is_later_than_lag_and_one_period_of_the_slowest_camera():
    lag, period = 0.05, 1.0 / 30.0
    stage = cases()["kinematics"].stage(rate_hz=60.0, lag=lag)
    newest, given = 0, 0
    for item in cases()["kinematics"].items:
        if item.stamp_ns < 8 * SECOND:
            newest = max(newest, item.stamp_ns)
        for body in stage.step(item).outputs:
            given += 1
            assert newest - body.stamp_ns <= (lag + 2.1 * period) * SECOND
    assert given > 5


def test_a_device_that_nobody_wears_is_told_once():
    items = [sample(k * SECOND // 100, device="other") for k in range(50)]
    _, notices = run("kinematics", items)
    assert [notice.code for notice in notices] == ["kinematics.imu_unknown"]


def test_imus_alone_give_a_body_once_nobody_waits_for_cameras():
    samples = [replace(item, stamp_ns=k * SECOND // 50) for k, item in enumerate(imu_samples("back", 100))]
    bodies, notices = run("kinematics", samples, rate_hz=20.0, lag=0.0)
    found = [body for body in bodies if len(body.ids)]
    assert found and all(body.sources[0] == BodySource.IMUS for body in found)
    assert all(np.isfinite(body.freedoms).all() for body in found)
    assert not [notice for notice in notices if notice.code == "kinematics.never_came"]


def test_people_of_another_skeleton_are_refused():
    stage = cases()["kinematics"].stage()
    with pytest.raises(DataError, match="people of skeleton 12345678, but kinematics works on panoptic19"):
        stage.step(replace(chain(14)["detection_sets"][0], skeleton_hash="12345678", views=()))


# ---------------------------------------------------------------- IMUs


def test_a_device_is_read_between_its_samples_along_the_arc():
    streams = ImuStreams(("back",))
    for k in range(8):
        assert streams.take(sample(k * 10_000_000, 0.1 * k, UP + [k, 0, 0])) == ()
    there, (turn,), (force,) = streams.at(34_000_000)
    assert there.all() and np.arctan2(turn[1, 0], turn[0, 0]) == pytest.approx(0.34)
    assert force == pytest.approx(UP + [3.4, 0, 0])
    assert not streams.at(76_000_000).there.any()  # more than half a sample ahead


def test_stamps_that_stand_twice_are_left_out_and_told():
    streams = ImuStreams(("back",))
    streams.take(sample(5_000_000))
    streams.take(sample(10_000_000))
    (notice,) = streams.take(sample(10_000_000, 1.0))
    assert notice.code == "kinematics.imu_stamps" and "back sends the stamp 10000000" in notice.text
    assert (streams.last == [10_000_000]).all()


@pytest.mark.parametrize("size", [2, 3, 7])
def test_samples_of_a_batch_are_spread_by_their_rate(size):
    """A device turns at 1 rad/s and sends several samples with the stamp of the first of them."""
    streams, period, told = ImuStreams(("back",)), 10_000_000, []
    for k in range(10 * size):
        told += streams.take(sample((k - k % size) * period, 1e-9 * k * period))
    assert [notice.code for notice in told] == ["kinematics.batches"]
    for at in range(4 * size * period, (9 * size + size - 1) * period, 7_000_000):
        there, (turn,), _ = streams.at(at)
        assert there.all() and np.arctan2(turn[1, 0], turn[0, 0]) == pytest.approx(1e-9 * at, abs=1e-6)


def test_a_device_without_orientation_is_told_once():
    streams, told = ImuStreams(("back",)), []
    for k in range(200):
        nowhere = ImuSample("back", k * 10_000_000, np.full(4, np.nan), np.zeros(3), UP)
        told += streams.take(nowhere)
    assert [notice.code for notice in told] == ["kinematics.unoriented"]
    assert "back has no orientation" in told[0].text


def test_a_flood_of_samples_pushes_nothing_out():
    streams = ImuStreams(("back",))
    for k in range(20_000):
        streams.take(sample(k * 10_000, 1e-5 * k))
    (turn,) = streams.at(199_000_000 - 80_000_000).orientations
    assert np.arctan2(turn[1, 0], turn[0, 0]) == pytest.approx(0.119, abs=1e-3)


@pytest.mark.parametrize(("rate", "floods"), [(100, False), (1000, False), (20_000, True)])
def test_a_device_that_floods_is_told_once(rate, floods):
    streams, told = ImuStreams(("back",)), []
    for k in range(rate):
        streams.take(sample(k * SECOND // rate))
        if k % (rate // 50) == 0:
            told += streams.judge(k * SECOND // rate, 0.02)
    assert [notice.code for notice in told] == ["kinematics.imu_flood"] * floods


@pytest.mark.parametrize(
    ("force", "kept"), [(UP, True), (-UP, False), (UP / 9.81, False), (UP + [3.0, 0, 0], True)]
)
def test_another_convention_of_forces_is_told_once(force, kept):
    streams, told = ImuStreams(("back", "arm")), []
    for k in range(300):
        for device in streams.names:
            streams.take(sample(k * 20_000_000, 0.01 * k, force if device == "back" else UP, device))
        told += streams.judge(k * 20_000_000, 0.02)
    assert [(n.code, n.values["device"]) for n in told] == (
        [] if kept else [("kinematics.imu_convention", "back")]
    )
    assert streams.at(299 * 20_000_000).there.tolist() == [kept, True]


@pytest.mark.parametrize(("unit", "told"), [(1.0, 0), (np.pi / 180, 1), (180 / np.pi, 1)])
def test_rates_of_another_unit_are_told_once_within_seconds(unit, told):
    streams, notices = ImuStreams(("back", "arm")), []
    for k in range(150):
        time = 0.02 * k
        turn = np.array([np.cos(0.5 * np.sin(3 * time)), 0.0, 0.0, np.sin(0.5 * np.sin(3 * time))])
        rate = np.array([0.0, 0.0, 3.0 * np.cos(3 * (time + 0.01))])
        for device, as_told in (("back", rate / unit), ("arm", rate)):
            streams.take(ImuSample(device, k * 20_000_000, turn, as_told, UP))
        notices += streams.judge(k * 20_000_000, 0.02)
    assert [(n.code, n.values["device"]) for n in notices] == [("kinematics.imu_rates", "back")] * told
    assert streams.at(149 * 20_000_000).there.all()


def test_a_device_that_dies_is_told_once_and_its_return():
    streams, told = ImuStreams(("back",)), []
    for k in range(400):
        if not 100 <= k < 200:
            streams.take(sample(k * 10_000_000))
        told += streams.judge(k * 10_000_000, 0.01)
    assert [notice.code for notice in told] == ["kinematics.imu_silent", "kinematics.imu_back"]


@pytest.mark.parametrize(("seconds", "told_at"), [(1.0, []), (3.0, [3.01])])
def test_devices_that_are_silent_together_are_told_later(seconds, told_at):
    """As when the machine stalls, or what they send by fails."""
    names = tuple("abcd")
    streams, told = ImuStreams(names), []
    for k in range(500):
        for name in names:
            if not 100 <= k < 100 + 100 * seconds:
                streams.take(sample(k * 10_000_000, device=name))
        told += [(0.01 * k, n.code) for n in streams.judge(k * 10_000_000, 0.01)]
    silent = [when for when, code in told if code == "kinematics.imu_silent"]
    assert silent == pytest.approx([when for when in told_at for _ in names], abs=0.02)
    assert len(told) == 2 * len(silent)


def test_a_sample_is_whole_or_not_there():
    nan = np.full(4, np.nan)
    assert np.isnan(ImuSample("a", 1, nan, nan[:3], nan[:3]).force).all()
    with pytest.raises(DataError, match="force of a is NaN in part"):
        ImuSample("a", 1, nan, nan[:3], [np.nan, 0.0, 9.8])
    with pytest.raises(DataError, match="orientation of a has the length 0.5, expected 1"):
        ImuSample("a", 1, [0.5, 0, 0, 0], nan[:3], nan[:3])


# ---------------------------------------------------------------- instants


def test_joints_are_taken_between_two_images_and_alone_only_when_near():
    person, scores = PersonSamples(), np.array([1.0, 0.0])
    ends = [np.array([[0.0, 0.0], [np.nan, np.nan]]), np.array([[0.4, 0.2], [1.0, 1.0]])]
    person.see(0, ViewJoints(0, ends[0], scores))
    person.see(0, ViewJoints(40_000_000, ends[1], np.array([0.6, 1.0])))
    points, found = person.views_at(10_000_000, 20_000_000)[0]
    assert points[0] == pytest.approx([0.1, 0.05]) and found[0] == pytest.approx(0.9)
    assert np.isnan(points[1]).all() and found[1] == 0.0
    assert person.views_at(30_000_000, 20_000_000)[0][0][1] == pytest.approx([1.0, 1.0])
    assert np.array_equal(person.views_at(55_000_000, 20_000_000)[0][0], ends[1], equal_nan=True)
    assert person.views_at(65_000_000, 20_000_000) == {}


def test_joints_in_space_are_taken_between_two_sets():
    person, spread = PersonSamples(), np.tile(np.eye(3), (1, 1, 1))
    assert person.joints_at(0, 10) is None
    for k in range(3):
        person.take_joints(JointPositions(k * 30_000_000, np.array([[0.3 * k, 0.0, 0.0]]), spread))
    assert person.joints_at(40_000_000, 15_000_000)[0] == pytest.approx(np.array([[0.4, 0.0, 0.0]]))
    assert person.joints_at(90_000_000, 15_000_000) is None


def test_an_instant_waits_for_all_that_are_alive_and_no_longer_than_a_period():
    line = InstantSchedule(100.0)
    for k in range(5):
        line.came(0, k * 40_000_000)
    for k in range(17):
        line.came("back", k * 10_000_000)
    given = []
    while (stamp := line.due()) is not None:
        given.append(stamp)
    assert given == [k * 10_000_000 for k in range(17)]
    line.came("back", 170_000_000)
    assert line.due() is None
    for k in range(18, 22):
        line.came("back", k * 10_000_000)
    assert line.due() == 170_000_000


def test_an_instant_does_not_wait_beyond_a_sample_that_rounding_alone_puts_before_it():
    line, period = InstantSchedule(60.0), 1e9 / 30.0
    waited = []
    for k in range(60):
        for source in (0, "back"):
            line.came(source, k * int(period))  # a third of a nanosecond less each time
        while (stamp := line.due()) is not None:
            waited.append(k * int(period) - stamp)
    assert max(waited) <= 1e9 / 60.0 + 1.0


def test_a_stamp_that_is_far_off_is_left_out_and_several_are_believed():
    line = InstantSchedule(50.0)
    line.came(0, SECOND)
    assert line.came("back", 100 * SECOND) == "early" and line.newest_ns == SECOND
    assert [line.came(0, 60 * SECOND + k) for k in range(5)] == ["early"] * 4 + ["jump"]
    assert line.due() == 60 * SECOND + 4


@pytest.mark.parametrize("behind_s", [3, 30])
def test_samples_that_waited_for_seconds_begin_nothing_anew_and_another_clock_does(behind_s):
    def told(rate):
        """Of three cameras whose stamps begin behind those of a device, and go on so many times as fast."""
        line, found = InstantSchedule(50.0), []
        for k in range(200):
            now = 100 * SECOND + k * SECOND // 50
            found.append(line.came("back", now))
            stamp = (100 - behind_s) * SECOND + rate * k * SECOND // 50
            found += [line.came(camera, min(stamp, now)) for camera in range(3)]
        return found

    late = told(20)
    assert "jump" not in late and late[-3:] == ["", "", ""]
    assert "jump" in told(1)[:24]


def test_joints_that_come_before_their_views_now_and_then_hold_up_nobody():
    frames = chain(20)
    pairs = list(zip(frames["detection_sets"], frames["refinement"]))
    items = [item for k, pair in enumerate(pairs) for item in (pair[::-1] if k % 4 == 3 else pair)]
    stage, newest, waits = cases()["kinematics"].stage(rate_hz=60.0, lag=0.0), 0, []
    for item in items:
        newest = max(newest, item.stamp_ns)
        waits += [newest - body.stamp_ns for body in stage.step(item).outputs]
    assert len(waits) > 20 and max(waits) <= 2.1 * SECOND / 30


@pytest.mark.parametrize("others", [(0, 1), ("arm", "leg")])
def test_a_device_with_a_wrong_clock_moves_nobody_elses_time(others):
    line = InstantSchedule(50.0)
    told = {line.came(name, SECOND) for name in others}
    for k in range(100):
        told |= {line.came(name, (k + 50) * SECOND // 50) for name in others}
        for n in range(8):  # they come in bunches, too
            verdict = line.came("back", 3600 * SECOND + k * SECOND // 50 + n)
            assert verdict == ("odd" if k else "early")
    assert told == {""} and line.newest_ns == 149 * SECOND // 50


def test_time_goes_on_where_most_devices_say_that_it_does_and_cameras_before_them():
    line, names = InstantSchedule(50.0), ("back", "arm", "leg")
    for name in names:
        line.came(name, SECOND)
    verdicts = [line.came(name, 90 * SECOND + k) for k in range(3) for name in names]
    assert verdicts == ["early"] * 4 + ["jump"] + [""] * 4
    assert [line.came(0, 500 * SECOND + k) for k in range(5)] == ["early"] * 4 + ["jump"]
    assert {line.came(name, 90 * SECOND + k) for k in range(50) for name in names} == {"early"}
    assert line.came(0, 501 * SECOND) == "" and line.came("arm", 91 * SECOND) == "odd"


def test_views_of_rolling_shutters_count_at_their_middle_rows():
    frames, case = chain(14), cases()["kinematics"]
    rolling = replace(case.context, rig=with_line_delays(case.context.rig, (20.0,)))
    middles = {camera.name: round(1e9 * camera.middle_s) for camera in rolling.rig.cameras}
    bodies = []
    for context, rolls in ((case.context, False), (rolling, True)):
        stage = case.stage(context, rate_hz=30.0, lag=0.0)
        found = []
        for item, tracked in zip(frames["detection_sets"], frames["refinement"]):
            views = [replace(v, stamp_ns=v.stamp_ns + SECOND - rolls * middles[v.camera]) for v in item.views]
            for each in (replace(item, views=tuple(views), stamp_ns=item.stamp_ns + SECOND), tracked):
                later = replace(each, stamp_ns=each.stamp_ns + SECOND) if each is tracked else each
                found += stage.step(later).outputs
        bodies.append(found)
    assert len(bodies[0]) == len(bodies[1]) > 8
    for one, other in zip(*bodies):
        assert one.stamp_ns == other.stamp_ns and np.array_equal(one.keypoints, other.keypoints)
