import itertools
from dataclasses import replace

import numpy as np
import pytest
from fed_stages import unassociated

from panoptic_ros.assembly.dynamic_programming import PartTree, assemble
from panoptic_ros.domain import Camera, DetectionSet, ProposalSet, Rig, SkeletonModel, ViewDetections
from panoptic_ros.geometry import Intrinsics, Rigid

# root 0 with children 1, 2, 3; chains 1-4-5 and 2-6
BONES = ((0, 1), (0, 2), (0, 3), (1, 4), (4, 5), (2, 6))
MODEL = SkeletonModel("tree", tuple("abcdefg"), 0, BONES, 4)
SKIPS = ((0, 4), (1, 5), (0, 6), (1, 2), (1, 3), (2, 3))


def proposals(counts, parts, skeleton=MODEL, detections=None, nodes=None):
    """parts: {(node, node): score}; nodes are numbered joint after joint."""
    joints = np.repeat(np.arange(len(counts)), counts)
    nodes = np.zeros((len(joints), 3)) if nodes is None else nodes
    pairs = np.array(list(parts), int).reshape(-1, 2)
    kinds = [tuple(joints[list(pair)].tolist()) for pair in pairs]
    bones = [skeleton.bones.index(kind) if kind in skeleton.bones else -1 for kind in kinds]
    return ProposalSet(
        unassociated(detections or DetectionSet(0, 0, skeleton.hash, ()), len(skeleton)),
        nodes,
        joints,
        np.ones(len(joints)),
        np.ones(len(joints)),
        pairs,
        bones,
        list(parts.values()),
    )


def random_parts(rng, counts, kinds, density):
    start = np.concatenate([[0], np.cumsum(counts)])
    parts = {}
    for a, b in kinds:
        for u in range(start[a], start[a + 1]):
            for v in range(start[b], start[b + 1]):
                if rng.random() < density:
                    parts[u, v] = rng.uniform(0.01, 1.0)
    return parts


def brute_force(counts, parts, weight):
    """Best sum over all choices, including missing joints, that hang together."""
    start = np.concatenate([[0], np.cumsum(counts)])
    choices = [[-1, *range(start[j], start[j + 1])] for j in range(len(counts))]
    return max(value(nodes, parts, weight) for nodes in itertools.product(*choices))


def value(nodes, parts, weight):
    parent = MODEL.parents
    tops = [j for j in (1, 2, 3) if nodes[j] >= 0]
    best = -1.0
    for top in [0] if nodes[0] >= 0 else tops:
        total = 0.0
        for j in range(7):
            if nodes[j] < 0 or j == top:
                continue
            up = parent[j]
            if up >= 0 and nodes[up] >= 0:
                total += parts.get((nodes[up], nodes[j]), -100.0)
            elif up == 0:  # no root: on the top
                a, b = sorted((nodes[top], nodes[j]))
                total += weight * parts.get((a, b), -100.0)
            elif parent[up] >= 0 and nodes[parent[up]] >= 0:
                total += weight * parts.get((nodes[parent[up]], nodes[j]), -100.0)
            else:
                total -= 100.0
        best = max(best, total)
    return max(best, 0.0)


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("weight", [0.5, 1.0])
def test_the_best_of_all_combinations_is_found(seed, weight):
    rng = np.random.default_rng(seed)
    counts = rng.integers(0, 3, 7)
    parts = random_parts(rng, counts, BONES + SKIPS, 0.7)
    tree = PartTree(proposals(counts, parts), MODEL, weight)
    score, nodes = tree.best()
    assert score == pytest.approx(brute_force(counts, parts, weight))
    assert value(nodes, parts, weight) == pytest.approx(score)


@pytest.mark.parametrize("seed", range(10))
def test_without_skips_it_is_the_sum_over_the_bones_of_the_paper(seed):
    rng = np.random.default_rng(seed)
    counts = np.full(7, 3)
    parts = random_parts(rng, counts, BONES, 1.0)
    score, nodes = PartTree(proposals(counts, parts), MODEL, 0.5).best()
    choices = itertools.product(*(range(3 * j, 3 * j + 3) for j in range(7)))
    expected = max(sum(parts[c[a], c[b]] for a, b in BONES) for c in choices)
    assert score == pytest.approx(expected)
    assert (nodes >= 0).all()


def test_nodes_that_were_removed_are_not_used_again():
    rng = np.random.default_rng(3)
    counts = np.full(7, 3)
    parts = random_parts(rng, counts, BONES + SKIPS, 1.0)
    tree, used, scores = PartTree(proposals(counts, parts), MODEL, 0.5), set(), []
    for _ in range(3):
        score, nodes = tree.best()
        tree.remove(nodes[nodes >= 0])
        assert not used & set(nodes.tolist())
        used |= set(nodes.tolist())
        scores.append(score)
    assert scores == sorted(scores, reverse=True)
    assert tree.best()[0] == 0.0


def camera(name, x, y):
    centre = np.array([x, y, 1.0])
    forward = np.array([0.0, 0.0, 1.0]) - centre
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    matrix = np.array([[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]])
    return Camera(name, (640, 480), Intrinsics(matrix, np.zeros(5)), Rigid(rotation, -rotation @ centre))


RIG = Rig((camera("a", 3.0, 0.3), camera("b", -0.4, 3.0), camera("c", -3.0, 1.0)))
BODY = np.array(
    [[0, 0, 1.0], [0, 0, 1.5], [0.1, 0, 0.5], [-0.1, 0, 0.5], [0, 0.1, 1.7], [0, 0.2, 1.7], [0.1, 0, 0.1]]
)


def seen(people, drop=()):
    """Detections of people (P, 7, 3); drop: (view, person, joint)."""
    views = []
    for v, each in enumerate(RIG.cameras):
        pixels = each.project(people)[0]
        scores = np.full(pixels.shape[:2], 0.9)
        for view, i, j in drop:
            if view == v:
                pixels[i, j], scores[i, j] = np.nan, 0.0
        views.append(
            ViewDetections(each.name, 0, 0, (640, 480), MODEL.hash, pixels, scores, np.ones(len(people)))
        )
    return DetectionSet(0, 0, MODEL.hash, tuple(views))


def scene(people, drop=(), missing=()):
    """Proposals with a node for every joint of people but the missing (person, joint), and true parts."""
    detections = seen(people, drop)
    nodes, number = [], {}
    for j in range(7):
        for i in range(len(people)):
            if (i, j) not in missing:
                number[i, j] = len(nodes)
                nodes.append(people[i, j])
    counts = [sum((i, j) in number for i in range(len(people))) for j in range(7)]
    parts = {}
    for i in range(len(people)):
        for a, b in BONES + SKIPS:
            if (i, a) in number and (i, b) in number:
                parts[number[i, a], number[i, b]] = 0.8 - 0.1 * i
    return proposals(counts, parts, detections=detections, nodes=np.array(nodes))


GATE = 10.0  # px
PEOPLE = np.stack([BODY, BODY + (0.8, 0.4, 0.0)])


def test_people_claim_their_own_2d_joints_the_best_first():
    item = scene(PEOPLE)
    people = assemble(item, RIG, MODEL, GATE)
    assert len(people) == 2
    for i, person in enumerate(people):
        assert np.allclose(item.nodes[person.nodes], PEOPLE[i])
        assert (person.claims == i).all()


def test_with_skips_a_missing_joint_does_not_cut_off_its_limb():
    for joint in (0, 1):
        people = assemble(scene(PEOPLE, missing={(0, joint)}), RIG, MODEL, GATE)
        assert len(people) == 2
        first = next(person for person in people if (person.claims[2] == 0).all())
        assert (first.nodes < 0).tolist() == [j == joint for j in range(7)]


def test_a_second_skeleton_on_the_same_2d_people_is_no_person():
    double = np.stack([BODY, BODY + 0.001])
    item = scene(double)
    one = replace(item, association=unassociated(seen(BODY[None]), len(MODEL)))
    people = assemble(one, RIG, MODEL, GATE)
    assert len(people) == 1
    assert (people[0].claims == 0).all()


def test_a_head_in_one_view_is_no_person_and_frees_its_2d_joints():
    drop = [(0, 0, 4), (1, 0, 4)]
    assert assemble(scene(BODY[None], drop), RIG, MODEL, GATE) == []
    ghost = np.stack([BODY, BODY])
    ghost[0, 4] += 0.5  # a better skeleton with a wrong head would take all 2D joints
    item = scene(ghost, drop=[(v, 0, j) for v in range(3) for j in range(7)])
    people = assemble(item, RIG, MODEL, GATE)
    assert len(people) == 1
    assert np.allclose(item.nodes[people[0].nodes], BODY)


def test_without_a_head_nobody_is_a_person():
    assert assemble(scene(BODY[None], missing={(0, 4)}), RIG, MODEL, GATE) == []


def test_nothing_makes_nobody():
    assert assemble(proposals([0] * 7, {}), RIG, MODEL, GATE) == []
    assert assemble(proposals([1] * 7, {}), RIG, MODEL, GATE) == []
