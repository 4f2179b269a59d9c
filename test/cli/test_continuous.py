"""`panoptic continuous` on files, folders and bags, good and bad."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import captures
import cv2
import numpy as np
import pytest
from free_cameras import START_NS, FreeCapture
from hinged_people import BODIES, HingedCapture, painted

from panoptic_ros.cli.main import main
from panoptic_ros.domain import DetectionSet, Rig
from panoptic_ros.domain.subjects import Subject
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.kinematic_files import subject_document
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.plain_formats import read_skeletons, write_detections
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.simulation.drawn_maps import MapDrawing, with_drawn_maps

SECONDS = 2.5


@pytest.fixture(scope="module")
def capture() -> FreeCapture:
    return FreeCapture(cameras=4, seconds=SECONDS)


def write(folder: Path, rig: Rig, sets: list[DetectionSet], names=captures.SKELETON.joint_names) -> Path:
    folder.mkdir(exist_ok=True)
    write_rig(folder / "rig.json", rig)
    write_detections(folder / "detections.json.gz", names, sets)
    return folder


def write_bag(path: Path, rig: Rig, sets: list[DetectionSet]) -> Path:
    with BagWriter(path) as bag:
        for topic, record in (("/rig", rig), ("/skeleton_model", captures.SKELETON)):
            bag.write(topic, START_NS, to_message(record, bag_messages(), rig.frame_id))
        for item in sets:
            (view,) = item.views
            message = to_message(view, bag_messages(), rig.frame_id)
            bag.write(f"/{view.camera}/detections", view.stamp_ns, message)
    return path


@pytest.fixture(scope="module")
def folder(capture: FreeCapture, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("capture"), capture.rig, capture.sets)


def run(tmp_path: Path, *words: object) -> int:
    return main(["continuous", *map(str, words), "--out", str(tmp_path / "s.json.gz")])


def only(sets: list[DetectionSet], *cameras: str) -> list[DetectionSet]:
    return [item for item in sets if item.views[0].camera in cameras]


def test_folder_file_and_bag_give_the_same_bytes(
    capture: FreeCapture, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_bag(tmp_path / "bag", capture.rig, capture.sets)
    files = ("--rig", folder, "--detections", folder / "detections.json.gz")
    found = []
    for source in (files, (folder,), ("--bag", tmp_path / "bag"), (tmp_path / "bag",), (tmp_path,)):
        assert run(tmp_path, *source, "--rate", 50) == 0
        assert capsys.readouterr().err == ""
        found.append((tmp_path / "s.json.gz").read_bytes())
    assert len(set(found)) == 1
    frames = read_skeletons(tmp_path / "s.json.gz").frames
    assert np.diff([frame.stamp_ns for frame in frames]).tolist() == [20_000_000] * (len(frames) - 1)
    assert np.mean([len(frame.ids) for frame in frames]) > 1.9


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ([], "give one of: a capture folder, --bag BAG, --rig R --detections D; found none"),
        (["FOLDER", "--bag", "FOLDER"], "found a capture folder and --bag"),
        (["--detections", "FOLDER/detections.json.gz"], "--detections needs --rig"),
        (["--rig", "FOLDER"], "found none"),
        (["FOLDER/none"], "none"),
        (["--bag", "FOLDER"], "FOLDER"),
        (["FOLDER", "--rate", "0"], "0"),
        (["FOLDER", "--rate", "1e9"], "1e9"),
        (["FOLDER", "--rate", "fast"], "fast"),
        (["FOLDER", "--rate", "100", "--at", "FOLDER/rig.json"], "not allowed with"),
        (["FOLDER", "--at", "FOLDER/none.csv"], "none.csv"),
        (["FOLDER", "--trusted-camera", "front"], "'front' is not in the rig; it has cam0"),
        (["FOLDER", "--skeleton", "octopus"], "octopus"),
        (["FOLDER", "--capture-views", "1"], "'1' is not a whole number from 2"),
        (["FOLDER", "--lag", "0.1", "--rate", "5000"], "--rate 5000 with --lag is above 1000 Hz"),
        (["FOLDER", "--curves", "OUT"], "--out and --curves name the same file"),
        (["FOLDER", "--curves", "x", "--clocks-out", "./x"], "--clocks-out and --curves name the same"),
        (["FOLDER", "--preset", "fast"], "'fast' (choose from 'elhayek-2012')"),
        (["FOLDER", "--subject", "FOLDER/rig.json"], "is not a panoptic-subject-1"),
        (["FOLDER", "--subject", "FOLDER/none.json"], "FOLDER/none.json"),
        (["FOLDER", "--subject", "FOLDER/rig.json", "--lag", "0.1"], "--lag does not go with --subject"),
        (
            ["FOLDER", "--preset", "elhayek-2012", "--subject", "FOLDER/rig.json"],
            "is not a panoptic-subject-1",
        ),
        (["FOLDER", "--images", "FOLDER"], "--images needs --preset elhayek-2012"),
        (["FOLDER", "--preset", "elhayek-2012", "--images", "FOLDER/none"], "FOLDER/none"),
        (
            ["FOLDER", "--preset", "elhayek-2012", "--images", "FOLDER", "--offsets", "FOLDER/rig.json"],
            "--images does not go with --offsets",
        ),
        (["FOLDER", "--score-maps"], "--score-maps needs --preset elhayek-2012"),
        (
            ["FOLDER", "--preset", "elhayek-2012", "--images", "FOLDER", "--score-maps"],
            "argument --score-maps: not allowed with argument --images",
        ),
        (
            ["FOLDER", "--preset", "elhayek-2012", "--score-maps"],
            "none of the 100 views has score maps, which --score-maps needs; give a bag or images",
        ),
        (["FOLDER", "--preset", "elhayek-2012", "--lag", "0.1"], "--lag does not go with --preset"),
    ],
)
def test_bad_options_are_one_line_and_exit_2(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], says: str
) -> None:
    places = {"FOLDER": str(folder), "OUT": str(tmp_path / "s.json.gz")}
    for name, place in places.items():
        words = [word.replace(name, place) for word in words]
    assert run(tmp_path, *words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("panoptic continuous: ") and says.replace("FOLDER", str(folder)) in line
    assert list(tmp_path.iterdir()) == []


def test_the_preset_follows_people_by_2d_joints_and_by_images_alone(tmp_path: Path) -> None:
    capture = HingedCapture(cameras=5, seconds=1.3, there=lambda person, time: person == 0)
    write(tmp_path / "c", capture.rig, capture.sets)
    rows = ["camera,frame,stamp_ns"]
    for frame in painted(capture):
        (tmp_path / "c" / frame.camera).mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / "c" / frame.camera / f"{frame.frame_number:06d}.png"), frame.image)
        rows.append(f"{frame.camera},{frame.frame_number},{frame.stamp_ns}")
    (tmp_path / "c" / "timestamps.csv").write_text("\n".join(rows) + "\n")
    words, errors = (tmp_path / "c", "--preset", "elhayek-2012"), []
    for more in ((), ("--images", tmp_path / "c")):
        assert run(tmp_path, *words, *more, "--rate", 50) == 0
        errors.append(mean_error(tmp_path / "s.json.gz", capture))
    assert errors[0] < 0.006 and errors[1] < 0.03


def test_the_preset_follows_people_by_the_score_maps_of_a_bag(tmp_path: Path) -> None:
    capture = HingedCapture(cameras=5, seconds=1.3, there=lambda person, time: person == 0)
    drawn = [with_drawn_maps(item, MapDrawing()) for item in capture.sets]
    words, errors = (write_bag(tmp_path / "b", capture.rig, drawn), "--preset", "elhayek-2012"), []
    for more in ((), ("--score-maps",)):
        assert run(tmp_path, *words, *more, "--rate", 50) == 0
        errors.append(mean_error(tmp_path / "s.json.gz", capture))
    assert max(errors) < 0.008 and errors[0] != errors[1]


def mean_error(path: Path, capture: HingedCapture) -> float:
    """Mean error (m) of the first person at the instants of a file, but the first and last 15."""
    found = read_skeletons(path).frames
    gaps = [
        one.positions[0] - capture.joints(1e-9 * (one.stamp_ns - START_NS))[0]
        for one in found[15:-15]
        if len(one.ids)
    ]
    assert len(gaps) == len(found) - 30
    return float(np.linalg.norm(gaps, axis=-1).mean())


def test_a_subject_keeps_its_bones_and_everybody_else_stays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    capture = HingedCapture(cameras=5, seconds=1.0)
    folder, found = write(tmp_path / "c", capture.rig, capture.sets), []
    start = capture.joints(0.0)[1].mean(axis=0)
    for number, body in enumerate(BODIES):
        document = subject_document(Subject(number, body, start=start, stature=1.8))
        (tmp_path / f"{number}.json").write_text(json.dumps(document))
    capsys.readouterr()
    for more in ((), ("--subject", tmp_path / "1.json", "--curves", tmp_path / "c.npz")):
        assert run(tmp_path, folder, *more) == 0
        found.append(read_skeletons(tmp_path / "s.json.gz").frames)
    assert "warning" not in capsys.readouterr().err
    same, spreads = [], []
    with np.load(tmp_path / "c.npz") as curves:
        points = [curves[f"points_{k}"] for k in range(2)]
    assert len(points[0]) != len(points[1])  # the curves of the subject have finer knots
    for k in range(2):
        before, after = (np.array([frame.positions[k] for frame in frames[20:-20]]) for frames in found)
        same.append(np.array_equal(before, after))
        spreads.append(np.linalg.norm(after[:, 3] - after[:, 4], axis=1).std())  # left upper arm
    assert sorted(same) == [False, True]
    assert spreads[same.index(False)] < 1e-4 < spreads[same.index(True)]
    assert run(tmp_path, folder, "--subject", tmp_path / "0.json") == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert "the bones of subject 0 miss its joints by" in line


def test_images_go_through_the_detector_or_name_what_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    assert run(tmp_path, tmp_path / "empty") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert str(tmp_path / "empty") in line


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("time\n1\n", "has no column stamp_ns"),
        ("stamp_ns\n", "has no row"),
        ("stamp_ns\n12\n1.5\n", "line 3: stamp_ns = '1.5' is not an integer number of ns"),
        ("stamp_ns\nnoon\n", "line 2: stamp_ns = 'noon'"),
        ("a,stamp_ns\n1,2\n3\n", "line 3: stamp_ns = None"),
        (f"stamp_ns\n{10**30}\n", "line 2: stamp_ns = '1000"),
        ("stamp_ns\n5\n-5\n", "line 3: stamp_ns = '-5' is not an integer number of ns from 0 to"),
        ("stamp_ns\n99999999999999999999\n", "9' is not an integer number of ns from 0 to 2^63 - 1"),
        ("stamp_ns\n1\n2\n", "all 2 instants of --at are outside of the recording, 10000125"),
    ],
)
def test_bad_instants_are_one_line(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, says: str
) -> None:
    (tmp_path / "at.csv").write_text(text)
    assert run(tmp_path, folder, "--at", tmp_path / "at.csv") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line and not (tmp_path / "s.json.gz").exists()


def test_instants_of_another_device(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stamps = [START_NS + round(1e9 * t) for t in (1.5, 1.0, 1.0, -7.0)]
    (tmp_path / "at.csv").write_text("\ufeffdevice,stamp_ns\n" + "".join(f"plate,{s}\n" for s in stamps))
    assert run(tmp_path, folder, "--at", tmp_path / "at.csv") == 0
    assert "1 of 3 instants of --at are outside of the recording" in capsys.readouterr().err
    frames = read_skeletons(tmp_path / "s.json.gz").frames
    assert [frame.stamp_ns for frame in frames] == sorted(set(stamps))
    assert [len(frame.ids) for frame in frames] == [0, 2, 2]


@pytest.mark.parametrize(
    ("cameras", "empty", "code", "says"),
    [
        (("cam0",), False, 2, "all 25 views are of camera cam0, which is not enough for 3D"),
        ((), False, 2, "the recording has no view"),
        (("cam0", "cam1"), True, 0, "none of the 50 views has a 2D person"),
    ],
)
def test_too_few_views_are_one_line(
    capture: FreeCapture,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    cameras: tuple[str, ...],
    empty: bool,
    code: int,
    says: str,
) -> None:
    sets = only(capture.sets, *cameras)
    if empty:
        sets = [replace(s, views=tuple(_without_people(v) for v in s.views)) for s in sets]
    assert run(tmp_path, write(tmp_path / "c", capture.rig, sets)) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert says in line
    if code == 0:
        assert all(len(frame.ids) == 0 for frame in read_skeletons(tmp_path / "s.json.gz").frames)


def _without_people(view):
    return replace(view, points=view.points[:0], scores=view.scores[:0], person_scores=view.person_scores[:0])


def test_cameras_without_a_common_time_find_nobody_and_say_why(
    capture: FreeCapture, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    later = []
    for item in only(capture.sets, "cam1"):
        (view,) = item.views
        stamp = view.stamp_ns + 20_000_000_000
        later.append(replace(item, stamp_ns=stamp, views=(replace(view, stamp_ns=stamp),)))
    sets = [*only(capture.sets, "cam0"), *later]
    assert run(tmp_path, write(tmp_path / "c", capture.rig, sets)) == 0
    lines = capsys.readouterr().err.splitlines()
    assert sum("no people were found" in line for line in lines) == 1 and "one view only" in lines[-1]


def test_a_rig_that_does_not_fit_is_named(
    capture: FreeCapture, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fewer = replace(capture.rig, cameras=capture.rig.cameras[:3])
    assert run(tmp_path, write(tmp_path / "c", fewer, capture.sets)) == 2
    assert "the detections have a camera 'cam3' that the rig lacks" in capsys.readouterr().err
    names = [f"joint{k}" for k in range(19)]
    assert run(tmp_path, write(tmp_path / "c", capture.rig, capture.sets, names)) == 2
    assert "none of the joints joint0" in capsys.readouterr().err


def test_stamps_in_milliseconds_are_named(
    capture: FreeCapture, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sets = [
        replace(s, views=(replace(s.views[0], stamp_ns=s.views[0].stamp_ns // 10**6),)) for s in capture.sets
    ]
    folder = write(tmp_path / "c", capture.rig, sets)
    for words in ((), ("--lag", "0.1")):
        assert run(tmp_path, folder, *words) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "views of camera cam0 are 100 ns apart" in line and "in nanoseconds" in line
    assert not (tmp_path / "s.json.gz").exists()


def test_frames_that_run_backwards_are_used(
    capture: FreeCapture, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sets = list(capture.sets)
    sets[40], sets[44] = sets[44], sets[40]  # of one camera
    assert sets[40].views[0].camera == sets[44].views[0].camera
    assert run(tmp_path, write(tmp_path / "c", capture.rig, sets)) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert "1 of 100 views come after later ones" in line


def test_clocks_of_people_who_stand_are_not_observable(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    still = FreeCapture(cameras=3, rate=15.0, seconds=2.0, speed=0.0)
    folder = write(tmp_path / "c", still.rig, still.sets)
    assert run(tmp_path, folder, "--clocks", "--clocks-out", tmp_path / "clocks.json") == 0
    told = capsys.readouterr()
    assert told.out.count("clock not observable, stamps kept") == 3
    document = json.loads((tmp_path / "clocks.json").read_text())
    assert all(row["offset_s"] == 0.0 and row["offset_sd_s"] > 0.012 for row in document["cameras"].values())


@pytest.mark.parametrize(("largest", "whole"), [(2_000, []), (40_000, ["c.json", "s.json.gz"])])
def test_a_full_disk_leaves_whole_files_only(
    folder: Path, tmp_path: Path, largest: int, whole: list[str]
) -> None:
    """Limit the size of files, as a full disk does."""

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))

    words = ["continuous", str(folder), "--rate", "4", "--out", str(tmp_path / "s.json.gz")]
    words += ["--clocks-out", str(tmp_path / "c.json"), "--curves", str(tmp_path / "c.npz")]
    done = subprocess.run(
        [sys.executable, "-m", "panoptic_ros.cli.main", *words],
        preexec_fn=limit,
        capture_output=True,
        text=True,
        timeout=120.0,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2 and line.startswith("panoptic continuous: cannot write")
    assert sorted(path.name for path in tmp_path.iterdir()) == whole
    if whole:
        assert len(read_skeletons(tmp_path / "s.json.gz").frames) == 10


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_pass_leaves_nothing(folder: Path, tmp_path: Path, number: int) -> None:
    words = ["continuous", str(folder), "--rate", "10000", "--out", str(tmp_path / "s.json.gz")]
    words += ["--clocks-out", str(tmp_path / "c.json"), "--curves", str(tmp_path / "c.npz")]
    process = subprocess.Popen(
        [sys.executable, "-m", "panoptic_ros.cli.main", *words],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    limit = time.monotonic() + 120.0
    while not list(tmp_path.glob(".s*")) and time.monotonic() < limit and process.poll() is None:
        time.sleep(0.01)  # until the file is being written
    process.send_signal(number)
    _, told = process.communicate(timeout=60.0)
    assert process.returncode == 2 and told.splitlines()[-1] == "panoptic continuous: interrupted"
    assert list(tmp_path.iterdir()) == []
