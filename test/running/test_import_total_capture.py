"""Total Capture: a simulated body is the same when written in the formats of the data set and imported.

The data themselves are not at hand: this is not a test on them.
"""

from dataclasses import replace

import numpy as np
import pytest
from total_capture_files import write_take

from panoptic_ros.cli.main import main
from panoptic_ros.evaluation.kinematic_scores import score_bodies
from panoptic_ros.geometry.rotations import from_quaternions
from panoptic_ros.io.body_files import read_bodies
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.datasets.total_capture import SEGMENTS, WORN
from panoptic_ros.io.files import write_json
from panoptic_ros.io.kinematic_files import read_imus, read_subject
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.io.rigs import read_rig
from panoptic_ros.running.kinematics import body_config
from panoptic_ros.simulation.bodies.capture import FIRST_NS, BodyScene, simulate_body
from panoptic_ros.study.bodies.cases import case_of, read_case

MODEL = read_body_model()
OWN = [MODEL.index(name) for name in SEGMENTS.values()]
DEVICES = {segment: name for name, segment in WORN.items()}


@pytest.fixture(scope="module")
def take():
    return simulate_body(BodyScene(("02_05",), seconds=2.5, cameras=4), 3, MODEL, read_clips())


@pytest.fixture(scope="module")
def imported(take, tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    write_take(folder, take, MODEL)
    out = folder.parent / f"{folder.name} capture"
    assert main(["import", "total-capture", str(folder), "--take", "s1/acting1", "--out", str(out)]) == 0
    return out


def test_the_rig_is_the_same(take, imported):
    found = read_rig(imported / "rig.json")
    assert found.names == ("cam1", "cam2", "cam3", "cam4")
    for ours, theirs in zip(take.rig.cameras, found.cameras):
        assert ours.image_size == theirs.image_size
        np.testing.assert_allclose(theirs.intrinsics.matrix, ours.intrinsics.matrix, atol=1e-6)
        np.testing.assert_allclose(theirs.cam_from_world.rotation, ours.cam_from_world.rotation, atol=1e-6)
        np.testing.assert_allclose(
            theirs.cam_from_world.translation, ours.cam_from_world.translation, atol=1e-6
        )


def test_the_truth_is_the_same_but_for_what_the_data_set_lacks(take, imported):
    names, states = read_bodies(imported / "truth.json.gz")
    assert names == MODEL.names and len(states) == len(take.stamps)
    for ours, theirs in list(zip(take.truth(), states))[::30]:
        assert theirs.stamp_ns == ours.stamp_ns - FIRST_NS
        np.testing.assert_allclose(theirs.places[OWN], ours.places[OWN], atol=2e-5)
        np.testing.assert_allclose(theirs.frames[OWN], ours.frames[OWN], atol=1e-5)
    toes = [MODEL.index(name) for name in ("lToe", "rToe")]
    assert np.isnan([state.places[toes] for state in states]).all()


def test_samples_and_mountings_are_the_same_in_the_world(take, imported):
    found, subject = read_imus(imported / "imu.csv.gz"), read_subject(imported / "subject.json", MODEL)
    assert len(found) == len(subject.devices) == 13
    mounts = {device.name: device for device in subject.devices}
    for device in take.subject.devices:
        name = DEVICES[MODEL.names[device.segment]]
        ours, theirs = take.devices[device.name], found[name]
        np.testing.assert_allclose(
            from_quaternions(theirs.quaternions), from_quaternions(ours.quaternions), atol=1e-5
        )
        np.testing.assert_allclose(theirs.forces, ours.forces, atol=1e-4)
        np.testing.assert_allclose(theirs.rates, ours.rates, atol=1e-4)
        assert mounts[name].segment == device.segment
        np.testing.assert_allclose(mounts[name].mount, device.mount, atol=1e-5)


def test_lengths_and_stature_are_those_of_the_subject(take, imported):
    subject = read_subject(imported / "subject.json", MODEL)
    np.testing.assert_allclose(subject.body.offsets[OWN], take.subject.body.offsets[OWN], atol=1e-3)
    assert abs(subject.stature - take.stature) < 0.1


def test_videos_are_linked_by_the_names_of_their_cameras(imported):
    assert (imported / "cam2.mp4").read_bytes() == b"a video" and (imported / "cam2.mp4").is_symlink()
    assert not (imported / "cam1.mp4").exists()
    rows = (imported / "timestamps.csv").read_text().splitlines()
    assert rows[:3] == ["camera,frame,stamp_ns", "cam2,0,0", "cam2,1,16666667"]  # as the truth counts


def people(take):
    """The 2D people of the simulated capture, by the cameras and from the first instant of the data set."""
    frames = []
    for t, stamp in enumerate((take.stamps - FIRST_NS).tolist()):
        views = {}
        for c in range(len(take.rig)):
            rows = zip(take.pixels[c, t].tolist(), take.scores[c, t].tolist())
            persons = [[[x, y, score] if score > 0.0 else None for (x, y), score in rows]]
            views[f"cam{c + 1}"] = {"stamp_ns": stamp, "persons": persons}
        frames.append({"index": t, "stamp_ns": stamp, "views": views})
    return {"format": "panoptic-detections-1", "joint_names": list(take.joint_names), "frames": frames}


def test_it_is_solved_as_well_as_a_capture_in_our_formats(take, imported, tmp_path):
    write_json(imported / "detections.json.gz", people(take))
    words = [f"--rig={imported / 'rig.json'}", f"--detections={imported / 'detections.json.gz'}"]
    words += [f"--imu={imported / 'imu.csv.gz'}", f"--subject={imported / 'subject.json'}"]
    assert main(["kinematics", *words, "--out", str(tmp_path / "bodies.json.gz")]) == 0
    truth, found = (
        read_bodies(path)[1] for path in (imported / "truth.json.gz", tmp_path / "bodies.json.gz")
    )
    ground = [MODEL.index(name) for name in MODEL.ground]
    scores = score_bodies(truth, found, MODEL.parents, 1.0, ground)
    assert scores["coverage"] == 1.0 and scores["aligned_deg"] < scores["deg"]
    case = read_case(imported)
    assert len(case.truth) == len(truth) and len(case.recording.devices) == 13
    known = replace(take.subject, body=case.subjects[0].body)  # the data set tells no offsets of detectors
    ours = case_of(take, case.statistics)
    wanted = replace(ours, subjects=(known,)).solve(body_config()).states
    toes = {MODEL.index(name) for name in ("lToe", "rToe")}
    rest = [replace(s, places=without(s.places, toes)) for s in take.truth()]
    best = score_bodies(rest, wanted, MODEL.parents, 1.0, ground)
    assert abs(scores["mm"] - best["mm"]) < 0.3 and abs(scores["deg"] - best["deg"]) < 0.1


def without(rows, segments):
    """Rows of segments, some of which are not known."""
    found = rows.copy()
    found[list(segments)] = np.nan
    return found


def test_accelerations_without_gravity_are_left_out_and_told(take, tmp_path, capsys):
    write_take(tmp_path / "data", take, MODEL)
    path = next((tmp_path / "data").rglob("*.sensors"))
    rows = [line.split("\t") for line in path.read_text().splitlines()]
    text = ["\t".join([*r[:5], "0.1", "0", "0", *r[8:]] if len(r) > 9 else r) for r in rows]
    path.write_text("\n".join(text))
    words = ["--take", "S1/Acting1", "--out", str(tmp_path / "out")]
    assert main(["import", "total-capture", str(tmp_path / "data"), *words]) == 0
    assert "not specific forces" in capsys.readouterr().out
    assert all(np.isnan(s.forces).all() for s in read_imus(tmp_path / "out" / "imu.csv.gz").values())


def test_whether_files_belong_together_is_told(take, tmp_path, capsys):
    write_take(tmp_path / "data", take, MODEL)
    words = ["import", "total-capture", str(tmp_path / "data"), "--take", "s1/acting1", "--out"]
    assert main([*words, str(tmp_path / "a")]) == 0
    good = capsys.readouterr().out
    assert "in the images of 4 of 4 cameras" in good and degrees(good) < 6.0
    bone = next((tmp_path / "data").rglob("*_imu_bone.txt"))
    lines = [line.split() for line in bone.read_text().splitlines()]
    bone.write_text("\n".join(" ".join([*r[:1], *r[4:], *r[1:4]]) for r in lines))  # w x y z, not x y z w
    assert main([*words, str(tmp_path / "b")]) == 0
    assert degrees(capsys.readouterr().out) > 40.0


@pytest.mark.parametrize("kept, word", [(slice(0, 120), "begin"), (slice(31, 151), "end")])
def test_fewer_samples_than_frames_begin_or_end_with_the_truth(take, tmp_path, capsys, kept, word):
    write_take(tmp_path / "data", take, MODEL)
    path = next((tmp_path / "data").rglob("*.sensors"))
    lines = path.read_text().splitlines()
    frames = [lines[2 + 14 * t : 15 + 14 * t] for t in range(151)][kept]
    numbered = [line for k, frame in enumerate(frames) for line in (str(k + 1), *frame)]
    path.write_text("\n".join(["13\t120", *numbered]))
    words = ["import", "total-capture", str(tmp_path / "data"), "--take", "s1/acting1", "--out"]
    assert main([*words, str(tmp_path / "out")]) == 0
    assert f"120 frames of IMUs and 151 of the truth {word} together" in capsys.readouterr().out
    _, states = read_bodies(tmp_path / "out" / "truth.json.gz")
    series = read_imus(tmp_path / "out" / "imu.csv.gz")["Head"]
    assert [state.stamp_ns for state in states] == series.stamps.tolist() and len(states) == 120


def degrees(text):
    return float(text.split(" deg off the true segments")[0].split()[-1])


def harm(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


@pytest.mark.parametrize(
    "name, old, new, told",
    [
        ("calibration.cal", "4 1\n", "5 1\n", "line 30: 0 numbers, expected 4: rows and columns of camera 5"),
        ("*_AuxFields.sensors", "\n2\n", "\n3\n", "line 16: '3', expected frame 2"),
        ("*_AuxFields.sensors", "13\t151", "13\t9000", "lines, expected 126001: 9000 frames of 13 sensors"),
        ("*_imu_bone.txt", "Head ", "Hat ", None),
        ("*_imu_ref.txt", "Head ", "Hat ", "has no sensor Head"),
        ("acting1/gt_skel_gbl_pos.txt", "Spine1\t", "Spine9\t", "has other joints than"),
        ("acting1/gt_skel_gbl_ori.txt", "0.", "x.", "line 2: "),
    ],
)
def test_a_file_that_is_not_as_it_must_be_is_told_in_one_line(take, tmp_path, capsys, name, old, new, told):
    write_take(tmp_path / "data", take, MODEL)
    harm(next((tmp_path / "data").rglob(name)), old, new)
    words = ["--take", "s1/acting1", "--out", str(tmp_path / "out")]
    code = main(["import", "total-capture", str(tmp_path / "data"), *words])
    error = capsys.readouterr().err
    if told is None:
        assert code == 0  # a sensor that nobody is known to wear is left out
    else:
        assert code == 2 and told in error and error.count("\n") == 1
        assert not (tmp_path / "out").exists()


def test_what_is_not_there_is_told(tmp_path, capsys):
    words = ["import", "total-capture", str(tmp_path), "--out", str(tmp_path / "out"), "--take"]
    for take, told in (("s1", "is not SUBJECT/TAKE"), ("s1/acting1", "has no gt_skel_gbl_pos.txt")):
        assert main([*words, take]) == 2
        assert told in capsys.readouterr().err
