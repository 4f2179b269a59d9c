"""People whom two views show keep joints that the views dispute or only one of them sees."""
import numpy as np
from fed_stages import FedAssembly

from panoptic_ros.assembly.disputed import Ray, along_bone, between
from panoptic_ros.domain import SkeletonModel

ARMS = SkeletonModel("arms", ("neck", "left", "right"), 0, ((0, 1), (0, 2)), 0, ((1, 2),))


def ray(origin, target):
    direction = np.subtract(target, origin)
    return Ray(np.array(origin, float), direction / np.linalg.norm(direction), 0.5)


def test_between_rays_that_pass_each_other():
    point, covariance = between(ray([0, -3, 1], [0, 0, 1]), ray([-3, 0, 1.1], [0, 0, 1.1]))
    assert np.allclose(point, [0, 0, 1.05])
    assert np.linalg.eigvalsh(covariance).min() >= 0.05**2
    assert between(ray([0, -3, 1], [0, 0, 1]), ray([-3, 0, 1.4], [0, 0, 1.4])) is None  # too far
    assert between(ray([0, -3, 1], [0, 0, 1]), ray([-3, 0, 1], [-6, 0, 1])) is None  # behind the camera
    assert between(ray([0, -3, 1], [0, 0, 1]), ray([1, -3, 1], [1, 0, 1])) is None  # parallel


def test_along_a_ray_where_the_bone_has_the_length_of_the_other():
    positions = np.array([[0.0, 0, 1], [0.3, 0, 1], [np.nan] * 3])
    seen = ray([-0.2, -4, 1], [-0.2, 0, 1])
    depth = np.sqrt(0.3**2 - 0.2**2)
    point, covariance = along_bone(seen, 2, np.array([-0.2, 0.4, 1]), positions, ARMS)
    assert np.allclose(point, [-0.2, depth, 1]) and covariance[1, 1] > covariance[0, 0]
    middle, wide = along_bone(seen, 2, np.full(3, np.nan), positions, ARMS)  # nothing says which of two
    assert np.allclose(middle, [-0.2, 0, 1]) and wide[1, 1] > depth**2
    assert along_bone(ray([-1, -4, 1], [-1, 0, 1]), 2, np.full(3, np.nan), positions, ARMS) is None


def test_a_joint_beside_its_neighbour_where_no_bone_tells():
    positions = np.array([[0.0, 0, 1], [np.nan] * 3, [np.nan] * 3])
    point, covariance = along_bone(ray([0.1, -4, 1], [0.1, 0, 1]), 1, np.full(3, np.nan), positions, ARMS)
    assert np.allclose(point, [0.1, 0, 1]) and covariance[1, 1] >= 0.1**2
    assert along_bone(ray([0.3, -4, 1], [0.3, 0, 1]), 1, np.full(3, np.nan), positions, ARMS) is None


def solve(scenes, views, change, frames=8):
    rig, person = scenes.ring(3), scenes.person(0.2, 0.1)
    rig = rig.subset(rig.names[:views])
    stage = FedAssembly(scenes.context(rig))
    for index in range(frames):
        pose = stage.step(scenes.proposals(rig, [person], index=index, noise=1.0, change=change)).outputs[0]
    return pose, np.linalg.norm(pose.positions[0] - person, axis=-1)


def test_two_views_lose_no_joint_to_a_miss_or_a_mistake(scenes):
    missed, wrong = scenes.skeleton.joint("rElbow"), scenes.skeleton.joint("lShoulder")

    def change(i, points, scores):
        if i == 0:
            points[:, missed], scores[:, missed] = np.nan, 0.0
            points[:, wrong, 1] += 30.0

    pose, errors = solve(scenes, 2, change)
    assert errors[missed] < 0.2 and pose.views[0, missed] == 1
    assert errors[wrong] < 0.1 and pose.views[0, wrong] == 2
    sigma = np.sqrt(np.trace(pose.covariances[0], axis1=1, axis2=2) / 3.0)
    others = np.delete(np.arange(len(errors)), [missed, wrong])
    assert sigma[[missed, wrong]].min() > 2.0 * np.median(sigma[others])
    assert (errors < 6.0 * sigma).all()


def test_three_views_leave_out_what_they_cannot_tell(scenes):
    missed = scenes.skeleton.joint("rElbow")

    def change(i, points, scores):
        if i < 2:
            points[:, missed], scores[:, missed] = np.nan, 0.0

    pose, _ = solve(scenes, 3, change)
    assert pose.views[0, missed] == 0 and np.isnan(pose.positions[0, missed]).all()
