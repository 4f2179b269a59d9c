"""Runs with one camera or none, for the bodies of designated people."""

import json

import captures
import numpy as np
import pytest
from recordings import write_bag

from panoptic_ros.capture.imus import imu_samples
from panoptic_ros.domain.subjects import ImuSeries
from panoptic_ros.errors import CalibrationError, DataError, UsageError
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.kinematic_files import write_imus
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.running.plans.bag_plan import plan_bags
from panoptic_ros.running.plans.bag_topics import BagChoice
from panoptic_ros.running.plans.imu_plan import plan_live_imus
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.planning import plan_capture


@pytest.fixture
def folder(tmp_path):
    """A capture folder of a person with an IMU on the chest, without any camera."""
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (20, 1))
    series = ImuSeries(np.arange(20) * 10**7, turns, np.zeros((20, 3)), np.tile([0, 0, 9.81], (20, 1)))
    write_imus(tmp_path / "imu.csv.gz", {"chest": series})
    worn = {"device": "chest", "segment": "spine4", "mount": [1, 0, 0, 0]}
    document = {"format": "panoptic-subject-1", "id": 4, "height_m": 1.7, "devices": [worn]}
    (tmp_path / "subject.json").write_text(json.dumps(document))
    return tmp_path


def options(folder, **more):
    return RunOptions(subjects=(folder / "subject.json",), **more)


def test_a_folder_without_cameras_runs_bodies_alone(folder):
    plan = plan_capture(folder)
    assert len(plan.rig) == 0 and plan.stages == ("kinematics",) and plan.imu_devices == ("chest",)
    assert any("IMUs alone" in line for line in plan.notices)


def test_live_imus_are_those_that_are_worn(folder):
    plan = plan_live_imus(options(folder))
    assert plan.live and plan.stages == ("kinematics",) and plan.imu_devices == ("chest",)


def test_a_bag_of_imus_alone(folder, tmp_path):
    with BagWriter(tmp_path / "bag") as bag:
        for sample in imu_samples(folder / "imu.csv.gz", ["chest"]):
            bag.write("/lab/chest/imu", sample.stamp_ns, to_message(sample, bag_messages()))
    plan = plan_bags([tmp_path / "bag"], options(folder))
    assert len(plan.rig) == 0 and [s.topic for s in plan.streams] == ["/lab/chest/imu"]


def test_one_camera_is_enough_for_a_designated_person(folder, tmp_path):
    bag = write_bag(tmp_path / "bag", captures.views())
    choice = BagChoice(cameras=captures.RIG.names[:1])
    plan = plan_bags([bag], options(folder), choice=choice)
    assert plan.rig.names == captures.RIG.names[:1] and "tracking" in plan.stages
    with pytest.raises(CalibrationError, match=r"1 camera \(.*--subject FILE .* one is enough"):
        plan_bags([bag], choice=choice)


def test_what_cannot_be_is_told_with_a_way_out(folder, tmp_path):
    with pytest.raises(UsageError, match="IMUs without cameras need --subject FILE"):
        plan_live_imus(RunOptions())
    document = json.loads((folder / "subject.json").read_text())
    (folder / "subject.json").write_text(json.dumps({**document, "devices": []}))
    with pytest.raises(UsageError, match="no subject wears any of chest"):
        plan_capture(folder)
    (folder / "detections.json.gz").write_bytes(b"")
    with pytest.raises(DataError, match="has no videos and no images; for its 2D people: panoptic solve"):
        plan_capture(folder)
    (folder / "bag").mkdir()
    with pytest.raises(DataError, match=r"it has a bag: panoptic run --bag .*bag"):
        plan_capture(folder)
