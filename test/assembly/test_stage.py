"""Assembly on exact scenes and with the faults that detectors have."""

from dataclasses import replace

import numpy as np
import pytest
from fed_stages import FedAssembly, seen_by

from panoptic_ros.assembly.noise import NoiseTable
from panoptic_ros.errors import DataError
from panoptic_ros.io.skeletons import map_joints


def solve(scenes, rig, sets, **settings):
    stage = FedAssembly(scenes.context(rig), **settings)
    return [stage.step(item).outputs[0] for item in sets]


def errors(pose, people):
    """Joint errors (P, J) m of each true person against the nearest skeleton."""
    gaps = np.linalg.norm(np.asarray(people)[:, None] - pose.positions[None], axis=-1)
    best = np.nanmean(gaps, axis=-1).argmin(axis=1)
    return gaps[np.arange(len(people)), best]


@pytest.mark.parametrize("views", [2, 3, 5])
@pytest.mark.parametrize("distortion", [(0, 0, 0, 0, 0), (-0.2, 0.05, 0.001, -0.001, 0.0)])
def test_exact_views_give_exact_people(scenes, views, distortion):
    rig = scenes.ring(views + (views == 2), distortion=distortion)
    rig = rig.subset(rig.names[:views])
    people = [scenes.person(0.6, 0.2), scenes.person(-0.7, -0.5, turn=2.0)]
    pose = solve(scenes, rig, [scenes.proposals(rig, people)])[0]
    assert pose.positions.shape == (2, 19, 3)
    assert errors(pose, people).max() < 1e-6
    assert (pose.views == views).all()


def test_one_view_invents_nobody(scenes):
    rig = scenes.ring(4)

    def change(i, points, scores):
        if i != 2:
            points[:], scores[:] = np.nan, 0.0

    pose = solve(scenes, rig, [scenes.proposals(rig, [scenes.person()], change=change)])[0]
    assert len(pose.positions) == 0


def test_covariances_are_consistent(scenes):
    rig, person = scenes.ring(5), scenes.person()
    sets = [scenes.proposals(rig, [person], index=i, noise=3.0) for i in range(60)]
    values = []
    for pose in solve(scenes, rig, sets)[10:]:
        offset = pose.positions[0] - person
        scaled = np.linalg.solve(pose.covariances[0], offset[..., None])[..., 0]
        values.append((offset * scaled).sum(axis=-1))
    assert 0.7 < np.mean(values) / 3.0 < 1.2


def test_every_instant_is_learnt_from_once(scenes, monkeypatch):
    learnt, learn = [], NoiseTable.learn

    def counted(table, marks, residuals, rig):
        learnt.append(len(residuals[0]))
        learn(table, marks, residuals, rig)

    rig, people = scenes.ring(5), [scenes.person()]
    sets = [scenes.proposals(rig, people, index=i, noise=1.0) for i in range(3)]
    stage = FedAssembly(scenes.context(rig))
    monkeypatch.setattr(NoiseTable, "learn", counted)
    for item in sets:
        stage.step(item)
    assert len(learnt) == len(sets)
    assert min(learnt) > 50


def test_outliers_and_misses_do_not_move_joints(scenes):
    rig, people = scenes.ring(5), [scenes.person(0.5, 0.4), scenes.person(-0.6, 0)]

    def change(i, points, scores):
        points[0, 5] += 80.0 * (i == 1)  # a wrist somewhere else
        points[1, 8] = np.nan if i in (0, 3) else points[1, 8]

    sets = [scenes.proposals(rig, people, index=i, change=change) for i in range(3)]
    for pose in solve(scenes, rig, sets):
        assert errors(pose, people).max() < 1e-3


@pytest.mark.parametrize("guidance", [True, False])
def test_exchanged_sides_are_undone(scenes, guidance):
    rig, people = scenes.ring(5), [scenes.person(0.5, 0.4), scenes.person(-0.6, 0, turn=1.0)]
    mirror = list(scenes.skeleton.mirror)
    arms = [scenes.skeleton.joint(s + n) for n in ("Shoulder", "Elbow", "Wrist") for s in "lr"]

    def change(i, points, scores):
        if i == 1:
            points[0] = points[0, mirror]  # the whole person
        if i == 3:
            points[1, arms] = points[1, [mirror[j] for j in arms]]

    sets = [scenes.proposals(rig, people, index=i, change=change, noise=0.5) for i in range(4)]
    for pose in solve(scenes, rig, sets, temporal_guidance=guidance):
        assert errors(pose, people).max() < 0.02


def test_anatomy_decides_where_half_of_the_views_exchange_sides(scenes):
    rig, truth = scenes.ring(4), scenes.person()

    def change(i, points, scores):
        if i < 2:
            points[0] = points[0, list(scenes.skeleton.mirror)]

    pose = solve(scenes, rig, [scenes.proposals(rig, [truth], change=change)])[0]
    assert errors(pose, [truth]).max() < 1e-3


def test_merged_and_duplicated_people(scenes):
    rig, people = scenes.ring(6), [scenes.person(0.25, 0.0), scenes.person(-0.3, 0.1)]

    def change(i, points, scores):
        if i == 2:  # an arm of the first was given to the second, and the other way round
            points[[0, 1], 4], points[[0, 1], 5] = points[[1, 0], 4], points[[1, 0], 5]

    def duplicated(item):
        views = list(item.detections.views)
        v = views[4]
        views[4] = replace(
            v,
            points=v.points[[0, 1, 1]] + 0.5,
            scores=v.scores[[0, 1, 1]],
            person_scores=v.person_scores[[0, 1, 1]],
        )
        return seen_by(item, tuple(views))

    sets = [duplicated(scenes.proposals(rig, people, index=i, change=change)) for i in range(3)]
    for pose in solve(scenes, rig, sets):
        assert len(pose.positions) == 2
        assert errors(pose, people).max() < 0.01


def test_no_2d_joint_serves_two_people(scenes):
    """Two people whose left wrists coincide in one view, where only one of them is seen."""
    rig, people = scenes.ring(5), [scenes.person(0.4, 0.0), scenes.person(-0.4, 0.0)]

    def change(i, points, scores):
        if i == 0:
            points[1, 5] = np.nan

    pose = solve(scenes, rig, [scenes.proposals(rig, people, change=change)])[0]
    assert sorted(pose.views[:, 5]) == [4, 5]


def test_guidance_never_pulls_positions(scenes):
    rig = scenes.ring(4)
    sets = [scenes.proposals(rig, [scenes.person(0.03 * i, 0)], index=i, noise=1.0) for i in range(12)]
    settings = {"learn_noise": False, "compensate_stamps": False}
    guided = solve(scenes, rig, sets, **settings)
    alone = solve(scenes, rig, sets, temporal_guidance=False, **settings)
    for a, b in zip(guided, alone):
        assert np.abs(a.positions - b.positions).max() < 1e-3


def test_neither_order_of_people_nor_blind_cameras_matter(scenes):
    people = [scenes.person(0.5, 0.4), scenes.person(-0.6, 0), scenes.person(0, -0.8)]
    rig = scenes.ring(5)
    item = scenes.proposals(rig, people, noise=1.0)
    order = [2, 0, 1]
    views = tuple(
        replace(v, points=v.points[order], scores=v.scores[order], person_scores=v.person_scores[order])
        for v in item.detections.views
    )
    shuffled = seen_by(item, views)
    blind = seen_by(item, item.detections.views[:4])
    blind_rig = rig.subset(rig.names[:4])
    expected = solve(scenes, rig, [item])[0].positions
    assert np.array_equal(solve(scenes, rig, [shuffled])[0].positions, expected)
    four = solve(scenes, blind_rig, [blind])[0].positions
    assert np.array_equal(solve(scenes, rig, [blind])[0].positions, four)


def test_derived_joints_are_means_in_3d(scenes):
    names = [n for n in scenes.skeleton.joint_names if n not in ("Neck", "BodyCenter")]
    skeleton, _ = map_joints("panoptic19", names)
    rig, truth = scenes.ring(4), scenes.person()
    item = scenes.proposals(rig, [truth], skeleton=skeleton)
    stage = FedAssembly(scenes.context(rig, skeleton))
    pose = stage.step(item).outputs[0]
    shoulders = [skeleton.joint("lShoulder"), skeleton.joint("rShoulder")]
    neck = skeleton.joint("Neck")
    assert np.allclose(pose.positions[0, neck], pose.positions[0, shoulders].mean(axis=0))
    assert np.allclose(pose.covariances[0, neck], pose.covariances[0, shoulders].sum(axis=0) / 4)


def test_stamps_of_views_are_compensated(scenes):
    """Somebody walks at 2 m/s past cameras that look up to 12 ms early and late."""
    rig, skeleton = scenes.ring(5), scenes.skeleton
    late = np.array([-0.012, -0.006, 0.0, 0.006, 0.012])

    def item(index):
        time = index / 30.0
        sets = [scenes.proposals(rig, [scenes.person(2 * (time + d) - 1.0, 0)], index) for d in late]
        views = tuple(
            replace(s.detections.views[i], stamp_ns=s.stamp_ns + round(1e9 * late[i]))
            for i, s in enumerate(sets)
        )
        return seen_by(sets[0], views)

    sets = [item(i) for i in range(25)]
    worst = {}
    for on in (True, False):
        poses = solve(scenes, rig, sets, compensate_stamps=on)
        truth = [scenes.person(2 * i / 30.0 - 1.0, 0) for i in range(25)]
        worst[on] = max(errors(p, [t]).mean() for p, t in list(zip(poses, truth))[15:])
    assert worst[True] < 0.25 * worst[False] and len(skeleton) == 19


def test_old_stamps_are_dropped_with_a_notice(scenes):
    rig = scenes.ring(3)
    stage = FedAssembly(scenes.context(rig))
    stage.step(scenes.proposals(rig, [scenes.person()], index=5))
    late = stage.step(scenes.proposals(rig, [scenes.person()], index=4))
    assert not late.outputs and late.notices[0].code == "association.old_stamp"


def test_what_does_not_fit_is_refused_before_the_state_changes(scenes):
    rig = scenes.ring(4)
    item = scenes.proposals(rig, [scenes.person()])
    stage = FedAssembly(scenes.context(rig.subset(rig.names[:3])))
    with pytest.raises(DataError, match="cam3"):
        stage.step(item)
    small = replace(item.detections.views[0], image_size=(640, 480))
    wrong = seen_by(item, (small, *item.detections.views[1:3]))
    with pytest.raises(DataError, match="image"):
        stage.step(wrong)
    good = seen_by(item, item.detections.views[:3])
    assert len(stage.step(good).outputs[0].positions) == 1
