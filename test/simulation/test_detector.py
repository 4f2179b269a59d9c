"""Each fault of the simulated detector, alone, does what it says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.simulation import CLEAN, SCENES, Absence, Degradation, Timing, simulate
from panoptic_ros.simulation.skeleton import JOINTS, J

EXACT = Degradation(noise_px=0.0, hidden_miss=0.0)
BASE = replace(SCENES["clean-4p5v"], degradation=EXACT)


def sightings(faults, frames=20, seed=0, base=BASE, **changes):
    """(frame, camera, Sightings) of a scene with these faults."""
    take = simulate(replace(base, degradation=faults, **changes), seed, frames)
    return take, [(i, c, view) for i, views in take.sightings() for c, view in enumerate(views)]


def true_points(take, index, camera):
    """Points (P, 19, 2) px of everybody."""
    t = take.schedule.ticks[index : index + 1]
    return take.rig.cameras[camera].project(np.stack([p.joints(t)[0] for p in take.people]))[0]


def errors(take, views):
    """Distances (N,) px of all joints that have a source to the truth."""
    gaps = []
    for i, c, view in views:
        truth = true_points(take, i, c)
        for points, source in zip(view.points, view.sources):
            known = source[:, 0] >= 0
            gaps.append(np.linalg.norm(points[known] - truth[source[known, 0], source[known, 1]], axis=1))
    return np.concatenate(gaps)


@pytest.mark.parametrize("name", ["clean-4p5v", "noisy-8p31v", "dome-480-7p", "three-views-2p"])
def test_without_faults_the_points_are_projections(name):
    take, views = sightings(EXACT, 1, base=replace(SCENES[name], timing=Timing()))
    gaps = errors(take, views)
    assert len(gaps) > 100 and gaps.max() < 1e-5


def test_noise_has_the_size_that_is_told():
    take, views = sightings(replace(EXACT, noise_px=2.0), 30)
    gaps = errors(take, views)
    sigmas = np.concatenate([v.sigmas[v.sources[..., 0] >= 0] for _, _, v in views])
    assert np.sqrt((gaps**2 / sigmas**2).mean() / 2.0) == pytest.approx(1.0, abs=0.03)
    assert 1.5 < np.median(sigmas) < 2.6


def test_better_scores_mean_smaller_errors():
    take, views = sightings(replace(EXACT, noise_px=2.0, hidden_miss=1.0), 30)
    gaps = errors(take, views)
    scores = np.concatenate([v.scores[v.sources[..., 0] >= 0] for _, _, v in views])
    high = scores > np.median(scores)
    assert gaps[high].mean() < 0.9 * gaps[~high].mean()


def test_hidden_joints_are_missing_or_guessed_badly():
    _, views = sightings(replace(EXACT, noise_px=1.0, hidden_miss=1.0))
    few = sum((v.scores > 0).sum() for _, _, v in views)
    _, guessed = sightings(replace(EXACT, noise_px=1.0))
    many = sum((v.scores > 0).sum() for _, _, v in guessed)
    assert few < 0.95 * many
    assert np.nanmax([np.nanmax(v.sigmas) for _, _, v in guessed]) == pytest.approx(4.0)


def test_misses_of_joints_and_people():
    _, all_views = sightings(EXACT)
    _, fewer = sightings(replace(EXACT, joint_miss=0.3))
    share = sum((v.scores > 0).sum() for *_, v in fewer) / sum((v.scores > 0).sum() for *_, v in all_views)
    assert 0.65 < share < 0.78
    _, lone = sightings(replace(EXACT, person_miss=0.4))
    share = sum(len(v.scores) for *_, v in lone) / sum(len(v.scores) for *_, v in all_views)
    assert 0.5 < share < 0.7


def test_outliers_are_far_and_without_a_source():
    take, views = sightings(replace(EXACT, outlier=0.2), 5)
    assert errors(take, views).max() < 1e-5
    strange = [
        np.linalg.norm(p - t[who], axis=1)[s[:, 0] < 0]
        for i, c, v in views
        for t in [true_points(take, i, c)]
        for p, s in zip(v.points, v.sources)
        for who in [s[s[:, 0] >= 0][0, 0]]
    ]
    far = np.concatenate(strange)
    far = far[~np.isnan(far)]
    assert far.min() > 19.0 and far.max() < 61.0 and far.mean() == pytest.approx(40.0, rel=0.1)


def test_limb_swaps_exchange_left_and_right():
    _, views = sightings(replace(EXACT, limb_swap=1.0), 3)
    for *_, view in views:
        for source in view.sources:
            arms = source[J["lWrist"], 1] in (J["rWrist"], -1) and source[J["lHip"], 1] != J["rHip"]
            legs = source[J["lAnkle"], 1] in (J["rAnkle"], -1) and source[J["lWrist"], 1] != J["rWrist"]
            assert arms or legs


def test_back_swaps_happen_to_people_seen_from_behind():
    take, views = sightings(replace(EXACT, back_swap=1.0), 3)
    for i, c, view in views:
        for source in view.sources:
            if source[J["lShoulder"], 0] < 0 or source[J["rShoulder"], 0] < 0:
                continue
            joints = take.people[source[J["lShoulder"], 0]].joints(take.schedule.ticks[i : i + 1])[0]
            nose = joints[J["lShoulder"]] - joints[J["rShoulder"]]
            forward = np.cross(nose, [0.0, 0.0, 1.0])
            behind = forward @ (take.rig.cameras[c].centre - joints[J["Neck"]]) < 0.0
            assert (source[J["lShoulder"], 1] == J["rShoulder"]) == behind


def test_merges_take_joints_of_two_people():
    _, views = sightings(replace(EXACT, merge=1.0), 6, base=SCENES["noisy-8p5v"])
    owners = [set(s[s[:, 0] >= 0, 0].tolist()) for *_, v in views for s in v.sources]
    assert any(len(who) == 2 for who in owners)


def test_duplicates_and_ghosts_add_people_without_sources():
    for faults in (replace(EXACT, duplicate=1.0), replace(EXACT, ghosts=2.0)):
        _, views = sightings(faults, 10)
        extra = [(s[:, 0] < 0).all() for *_, v in views for s in v.sources]
        per_view = sum(extra) / len(views)
        assert 1.0 < per_view < 4.5


def test_faults_that_are_held_last():
    _, views = sightings(replace(EXACT, person_miss=0.5, hold=5), 20)
    counts = np.array([len(v.scores) for *_, v in views]).reshape(20, 5)
    changes = [i for i in range(1, 20) if (counts[i] != counts[i - 1]).sum() > 1]
    assert set(changes) <= {5, 10, 15}


def test_correlated_noise_remembers():
    def steps(memory, share=1.0):
        faults = Degradation(noise_px=3.0, hidden_miss=1.0, memory=memory, memory_share=share)
        take, views = sightings(faults, 12)
        found = {}
        for i, c, v in views:
            truth = true_points(take, i, c)
            for points, source, sigma in zip(v.points, v.sources, v.sigmas):
                for joint in np.flatnonzero(source[:, 0] >= 0):
                    who = source[joint]
                    found[(i, c, *who)] = (points[joint] - truth[who[0], who[1]]) / sigma[joint]
        pairs = [(e, found[(i + 1, *key)]) for (i, *key), e in found.items() if (i + 1, *key) in found]
        first, second = (np.concatenate(column) for column in zip(*pairs))
        return np.corrcoef(first, second)[0, 1]

    assert abs(steps(0.0)) < 0.05 and steps(0.8) == pytest.approx(0.8, abs=0.05)
    assert steps(0.8, 0.5) == pytest.approx(0.4, abs=0.07)


def test_noise_can_grow_with_size():
    _, views = sightings(replace(EXACT, noise_px=1.0, size_px=100.0), 2)
    assert max(np.nanmax(v.sigmas) for *_, v in views) > 8.0


def test_absent_people_are_not_detected_and_ignored():
    take, views = sightings(EXACT, 4, absences=(Absence(2, 0.0, 0.05),))
    seen = {i: {int(w) for j, _, v in views if j == i for w in v.sources[..., 0].ravel()} for i in range(4)}
    assert 2 not in seen[0] and 2 not in seen[1] and 2 in seen[3]
    frames = take.truth_document()["frames"]
    assert [any(s.get("ignore") for s in f["skeletons"]) for f in frames] == [True, True, False, False]


def test_absences_of_some_cameras_or_joints_hide_just_these():
    some, lower = Absence(1, 0.0, 9.0, (0, 2)), Absence(0, 0.0, 9.0, joints=("lKnee", "rAnkle"))
    take, views = sightings(EXACT, 2, absences=(some, lower))
    for _, c, view in views:
        seen = {(int(w), int(j)) for w, j in view.sources.reshape(-1, 2)}
        assert any(w == 1 for w, _ in seen) == (c not in (0, 2))
        assert not {(0, JOINTS.index("lKnee")), (0, JOINTS.index("rAnkle"))} & seen
    assert not any(s.get("ignore") for f in take.truth_document()["frames"] for s in f["skeletons"])


def test_clean_is_the_default():
    assert CLEAN == Degradation()
