"""Runs with designated people: bodies beside skeletons, from 2D people and IMUs in bags."""

import json

import captures
import numpy as np
import pytest
from recordings import write_bag

from panoptic_ros.capture.imus import imu_devices, imu_file, imu_samples
from panoptic_ros.domain import BodySource, ImuSample
from panoptic_ros.domain.subjects import ImuSeries
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import make_stage
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.body_files import read_bodies
from panoptic_ros.io.kinematic_files import write_imus
from panoptic_ros.io.messages import bag_messages, from_message, to_message
from panoptic_ros.running.plans.bag_plan import plan_bags
from panoptic_ros.running.plans.bag_topics import BagChoice
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.planning import plan_capture
from panoptic_ros.running.runs.in_process import run_in_process
from panoptic_ros.running.runs.results import Results
from panoptic_ros.stage import StageContext


def subject(path, number=4, device="back"):
    mounted = {"device": device, "segment": "spine4", "mount": [1, 0, 0, 0]}
    start = captures.people(0.0)[1, captures.SKELETON.joint("BodyCenter")].tolist()
    document = {
        "format": "panoptic-subject-1",
        "id": number,
        "height_m": 1.7,
        "start": start,
        "devices": [mounted],
    }
    path.write_text(json.dumps(document))
    return path


def series(count=40):
    turns = np.tile([np.cos(0.2), 0.0, 0.0, np.sin(0.2)], (count, 1))
    return ImuSeries(
        np.arange(count) * 16_666_667, turns, np.zeros((count, 3)), np.tile([0, 0, 9.81], (count, 1))
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bodies")
    write_imus(folder / "imu.csv.gz", {"back": series(), "other": series(3)})
    write_bag(folder / "bag", captures.views(20))
    subject(folder / "subject.json")
    return folder


def test_samples_of_a_file_come_by_their_stamps(folder):
    path = imu_file(folder)
    assert path.name == "imu.csv.gz" and imu_devices(path) == ("back", "other")
    samples = list(imu_samples(path, ["back", "other"]))
    assert len(samples) == 43 and [s.stamp_ns for s in samples] == sorted(s.stamp_ns for s in samples)
    assert samples[0].force.tolist() == [0, 0, 9.81]


def test_a_run_leaves_bodies_and_a_bag_that_gives_them_again(folder, tmp_path):
    options = RunOptions(subjects=(folder / "subject.json",), imus=folder / "imu.csv.gz")
    plan = plan_bags([folder / "bag"], options)
    assert plan.imu_devices == ("back",)
    assert "IMU other is on no subject and left out" in plan.notices
    (tmp_path / "first").mkdir()
    with Results(tmp_path / "first", plan) as results:
        run_in_process(plan, results, lambda: False)
    names, states = read_bodies(tmp_path / "first" / "kinematics.json.gz")
    assert {state.id for state in states} == {4} and len(states) > 30 and len(names) == 21
    place = captures.people(0.0)[1, captures.SKELETON.joint("BodyCenter")]
    assert np.linalg.norm(states[-1].places[0] - place) < 0.1
    with BagReader(tmp_path / "first" / "bag") as bag:
        sets = [from_message(m, "BodyStateSet") for *_, m in bag.messages("/bodies")]
        assert bag.counts["/back/imu"] == 40
    last = sets[20]
    assert last.sources[0] == BodySource.TRACK and last.devices.tolist() == [1]

    again = plan_bags([tmp_path / "first" / "bag"], RunOptions(subjects=(folder / "subject.json",)))
    (tmp_path / "again").mkdir()
    with Results(tmp_path / "again", again, pictures=False) as results:
        run_in_process(again, results, lambda: False)
    assert not results.drawn and results.bodies.instants > 30
    both = [(tmp_path / name / "kinematics.json.gz").read_bytes() for name in ("first", "again")]
    assert both[0] == both[1]


def test_two_files_do_not_share_a_device(folder, tmp_path):
    files = (folder / "subject.json", subject(tmp_path / "subject2.json", 5))
    with pytest.raises(UsageError, match=r"subject.json and .*subject2.json both have device back"):
        plan_bags([folder / "bag"], RunOptions(subjects=files))


def test_a_sample_goes_through_a_message_and_back():
    nothing = np.full(3, np.nan)
    message = to_message(ImuSample("arm", 5, [1, 0, 0, 0], nothing, [0, 0, 9.8]), bag_messages())
    assert message.angular_velocity_covariance[0] == -1.0 and message.header.frame_id == "arm"
    back = from_message(message, "ImuSample")
    assert np.isnan(back.rate).all() and back.force.tolist() == [0, 0, 9.8]


def run_of(plan, folder):
    """States of the bodies of a run in this process, and its tally."""
    folder.mkdir()
    with Results(folder, plan) as results:
        run_in_process(plan, results, lambda: False)
    return read_bodies(folder / "kinematics.json.gz")[1], results.bodies


def test_one_camera_is_enough_for_a_body(folder, tmp_path):
    options = RunOptions(subjects=(folder / "subject.json",))
    plan = plan_bags([folder / "bag"], options, choice=BagChoice(cameras=captures.RIG.names[:1]))
    states, tally = run_of(plan, tmp_path / "out")
    assert len(states) > 30 and set(tally.sources[4]) <= {BodySource.VIEWS, BodySource.PREDICTED}
    camera = captures.RIG.cameras[0]
    place = captures.people(0.0)[1, captures.SKELETON.joint("BodyCenter")]
    seen = camera.project(np.stack([states[-1].places[0], place]))[0]
    assert np.linalg.norm(seen[0] - seen[1]) < 60  # px: depth is not known, the direction is


def test_imus_alone_give_bodies_and_no_skeletons(folder, tmp_path):
    only = tmp_path / "only"
    only.mkdir()
    for name in ("imu.csv.gz", "subject.json"):
        (only / name).write_bytes((folder / name).read_bytes())
    states, tally = run_of(plan_capture(only), tmp_path / "out")
    assert len(states) > 30 and set(tally.sources[4]) <= {BodySource.IMUS, BodySource.PREDICTED}
    assert tally.document()["subjects"][0]["devices"] == 1.0


def test_bad_imus_are_told_once_and_the_other_goes_on(folder, tmp_path):
    good = series(200)
    turned = ImuSeries(good.stamps, good.quaternions, good.rates, -good.forces)  # gravity the other way up
    dead = ImuSeries(*(values[:30] for values in (good.stamps, good.quaternions, good.rates, good.forces)))
    repeated = ImuSeries(np.repeat(good.stamps[::2], 2), good.quaternions, good.rates, good.forces)
    worn = {"back": good, "turned": turned, "dead": dead, "repeated": repeated}
    only = tmp_path / "only"
    only.mkdir()
    write_imus(only / "imu.csv.gz", worn)
    places = ("spine4", "lThigh", "rThigh", "lShin")
    devices = [{"device": d, "segment": s, "mount": [1, 0, 0, 0]} for d, s in zip(worn, places)]
    document = json.loads((folder / "subject.json").read_text()) | {"devices": devices}
    (only / "subject.json").write_text(json.dumps(document))
    plan = plan_capture(only)
    notices = []
    context = StageContext(plan.rig, plan.skeleton, plan.extras)
    stage = make_stage("kinematics", plan.configs["kinematics"], context)
    states = []
    for sample in imu_samples(only / "imu.csv.gz", list(worn)):
        result = stage.step(sample)
        notices += result.notices
        states += result.outputs
    codes = [(notice.code, notice.values["device"]) for notice in notices if notice.severity == "warning"]
    assert codes.count(("kinematics.imu_silent", "dead")) == 1
    assert codes.count(("kinematics.imu_convention", "turned")) == 1
    assert {device for _, device in codes} <= {"dead", "turned", "repeated"}
    assert states[-1].devices.tolist() == [2]  # back and repeated
