"""Identities over time."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.domain import (
    JointState,
    PoseSet,
    SkeletonModel,
    SubjectSet,
    TrackedPoseSet,
    ViewAppearance,
    ViewSources,
)
from panoptic_ros.errors import DataError
from panoptic_ros.stage import StageContext
from panoptic_ros.tracking.config import TrackingConfig
from panoptic_ros.tracking.stage import TrackingStage

NAMES = ("hip", "neck", "head", "left", "right", "foot")
MODEL = SkeletonModel("small", NAMES, 0, ((0, 1), (1, 2), (1, 3), (1, 4), (0, 5)), 2, ((3, 4),))
SHAPE = np.array([[0, 0, 0.9], [0, 0, 1.4], [0.1, 0, 1.6], [0, 0.4, 1.2], [0, -0.4, 1.2], [0, 0, 0.1]])


def poses(index, people, views=3, rate=30.0, stamp=None, sigma=0.005):
    """A set of people (K, 6, 3); views: one number or one per person."""
    positions = np.array(people, float).reshape(-1, len(NAMES), 3)
    there = np.isfinite(positions[..., 0])
    counts = np.broadcast_to(np.asarray(views), len(positions))
    return PoseSet(
        index,
        round(1e9 + index * 1e9 / rate) if stamp is None else stamp,
        MODEL.hash,
        positions,
        np.where(there[..., None, None], sigma**2 * np.eye(3), np.nan),
        0.8 * there,
        there * counts[:, None],
        np.where(there, JointState.MEASURED, JointState.MISSING),
        np.full(len(positions), 0.8),
    )


def body(x, y=0.0, size=1.0):
    return size * SHAPE + [x, y, 0.0]


def run(sets, **settings):
    stage = TrackingStage(TrackingConfig(**settings), StageContext(None, MODEL))
    return [stage.step(item).outputs[0] for item in sets]


def test_ids_count_from_zero_and_follow_people():
    rng = np.random.default_rng(0)
    sets, order = [], []
    for i in range(60):
        people = [body(-1.5 + 0.05 * i, 0.25), body(1.5 - 0.05 * i, -0.25)]  # they pass at half a metre
        shuffle = rng.permutation(2)
        order.append(shuffle)
        sets.append(poses(i, [people[k] + rng.normal(0, 0.01, SHAPE.shape) for k in shuffle]))
    for output in run(sets):
        assert output.ids.tolist() == [0, 1]
    first = run(sets)
    left = [o.positions[0, 0, 1] for o in first]
    assert np.ptp(np.sign(left)) == 0  # id 0 stays on its side


def test_somebody_comes_back_under_the_same_id():
    sets = []
    for i in range(90):
        people = [body(-2.0 + 0.04 * i)] if not 30 <= i < 60 else []
        sets.append(poses(i, [*people, body(0.0, 2.0, size=1.1)]))
    outputs = run(sets)
    assert {i for output in outputs for i in output.ids.tolist()} == {0, 1}
    assert len(outputs[45].ids) == 1 and len(outputs[60].ids) == 2


def test_bones_tell_people_apart_who_come_back():
    """Somebody leaves, and somebody of another size comes into the same place."""
    sets = [poses(i, [body(0.0)]) for i in range(20)] + [poses(i, []) for i in range(20, 30)]
    sets += [poses(i, [body(0.2, size=1.25)]) for i in range(30, 40)]
    assert run(sets)[-1].ids.tolist() == [1]


@pytest.mark.parametrize("pause_s", [1.0, 5.0, 14.0])
def test_a_pause_of_all_cameras_costs_nobody_the_identity(pause_s):
    """They walk on meanwhile, and the first sets afterwards do not show everybody."""
    sizes = (0.8, 0.9, 1.0, 1.15)
    walk = [(0.3, 0.1), (-0.2, 0.25), (0.15, -0.3), (-0.1, -0.2)]

    def people(t):
        return [body(k + t * vx, 2 * k + t * vy, size) for k, ((vx, vy), size) in enumerate(zip(walk, sizes))]

    sets = [poses(i, people(i / 30)) for i in range(60)]
    for i in range(30):
        t = 2.0 + pause_s + i / 30
        sets.append(poses(60 + i, people(t)[: 1 if i < 5 else 4], stamp=round(1e9 * (1.0 + t))))
    outputs = run(sets)
    assert outputs[59].ids.tolist() == outputs[-1].ids.tolist() == [0, 1, 2, 3]
    assert max(i for output in outputs for i in output.ids.tolist()) == 3


def test_a_poor_look_after_a_pause_is_enough_where_covariances_say_that_it_is_poor():
    """Two views in accord on little: bones are off by a third, and nobody else is there."""
    rng = np.random.default_rng(2)
    people = [body(0.0), body(1.5, size=0.9), body(3.0, size=1.1)]
    sets = [poses(i, [b + rng.normal(0, 0.005, b.shape) for b in people]) for i in range(30)]
    for i in range(45, 50):
        sets.append(poses(i, [b + rng.normal(0, 0.1, b.shape) for b in people], sigma=0.1))
    assert [o.ids.tolist() for o in run(sets)] == [[0, 1, 2]] * 35
    certain = [*sets[:30], *(replace(s, covariances=sets[0].covariances) for s in sets[30:])]
    assert run(certain)[-1].ids.tolist() != [0, 1, 2]  # those are others


def test_after_a_quarter_of_a_minute_people_are_others():
    sets = [poses(i, [body(0.0)]) for i in range(5)]
    sets += [poses(5 + i, [body(0.1)], stamp=round(1e9 * (21 + i / 30))) for i in range(5)]
    assert [o.ids.tolist() for o in run(sets, memory=10.0)] == [[0]] * 5 + [[1]] * 5


def test_ids_are_never_used_twice():
    sets = [poses(i, [body(0.0)] if i < 5 else [body(5.0)] if i >= 100 else []) for i in range(105)]
    assert [o.ids.tolist() for o in run(sets, memory=2.0)] == [[0]] * 5 + [[]] * 95 + [[1]] * 5


def test_a_ghost_gets_no_identity_and_a_weak_person_gets_one_soon():
    sparse = body(1.0)
    sparse[2:] = np.nan  # two joints
    sets = [
        poses(i, [body(0.0)] + ([sparse] if i in (3, 9) else []), views=[3, 2][: 1 + (i in (3, 9))])
        for i in range(12)
    ]
    assert {tuple(o.ids.tolist()) for o in run(sets)} == {(0,)}
    steady = [poses(i, [body(0.0), sparse], views=[3, 2]) for i in range(6)]
    assert [len(o.ids) for o in run(steady)] == [1, 1, 1, 1, 2, 2]
    assert len(run(steady, confirm_frames=1)[0].ids) == 2


def test_people_who_appear_together_are_numbered_by_their_places():
    bodies = [body(0.3), body(-0.9), body(1.5)]
    for order in itertools.permutations(range(3)):
        (output,) = run([poses(0, [bodies[k] for k in order])])
        assert output.ids.tolist() == [0, 1, 2]
        assert np.array_equal(output.positions, [bodies[1], bodies[0], bodies[2]])


def test_measured_skeletons_pass_unchanged():
    item = poses(0, [body(-0.9), body(0.3)])
    output = run([item])[0]
    assert np.array_equal(output.positions, item.positions)
    assert np.array_equal(output.covariances, item.covariances)
    assert (output.index, output.stamp_ns) == (item.index, item.stamp_ns)


def test_old_stamps_and_other_skeletons():
    stage = TrackingStage(TrackingConfig(), StageContext(None, MODEL))
    stage.step(poses(5, [body(0.0)]))
    late = stage.step(poses(4, [body(0.0)]))
    assert not late.outputs and late.notices[0].code == "tracking.old_stamp"
    other = SkeletonModel("other", ("a", "b"), 0, ((0, 1),), 1)
    with pytest.raises(DataError, match="skeleton"):
        TrackingStage(TrackingConfig(), StageContext(None, other)).step(poses(0, [body(0.0)]))


@pytest.mark.parametrize("rate", [10.0, 25.0, 100.0])
def test_fast_walkers_at_any_frame_rate(rate):
    count = int(2 * rate)
    sets = [
        poses(i, [body(-2 + 2.0 * i / rate, 0.3), body(2 - 2.0 * i / rate, -0.3)], rate=rate)
        for i in range(count)
    ]
    assert all(o.ids.tolist() == [0, 1] for o in run(sets))
    assert run(sets)[-1].positions[0, 0, 1] > 0


def test_by_head_alone_the_nearest_head_decides_whatever_the_rest_does():
    """The head stays near, all else is moved far away: by joints a stranger, by the head the same person."""
    moved = body(0.0) + [0.0, 1.0, 0.0]
    moved[2] = body(0.1)[2]
    sets = [poses(0, [body(0.0)]), poses(1, [moved])]
    assert [o.ids.tolist() for o in run(sets, method="head", max_distance=0.3)] == [[0], [0]]
    strict = {"return_distance": 0.0, "return_speed": 0.0}
    assert [o.ids.tolist() for o in run(sets, **strict)] == [[0], [1]]


def test_by_head_people_are_not_predicted_and_wait_for_the_window():
    fast = [poses(i, [body(0.4 * i)]) for i in range(3)]
    assert [o.ids.tolist() for o in run(fast, method="head", max_distance=0.3)] == [[0], [1], [2]]
    assert [o.ids.tolist() for o in run(fast, method="head", max_distance=0.5)] == [[0], [0], [0]]
    for gap, expected in ((2, 0), (3, 1)):  # in frames of 40 ms
        sets = [
            poses(0, [body(0.0)], rate=25.0),
            *(poses(i, [], rate=25.0) for i in range(1, gap)),
            poses(gap, [body(0.0)], rate=25.0),
        ]
        assert run(sets, method="head", memory=0.09)[-1].ids.tolist() == [expected]


def test_the_nearest_head_is_taken_by_the_one_whom_it_suits_best():
    sets = [poses(0, [body(0.0), body(0.5)]), poses(1, [body(0.45), body(0.1)])]
    assert run(sets, method="head")[1].positions[:, 0, 0].tolist() == pytest.approx([0.1, 0.45])


def test_votes_about_limbs_that_the_skeleton_has_not_are_refused():
    item = poses(0, [body(0.0)])
    with pytest.raises(DataError, match="7 limbs"):
        run([replace(item, side_votes=np.zeros((1, 7)))])


def test_known_biases_are_in_the_result_and_not_in_what_is_followed():
    stage = TrackingStage(TrackingConfig(), StageContext(None, MODEL))
    shown, moved = body(0.0), np.array([0.3, 0.0, 0.0])
    item = poses(0, [shown + moved])
    tracked, tracks = stage.step(replace(item, corrections=np.tile(moved, (1, len(shown), 1)))).outputs
    assert np.allclose(tracked.positions[0], shown + moved)
    assert np.allclose(tracks.states[0, :, :3], shown)


def test_designated_people_keep_their_ids_and_bystanders_are_left_out():
    """The subject leaves for longer than anybody is remembered; a bystander of another size passes by."""
    passing = [body(2.0 - 0.05 * max(0, i - 40), size=0.8) for i in range(180)]
    people = [[body(0.0), other] if not 30 <= i < 150 else [other] for i, other in enumerate(passing)]
    outputs = run([poses(i, p) for i, p in enumerate(people)], subjects=["4=0.1 0 0.9"], memory=1.0)
    assert all(output.ids.tolist() == [4] for output in outputs[:30] + outputs[170:])  # looked at before
    assert all(len(output.ids) == 0 for output in outputs[30:150])
    assert outputs[-1].positions[0, 0, 0] == 0.0


def test_bystanders_are_reported_where_asked_for_under_other_ids():
    sets = [poses(i, [body(0.0), body(2.0), body(4.0)]) for i in range(5)]
    for output in run(sets, subjects=["1=4 0 0.9", "0=0 0 0.9"], bystanders=True):
        found = dict(zip(output.ids.tolist(), output.positions[:, 0, 0]))
        assert found[1] == 4.0 and found[0] == 0.0 and len(found) == 3


def test_subjects_are_said_anew():
    stage = TrackingStage(TrackingConfig(), StageContext(None, MODEL))
    ids = []
    said = {
        3: SubjectSet(0, [2]),  # who has this id
        6: SubjectSet(0, [2, 0], tracks=[1, 2]),  # who had 1 is 2 now, and who had 2 is 0
        9: SubjectSet.of_nobody(),
    }
    for i in range(12):
        if i in said:
            assert stage.step(said[i]).outputs == ()
        output = stage.step(poses(i, [body(2.0 * k) for k in range(3)])).outputs[0]
        ids.append({round(x): number for x, number in zip(output.positions[:, 0, 0], output.ids.tolist())})
    assert ids[2] == {0: 0, 2: 1, 4: 2} and ids[5] == {4: 2} and ids[8] == {2: 2, 4: 0}
    assert ids[11][2] == 2 and ids[11][4] == 0 and ids[11][0] > 2


def test_whoever_is_seen_first_is_the_subject_without_a_place():
    sets = [poses(i, [body(0.0)] if i < 5 else [body(0.0), body(2.0)]) for i in range(10)]
    assert [output.ids.tolist() for output in run(sets, subjects=["9"])] == [[9]] * 10


def test_somebody_who_was_away_for_long_is_recognised_by_bones_and_others_are_not():
    """Three of different sizes leave; two return elsewhere after ten seconds, and a stranger comes."""
    rng = np.random.default_rng(3)
    here = [body(0.0), body(2.0, size=0.85), body(4.0, size=1.12)]
    later = [body(3.0, 1.0), body(1.0, 1.0, size=1.12), body(-1.0, size=0.72)]
    sets = [poses(i, [b + rng.normal(0, 0.004, b.shape) for b in here]) for i in range(30)]
    sets += [poses(i, []) for i in range(30, 330)]
    sets += [poses(i, [b + rng.normal(0, 0.004, b.shape) for b in later]) for i in range(330, 360)]
    outputs = run(sets, memory=30.0)
    assert all(set(o.ids.tolist()) <= {0, 2, 3} for o in outputs[330:])  # nobody is somebody else before
    found = dict(zip(outputs[-1].ids.tolist(), outputs[-1].positions[:, 0, 0].round()))
    assert found == {0: 3.0, 2: 1.0, 3: -1.0}
    assert 3 in run(sets, memory=5.0)[-1].ids  # 0 to 2 are forgotten then


def test_ids_are_not_given_twice_by_a_stage_that_forgot():
    stage = TrackingStage(TrackingConfig(), StageContext(None, MODEL))
    stage.step(poses(0, [body(0.0), body(2.0)]))
    stage.step(SubjectSet(0, [7], tracks=[1]))
    stage.step(poses(1, [body(0.0), body(2.0)]))
    stage.forget()
    later = stage.step(poses(2, [body(0.0), body(2.0)])).outputs[0]
    assert later.ids.tolist() == [7]  # the first who is seen: that name was taken
    stage.step(SubjectSet.of_nobody())
    assert min(stage.step(poses(3, [body(0.0), body(2.0)])).outputs[0].ids) >= 2


COLOURS = np.array([[[4.5, 0.5, -0.3], [4.0, 0.0, 0.1]], [[4.4, -0.5, 0.4], [3.7, 0.1, -0.1]]])


def dressed(sets, wearers):
    """Sets whose people are 2D people of one camera, and what each wears (row of COLOURS) before them."""
    found = []
    for item, worn in zip(sets, wearers, strict=True):
        persons = np.arange(len(worn))[:, None]
        found.append(ViewAppearance("cam", item.stamp_ns, item.index, COLOURS[list(worn)]))
        found.append(replace(item, sources=ViewSources(("cam",), [item.index], persons)))
    return found


def returned(worn, **settings):
    """The id of somebody who comes 5 s after two of one size have left, in the clothes of one of them."""
    both, size = [body(-1.0), body(1.0)], SHAPE.shape
    rng = np.random.default_rng(5)
    sets = [poses(i, [one + rng.normal(0.0, 0.004, size) for one in both]) for i in range(40)]
    sets += [poses(i, []) for i in range(40, 190)]
    sets += [poses(i, [body(0.0, 0.3) + rng.normal(0.0, 0.004, size)]) for i in range(190, 230)]
    stage = TrackingStage(TrackingConfig(memory=30.0, **settings), StageContext(None, MODEL))
    outputs = []
    for item in dressed(sets, [(0, 1)] * 40 + [()] * 150 + [(worn,)] * 40):
        outputs += [out for out in stage.step(item).outputs if isinstance(out, TrackedPoseSet)]
    return outputs[-1].ids.tolist()


def test_people_of_one_size_are_recognised_by_their_clothes():
    assert returned(0, appearance=True) == [0] and returned(1, appearance=True) == [1]


def test_somebody_who_has_just_gone_takes_nobody_who_is_there():
    """Two stand near each other, one goes, the other jerks that way: who was lost could be anywhere."""
    sets = []
    for i in range(50):
        people = [body(0.0, 0.15 if i >= 38 else 0.0)] + ([body(0.0, 0.4)] if i < 30 else [])
        sets.append(poses(i, people, sigma=0.02))
    assert all(output.ids.tolist() == [0] for output in run(sets)[30:])


def test_one_who_stays_beats_two_who_would_have_jumped():
    """One stays, the neighbour goes, and a child comes at the other side: two poor pairs are not better."""
    there = [body(0.0), body(0.0, 0.4)]
    sets = [poses(i, there) for i in range(30)]
    sets += [poses(i, [body(0.0), body(0.0, -0.4, 0.8)]) for i in range(30, 60)]
    last = run(sets)[-1]
    assert dict(zip(last.ids.tolist(), last.positions[:, 0, 1].round(2))) == {0: 0.0, 2: -0.4}


def test_who_comes_where_somebody_has_just_gone_may_be_another_who_was_away():
    """Two of much the same size: the first was away for 10 s, the second has just gone."""
    rng = np.random.default_rng(6)

    def at(index, *people):
        return poses(index, [one + rng.normal(0.0, 0.003, SHAPE.shape) for one in people])

    other = body(1.0, size=1.04)
    sets = [at(i, body(-1.0), other) for i in range(40)] + [at(i, other) for i in range(40, 340)]
    sets += [at(i) for i in range(340, 355)] + [at(i, body(0.9, 0.1)) for i in range(355, 400)]
    outputs = run(sets, memory=30.0)
    assert outputs[100].ids.tolist() == [1] and outputs[-1].ids.tolist() == [0]
