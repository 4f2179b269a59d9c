"""Records that are not what their topic, the rig and the skeleton say are refused by name."""

from dataclasses import replace

import captures
import numpy as np
import pytest
from stage_cases import chain

from panoptic_ros.domain import ViewFrame
from panoptic_ros.errors import DataError
from panoptic_ros.graph.entrance import check_record

VIEW = captures.view(captures.RIG.cameras[0], 0, 0)


def check(view, camera="cam0"):
    check_record(view, camera, captures.RIG, captures.SKELETON)


def test_what_is_right_passes():
    check(VIEW)
    check(ViewFrame("cam0", 0, 0, np.zeros((720, 1280, 3), np.uint8)))


@pytest.mark.parametrize(
    ("view", "camera", "told"),
    [
        (VIEW, "cam1", "of camera 'cam0' came on a topic of cam1"),
        (replace(VIEW, image_size=(640, 360)), "cam0", "640 x 360, but it is calibrated for 1280 x 720"),
        (ViewFrame("cam0", 0, 0, np.zeros((36, 64, 3), np.uint8)), "cam0", "64 x 36"),
        (replace(VIEW, points=VIEW.points[:, :5], scores=VIEW.scores[:, :5]), "cam0", "5 joints"),
    ],
)
def test_what_is_not(view, camera, told):
    with pytest.raises(DataError, match=told):
        check(view, camera)


def test_what_the_stages_give_passes():
    for topic in ("sync", "association", "voting", "assembly", "tracking", "refinement"):
        for record in chain()[topic]:
            check(record, getattr(record, "camera", ""))


def test_indices_beyond_cameras_and_joints():
    proposals = chain()["assembly"][-1]
    evidence = proposals.association.evidence
    with pytest.raises(DataError, match="names cameras"):
        check(replace(proposals.association, evidence=replace(evidence, cameras=evidence.cameras + 1)))
    joint = np.full(1, len(captures.SKELETON.joint_names))
    beyond = replace(
        proposals,
        nodes=np.zeros((1, 3)),
        node_joints=joint,
        node_scores=np.ones(1),
        node_views=np.ones(1),
        parts=np.zeros((0, 2)),
        part_bones=np.zeros(0),
        part_scores=np.zeros(0),
    )
    with pytest.raises(DataError, match="ProposalSet.node_joints names"):
        check(beyond)


@pytest.mark.parametrize(
    ("damage", "told"),
    [
        (lambda e: {"plane": e.plane * 1.01}, "Evidence.plane differs"),
        (lambda e: {"magnification": e.magnification * 2.0}, "Evidence.magnification differs"),
        (lambda e: {"delays": e.delays + 0.1}, "Evidence.delays differ"),
        (lambda e: {"rows": e.rows + 5}, "people of camera cam0 that its view lacks"),
    ],
)
def test_evidence_that_its_2d_people_do_not_give(damage, told):
    """It would spoil assembly's tables of noise, which learn from it."""
    item = chain()["voting"][-1]
    with pytest.raises(DataError, match=told):
        check(replace(item, evidence=replace(item.evidence, **damage(item.evidence))))
