import numpy as np
import pytest
from score_fields import ViewField

from panoptic_ros.voting.parts import score_parts
from panoptic_ros.voting.scene import build_scene


def phi(fields, cameras, a, joint_a, b, joint_b, threshold, people):
    """5.2 of Joo et al. 2017, written out for one pair of nodes."""
    scores = []
    for field, camera in zip(fields, cameras):
        pixels, seen = camera.project(np.stack([a, b]))
        if not (seen & field.covers(pixels)).all():
            continue
        best = 0.0
        for i in range(people):
            u = field.sample_person(i, joint_a, pixels[:1])[0]
            v = field.sample_person(i, joint_b, pixels[1:])[0]
            if u > threshold and v > threshold:
                best = max(best, 0.5 * (u + v))
        scores.append(best)
    return float(np.mean(scores)) if scores else 0.0


@pytest.mark.parametrize("maps", ["none", "merged", "person"])
def test_scores_are_those_of_the_paper(scenes, maps):
    rig = scenes.ring(4)
    people = [scenes.person(0.2, 0.1), scenes.person(-0.2, -0.2, 2.0)]
    views = scenes.detect(rig, people, maps).views
    scene, fields = build_scene(rig.cameras, views, 19), [ViewField(view) for view in views]
    rng = np.random.default_rng(0)
    joints = np.repeat([3, 4, 5], 8)
    nodes = np.stack([people[n % 2][j] + rng.normal(0.0, 0.02, 3) for n, j in enumerate(joints)])
    kinds = ((3, 4), (4, 5))
    parts, bones, scores = score_parts(scene, nodes, joints, kinds, 0.25, 0.05)
    found = {(a, b): (k, s) for (a, b), k, s in zip(parts.tolist(), bones.tolist(), scores.tolist())}
    for bone, (parent, child) in enumerate(kinds):
        for a in np.flatnonzero(joints == parent):
            for b in np.flatnonzero(joints == child):
                expected = phi(fields, rig.cameras, nodes[a], parent, nodes[b], child, 0.05, 2)
                if np.linalg.norm(nodes[a] - nodes[b]) > 0.25:
                    expected = 0.0
                got = found.pop((a, b), (bone, 0.0))
                assert got == (bone, pytest.approx(expected, abs=1e-12))
    assert not found
    assert scores.max() > 0.5


def test_without_nodes_there_are_no_parts(scenes):
    rig = scenes.ring(2)
    scene = build_scene(rig.cameras, scenes.detect(rig, []).views, 19)
    bones = scenes.skeleton.bones
    parts, which, scores = score_parts(scene, np.zeros((0, 3)), np.zeros(0, int), bones, 0.8, 0.05)
    assert parts.shape == (0, 2)
    assert len(which) == len(scores) == 0
