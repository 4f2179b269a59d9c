"""URDF: joint angles put its links where the segments are."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest
from bodies import BODY, MODEL, placed, some_pose
from scipy.spatial.transform import Rotation

from panoptic_ros.domain.body_names import joint_names, link_names
from panoptic_ros.export.urdf import urdf_text
from panoptic_ros.io.body_models import read_body_shape


def numbers(text):
    return np.array(text.split(), float)


def links_placed(text, angles):
    """Places of links under their root, as robot_state_publisher would have them."""
    robot = ET.fromstring(text)
    links = [link.get("name") for link in robot.findall("link")]
    assert len(set(links)) == len(links)
    joints = {}
    for joint in robot.findall("joint"):
        limit = joint.find("limit")
        assert float(limit.get("lower")) < float(limit.get("upper")) and float(limit.get("effort")) > 0
        below = joint.find("child").get("link")
        assert below not in joints  # one parent each
        joints[below] = joint
    (root,) = set(links) - set(joints)
    found = {root: (np.eye(3), np.zeros(3))}

    def place(name):
        if name not in found:
            joint = joints[name]
            frame, at = place(joint.find("parent").get("link"))
            origin, axis = joint.find("origin"), numbers(joint.find("axis").get("xyz"))
            fixed = Rotation.from_euler("xyz", numbers(origin.get("rpy"))).as_matrix()
            turn = Rotation.from_rotvec(angles[joint.get("name")] * axis).as_matrix()
            found[name] = frame @ fixed @ turn, at + frame @ numbers(origin.get("xyz"))
        return found[name]

    return root, {name: place(name) for name in links}


@pytest.mark.parametrize("seed", range(5))
def test_forward_kinematics_are_those_of_the_body(seed):
    frames, places = placed(some_pose(seed))
    text = urdf_text(read_body_shape(MODEL), BODY.offsets, "p4", (1.0, 0.5, 0.0))
    angles = dict(zip(joint_names(MODEL, "p4"), MODEL.joint_angles(frames)))
    root, found = links_placed(text, angles)
    assert root == "body_p4"
    for s, name in enumerate(link_names(MODEL, "p4")):
        turned, at = found[name]
        assert places[0] + frames[0] @ at == pytest.approx(places[s], abs=1e-6)
        assert frames[0] @ turned == pytest.approx(frames[s], abs=1e-6)


def test_visible_forms_lie_along_the_bones():
    robot = ET.fromstring(urdf_text(read_body_shape(MODEL), BODY.offsets, "p4", (1.0, 0.5, 0.0)))
    (arm,) = [link for link in robot.findall("link") if link.get("name") == "lUpperArm_p4"]
    (form,) = [v for v in arm.findall("visual") if v.find("geometry/cylinder") is not None]
    origin = form.find("origin")
    turn = Rotation.from_euler("xyz", numbers(origin.get("rpy"))).as_matrix()
    half = 0.5 * float(form.find("geometry/cylinder").get("length"))
    end = numbers(origin.get("xyz")) + turn @ [0, 0, half]
    assert end == pytest.approx(BODY.offsets[MODEL.index("lForearm")], abs=1e-4)
