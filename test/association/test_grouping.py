"""Grouping of 2D people: greedy assignment against brute force, new people in scenes of known truth."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.association.config import AssociationConfig
from panoptic_ros.association.grouping import MIN_COMMON, MIRROR_MARGIN, assign, find_people
from panoptic_ros.domain import Evidence
from panoptic_ros.domain.rig_arrays import CAMERA
from panoptic_ros.solving.agreement import agreement_with_people
from panoptic_ros.solving.scene import CameraPoses, Scene, ViewVisibility

JOINTS = 7
MIRROR = np.array([0, 2, 1, 4, 3, 6, 5])
CONFIG = AssociationConfig()


def looking_in(views):
    """Cameras on a circle of 4 m that look at the origin."""
    rotations, centres = [], []
    for i in range(views):
        angle = 2 * np.pi * i / views + 0.2
        centre = np.array([4 * np.cos(angle), 4 * np.sin(angle), 1.0])
        forward = -centre / np.linalg.norm(centre)
        right = np.cross(forward, [0, 0, 1.0])
        right /= np.linalg.norm(right)
        rotations.append([right, np.cross(forward, right), forward])
        centres.append(centre)
    rotations, centres = np.array(rotations), np.array(centres)
    return rotations, -np.einsum("vij,vj->vi", rotations, centres), centres


def scene_of(people, views=5, noise=0.001, keep=1.0, seed=0, swapped=()):
    """A scene (and who each 2D person is) of people (P, J, 3), in a random order in every view."""
    rng = np.random.default_rng(seed)
    rotations, translations, centres = looking_in(views)
    plane, view, truth = [], [], []
    for v in range(views):
        for p in rng.permutation(len(people)):
            if rng.random() > keep:
                continue
            local = people[p] @ rotations[v].T + translations[v]
            points = local[:, :2] / local[:, 2:] + noise * rng.normal(size=(JOINTS, 2))
            plane.append(points[MIRROR] if (v, p) in swapped else points)
            view.append(v)
            truth.append(p)
    plane, view = np.array(plane).reshape(-1, JOINTS, 2), np.array(view, np.int64)
    starts = np.searchsorted(view, np.arange(views + 1)).astype(np.int64)
    scores, delays = np.full(plane.shape[:2], 0.8), np.zeros(views)
    evidence = Evidence(
        np.arange(views),
        np.arange(views),
        starts,
        view,
        np.arange(len(view)) - starts[view],
        plane,
        np.ones(scores.shape),
        scores,
        delays,
    )
    cams = CameraPoses(rotations, translations, delays)
    cameras = np.zeros(views, CAMERA)  # of images of x and y from -1 to 1
    for name, value in {"fx": 1, "fy": 1, "cx": 0.5, "cy": 0.5, "width": 2, "height": 2, "fold": 9}.items():
        cameras[name] = value
    sight = ViewVisibility(cameras, np.zeros(3 * views))
    precision, focals = np.full(plane.shape[:2], 500.0), np.full(views, 1000.0)
    sizes, late = np.full(len(plane), np.inf), np.zeros(scores.shape)
    scene = Scene(evidence, precision, MIRROR, cams, centres, focals, sight, sizes, late)
    return scene, np.array(truth, int)


def crowd(count, seed):
    """People (P, J, 3) some steps apart, with sides half a metre wide."""
    rng = np.random.default_rng(seed)
    places = np.array([[0.0, 0], [1.2, 0.3], [-1.0, 0.8], [0.2, -1.3]])[:count]
    left = [[0, 0.25, 0.5], [0, 0.2, 0.0], [0.1, 0.2, -0.5]]
    right = [[0, -0.25, 0.5], [0, -0.2, 0.0], [0, -0.2, -0.6]]
    shape = np.array([[0, 0, 0.7], left[0], right[0], left[1], right[1], left[2], right[2]])
    bodies = shape + 0.05 * rng.normal(size=(count, JOINTS, 3))
    bodies[..., :2] += places[:, None]
    return bodies


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 10_000))
def test_assignment_equals_the_best_first_rule(seed):
    people = crowd(3, seed)
    scene, _ = scene_of(people, noise=0.01, keep=0.8, seed=seed)
    rng = np.random.default_rng(seed)
    positions = people + 0.05 * rng.normal(size=people.shape)
    free = rng.random(len(scene.evidence.view)) < 0.9
    got, left = assign(scene, positions, np.zeros_like(positions), free, CONFIG, 0.08)
    straight, mirrored, common = agreement_with_people(
        positions, np.zeros_like(positions), scene.observations, MIRROR, 0.08
    )
    flipped = mirrored > MIRROR_MARGIN * straight
    value = np.where(flipped, mirrored, straight) * (common >= MIN_COMMON) * free
    member = np.full((3, 5), -1)
    taken = ~free
    for _, p, d in sorted((-value[p, d], p, d) for p in range(3) for d in range(value.shape[1])):
        v = scene.evidence.view[d]
        if value[p, d] >= CONFIG.person_agreement and not taken[d] and member[p, v] < 0:
            member[p, v], taken[d] = d, True
    assert (got.member == member).all()
    assert not left[member[member >= 0]].any() and not left[~free].any()


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 10_000))
def test_new_people_are_those_who_are_there(seed):
    people = crowd(4, seed)
    scene, truth = scene_of(people, seed=seed)
    free = np.ones(len(truth), bool)
    found, places = find_people(scene, free, CONFIG)
    assert len(found.member) == 4
    owners = [set(truth[row[row >= 0]]) for row in found.member]
    assert all(len(owner) == 1 for owner in owners) and set.union(*owners) == {0, 1, 2, 3}
    for owner, place in zip(owners, places):
        assert np.abs(place - people[owner.pop()]).max() < 0.05


def test_a_view_that_exchanges_sides_is_mirrored():
    people = crowd(1, 3)
    scene, _ = scene_of(people, swapped={(2, 0)})
    still = np.zeros_like(people)
    got, _ = assign(scene, people, still, np.ones(5, bool), CONFIG, 0.08)
    assert got.mirrored.tolist() == [[False, False, True, False, False]]


def test_one_view_alone_is_nobody():
    scene, _ = scene_of(crowd(2, 0), views=1)
    found, places = find_people(scene, np.ones(2, bool), CONFIG)
    assert len(found.member) == 0 and len(places) == 0
