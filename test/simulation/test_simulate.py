"""Takes of scenes: the same seed gives the same take, records and truth are well formed."""

from __future__ import annotations

import numpy as np
import pytest

from panoptic_ros.errors import UsageError
from panoptic_ros.geometry import triangulate_robust
from panoptic_ros.simulation import SCENES, SKELETON, Ring, SimulatedScene, scene, simulate

PLAIN = [name for name, item in SCENES.items() if not item.rendered and "480" not in name]


def contents(take):
    """Everything in the sets, comparable."""
    return [
        (s.stamp_ns, v.camera, v.stamp_ns, v.points.tobytes(), v.scores.tobytes())
        for s in take.detection_sets()
        for v in s.views
    ]


@pytest.mark.parametrize("name", PLAIN)
def test_the_same_seed_gives_the_same_take(name):
    first, second, other = (simulate(SCENES[name], seed, 3) for seed in (0, 0, 1))
    assert contents(first) == contents(second) != contents(other)
    assert first.truth_document() == second.truth_document() != other.truth_document()


def test_a_take_can_be_read_twice():
    take = simulate(SCENES["noisy-4p5v"], 0, 4)
    assert contents(take) == contents(take)


@pytest.mark.parametrize("name", ["mixed-rates", "sitting-group-6p5v"])
def test_a_longer_take_begins_with_a_shorter_one(name):
    short, long = simulate(SCENES[name], 3, 5), simulate(SCENES[name], 3, 9)
    first = contents(short)
    assert first == [row for row in contents(long) if row[0] <= first[-1][0]]
    assert long.truth_document()["frames"][:5] == short.truth_document()["frames"]


@pytest.mark.parametrize("name", PLAIN)
def test_sets_and_truth_are_well_formed(name):
    take = simulate(SCENES[name], 2, 3)
    sets = list(take.detection_sets())
    truth = take.truth_document()
    assert [s.index for s in sets] == [0, 1, 2] and truth["joint_names"] == list(SKELETON.joint_names)
    for item, frame in zip(sets, truth["frames"]):
        assert item.stamp_ns == frame["stamp_ns"]
        for view in item.views:
            there = view.scores > 0.0
            assert there.any(1).all(), "an empty person"
            assert take.rig.camera(view.camera).contains(view.points[there]).all()
            assert view.scores.max(initial=0.0) <= 0.99
        for skeleton in frame["skeletons"]:
            assert np.shape(skeleton["joints"]) == (19, 3)


def test_bystanders_are_ignored_and_visitors_come_and_go():
    frame = simulate(SCENES["bystanders"], 0, 1).truth_document()["frames"][0]
    assert [bool(s.get("ignore")) for s in frame["skeletons"]] == [False] * 3 + [True] * 3
    frames = simulate(SCENES["enter-leave"], 0).truth_document()["frames"]
    assert len({len(f["skeletons"]) for f in frames}) >= 3


def test_true_associations_triangulate_to_the_truth():
    take = simulate(SCENES["noisy-8p10v"], 0, 2)
    gaps = []
    for index, views in take.sightings():
        tick = take.schedule.ticks[index : index + 1]
        pixels = np.full((len(take.people), 19, len(take.rig), 2), np.nan)
        for c, view in enumerate(views):
            for points, source in zip(view.points, view.sources):
                known = source[:, 0] >= 0
                pixels[source[known, 0], source[known, 1], c] = points[known]
        for number, person in enumerate(take.people):
            truth = person.joints(tick)[0]
            rays = np.stack(
                [
                    camera.intrinsics.undistort(pixels[number, :, c])
                    for c, camera in enumerate(take.rig.cameras)
                ],
                axis=1,
            )
            sigmas = np.ones(rays.shape[:2])
            found = triangulate_robust(take.rig.stack(), rays, sigmas)
            gaps.append(np.linalg.norm(found.points - truth, axis=-1))
    gaps = np.concatenate(gaps)
    assert np.nanmedian(gaps) < 0.012 and np.isfinite(gaps).mean() > 0.98


def test_bad_scenes_are_named():
    with pytest.raises(UsageError, match="picnic"):
        scene("picnic")
    with pytest.raises(UsageError, match="upside-down"):
        SimulatedScene("", ("walk",), Ring(4), staging="upside-down")
    for seed, frames in ((-1, 3), (0, 0)):
        with pytest.raises(UsageError):
            simulate(SCENES["crossing"], seed, frames)
