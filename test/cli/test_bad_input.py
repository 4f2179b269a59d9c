"""Whatever the user gets wrong: one clear line, exit code 2, and nothing half-written."""

import gzip
import json
import os
import resource
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import captures
import cv2
import numpy as np
import pytest
from recordings import write_bag
from repeated_bag import repeat

from panoptic_ros.cli.main import main
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.models import DEFAULT_MODEL, is_cached, read_card
from panoptic_ros.io.rigs import write_rig

needs_model = pytest.mark.skipif(
    not is_cached(read_card(DEFAULT_MODEL)), reason="the default model is not fetched (panoptic models fetch)"
)


def fails(capsys, out, *arguments):
    """Run, expect exit code 2, one line and no results; return the line."""
    before = sorted(out.parent.iterdir())
    assert main([*map(str, arguments), "--out", str(out)]) == 2
    captured = capsys.readouterr()
    lines = [line for line in captured.err.splitlines() if line.strip()]
    assert len(lines) == 1, captured.err
    assert sorted(out.parent.iterdir()) == before
    return lines[0]


def write_video(path, size=(64, 48), frames=5):
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"mp4v"), 25.0, size)
    for i in range(frames):
        writer.write(np.full((size[1], size[0], 3), 40 * i, np.uint8))
    writer.release()


@pytest.fixture
def capture(tmp_path):
    """A capture folder whose videos have the size of the rig's images."""
    folder = tmp_path / "capture"
    folder.mkdir()
    write_rig(folder / "rig.json", captures.RIG)
    for name in captures.RIG.names:
        write_video(folder / f"{name}.mp4", (1280, 720))
    return folder


@pytest.fixture
def out(tmp_path):
    (tmp_path / "results").mkdir()
    return tmp_path / "results" / "out"


def bag_of(path, *topics):
    with BagWriter(path) as bag:
        for topic, record in topics:
            bag.write(topic, 0, to_message(record, bag_messages()))
    return path


@needs_model
class TestCaptureFolder:
    def test_a_node_per_stage_is_refused_for_recordings(self, capsys, out, capture):
        line = fails(capsys, out, "run", capture, "--node-per-stage")
        told = "--node-per-stage has no meaning with a capture folder, only with --device, --topics, --imus"
        assert line.endswith(told)

    def test_no_folder(self, capsys, out, tmp_path):
        assert "does not exist" in fails(capsys, out, "run", tmp_path / "nothing")

    def test_missing_video(self, capsys, out, capture):
        (capture / "cam2.mp4").unlink()
        assert "cam2" in fails(capsys, out, "run", capture)

    def test_empty_video(self, capsys, out, capture):
        (capture / "cam1.mp4").write_bytes(b"")
        assert "cam1" in fails(capsys, out, "run", capture)

    @pytest.mark.parametrize("where", [[], ["--in-process"]])
    def test_truncated_video(self, capsys, out, capture, where):
        data = (capture / "cam1.mp4").read_bytes()
        (capture / "cam1.mp4").write_bytes(data[: len(data) * 2 // 3])
        assert "cam1" in fails(capsys, out, "run", capture, *where)

    def test_unknown_rig_format(self, capsys, out, capture):
        (capture / "rig.json").write_text('{"hello": 1}')
        assert "rig.json" in fails(capsys, out, "run", capture)

    def test_image_size_that_differs_from_the_rig(self, capsys, out, capture):
        write_video(capture / "cam3.mp4", (640, 480))
        line = fails(capsys, out, "run", capture)
        assert "cam3" in line and "640" in line and "1280" in line

    def test_two_cameras_with_one_name(self, capsys, out, capture):
        document = json.loads((capture / "rig.json").read_text())
        document["cameras"][1]["name"] = "cam0"
        (capture / "rig.json").write_text(json.dumps(document))
        assert "cam0" in fails(capsys, out, "run", capture)

    def test_out_that_holds_other_things(self, capsys, out, capture):
        out.mkdir()
        (out / "thesis.tex").write_text("mine")
        assert "files that are not results of a run" in fails(capsys, out, "run", capture)
        assert (out / "thesis.tex").read_text() == "mine"

    def test_no_write_permission(self, capsys, out, capture):
        if os.geteuid() == 0:
            pytest.skip("root may write anywhere")
        out.parent.chmod(0o500)
        try:
            assert "ermission" in fails(capsys, out, "run", capture)
        finally:
            out.parent.chmod(0o700)

    def test_cameras_that_ros_cannot_tell_apart(self, capsys, out, capture):
        document = json.loads((capture / "rig.json").read_text())
        for camera, name in zip(document["cameras"], ("a-b", "a_b")):
            (capture / f"{camera['name']}.mp4").rename(capture / f"{name}.mp4")
            camera["name"] = name
        (capture / "rig.json").write_text(json.dumps(document))
        assert "'a-b' and 'a_b'" in fails(capsys, out, "run", capture)


class TestUsage:
    @pytest.mark.parametrize(
        ("words", "told"),
        [
            (["folder", "--redetect"], "only with --bag"),
            (["folder", "--latency-ms", "40"], "only with --device"),
            (["--topics", "d.yaml", "--size-policy", "crop"], "--size-policy"),
            (["--bag", "b", "--frame-rate", "25"], "--frame-rate"),
            (["--rig", "r", "--video", "a=b", "--cameras", "a"], "--cameras"),
            (["folder", "--jpeg", "90", "--in-process"], "--jpeg"),
            (["folder", "--bag", "b"], "found capture, bag"),
            ([], "found none"),
            (["folder", "--jpeg", "101"], "from 0 to 100"),
            (["folder", "--duration", "nan"], "--duration"),
            (["folder", "--frame-rate", "zero"], "--frame-rate"),
            (["folder", "--slow"], "--slow"),
        ],
    )
    def test_options_that_make_no_sense(self, capsys, out, words, told):
        assert told in fails(capsys, out, "run", *words)

    def test_missing_option(self, capsys):
        assert main(["run", "folder"]) == 2
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 1 and "--out" in lines[0]


class TestModel:
    def test_wrong_hash(self, capsys, out, capture, tmp_path, monkeypatch):
        monkeypatch.setenv("PANOPTIC_CACHE", str(tmp_path / "cache"))
        path = read_card(DEFAULT_MODEL).model_path
        path.parent.mkdir(parents=True)
        path.write_bytes(b"not the model")
        path.with_name(path.name + ".sha256").write_text("0" * 64)
        line = fails(capsys, out, "run", capture)
        assert "SHA-256" in line and "models fetch" in line

    def test_not_fetched(self, capsys, out, capture, tmp_path, monkeypatch):
        monkeypatch.setenv("PANOPTIC_CACHE", str(tmp_path / "cache"))
        assert "panoptic models fetch" in fails(capsys, out, "run", capture)

    def test_unknown(self, capsys, out, capture):
        assert "sleepwalker" in fails(capsys, out, "run", capture, "--model", "sleepwalker")


class TestBag:
    def test_missing(self, capsys, out, tmp_path):
        assert "there is no bag" in fails(capsys, out, "run", "--bag", tmp_path / "no")

    def test_without_the_topics(self, capsys, out, tmp_path):
        bag = bag_of(tmp_path / "b", ("/rig", captures.RIG))
        line = fails(capsys, out, "run", "--bag", bag)
        assert "detections" in line and "/rig" in line

    def test_without_a_rig(self, capsys, out, tmp_path):
        bag = bag_of(tmp_path / "b", ("/cam0/detections", captures.view(captures.RIG.cameras[0], 0, 0)))
        assert "--rig" in fails(capsys, out, "run", "--bag", bag)

    def test_options_of_a_detector_for_a_bag_with_detections(self, capsys, out, recorded_bag):
        line = fails(capsys, out, "run", "--bag", recorded_bag, "--skeleton", "coco17")
        assert "--redetect" in line

    def test_cut_off(self, capsys, out, recorded_bag):
        (recorded_bag / "metadata.yaml").unlink()
        assert "panoptic bag repair" in fails(capsys, out, "run", "--bag", recorded_bag)

    def test_disk_that_fills_up(self, out, recorded_bag):
        """A limit on the size of files stands for the full disk."""

        def limit():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))

        command = [
            sys.executable,
            "-m",
            "panoptic_ros.cli.main",
            "run",
            "--bag",
            str(recorded_bag),
            "--out",
            str(out),
            "--in-process",
            "--no-pictures",
        ]
        done = subprocess.run(command, preexec_fn=limit, capture_output=True, text=True, timeout=120)
        assert done.returncode == 2, done.stderr
        assert len(done.stderr.strip().splitlines()) == 1 and "too large" in done.stderr
        assert list(out.parent.iterdir()) == []


def test_no_home_for_the_logs_of_ros(out, recorded_bag):
    pytest.importorskip("rclpy")
    program = [sys.executable, "-m", "panoptic_ros.cli.main"]
    command = [*program, "run", "--bag", str(recorded_bag), "--out", str(out)]
    homeless = {k: v for k, v in os.environ.items() if k not in ("HOME", "ROS_LOG_DIR", "ROS_HOME")}
    done = subprocess.run(command, env=homeless, capture_output=True, text=True, timeout=120)
    assert done.returncode == 2, done.stderr
    assert "ROS_LOG_DIR" in done.stderr and "Traceback" not in done.stderr
    assert list(out.parent.iterdir()) == []


class TestInterruption:
    @pytest.mark.parametrize("mode", [["--in-process"], []])
    @pytest.mark.parametrize(
        ("sent", "delays"),
        [(signal.SIGINT, [1.0]), (signal.SIGINT, [3.0, 0.2, 0.1]), (signal.SIGTERM, [4.0])],
    )
    def test_nothing_is_left(self, out, long_bag, mode, sent, delays):
        if not mode:
            pytest.importorskip("rclpy")
        child = start(long_bag, out, *mode)
        for delay in delays:
            time.sleep(delay)
            child.send_signal(sent)
        _, errors = child.communicate(timeout=60)
        assert child.returncode == 2, errors
        assert errors == "panoptic run: interrupted\n"
        assert list(out.parent.iterdir()) == []
        wait_for(lambda: not hosts(out))

    def test_killed_launcher_leaves_no_process(self, out, long_bag):
        pytest.importorskip("rclpy")
        child = start(long_bag, out)
        wait_for(lambda: hosts(out))
        child.kill()
        child.communicate(timeout=60)
        wait_for(lambda: not hosts(out))

    def test_killed_node_ends_the_run(self, out, long_bag):
        pytest.importorskip("rclpy")
        child = start(long_bag, out)
        wait_for(lambda: hosts(out))
        os.kill(hosts(out)[0], signal.SIGKILL)
        _, errors = child.communicate(timeout=60)
        assert child.returncode == 2, errors
        assert len(errors.splitlines()) == 1 and "was killed" in errors
        assert list(out.parent.iterdir()) == []
        wait_for(lambda: not hosts(out))

    def test_two_runs_in_one_domain(self, capsys, out, long_bag, recorded_bag):
        pytest.importorskip("rclpy")
        first = start(long_bag, out.with_name("first"))
        try:
            wait_for(lambda: hosts(out.with_name("first")))
            assert main(["run", "--bag", str(recorded_bag), "--out", str(out)]) == 2
            assert "ROS_DOMAIN_ID" in capsys.readouterr().err
        finally:
            first.send_signal(signal.SIGINT)
            first.communicate(timeout=60)


def start(bag, out, *more):
    command = [sys.executable, "-m", "panoptic_ros.cli.main", "run", "--bag", str(bag), "--out", str(out)]
    return subprocess.Popen(
        [*command, "--no-pictures", *more], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def hosts(out):
    """Process ids of the nodes of a run: they print to its folder."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            words = path.read_bytes().decode().split("\0")
            log = os.readlink(path.with_name("fd") / "1")
            if "panoptic_ros.nodes.main" in words and log.startswith(f"{out}/"):
                found.append(int(path.parent.name))
    return found


def wait_for(happened, seconds=30.0):
    end = time.monotonic() + seconds
    while not happened() and time.monotonic() < end:
        time.sleep(0.1)
    assert happened(), "it did not happen in time"


class TestSolve:
    def test_foreign_camera(self, capsys, out, tmp_path):
        write_rig(tmp_path / "rig.json", captures.RIG)
        views = {"cam9": {"stamp_ns": 0, "persons": []}}
        document = {
            "format": "panoptic-detections-1",
            "joint_names": list(captures.SKELETON.joint_names),
            "frames": [{"index": 0, "stamp_ns": 0, "views": views}],
        }
        path = tmp_path / "d.json.gz"
        path.write_bytes(gzip.compress(json.dumps(document).encode()))
        line = fails(capsys, out, "solve", "--rig", tmp_path / "rig.json", "--detections", path)
        assert "cam9" in line and "cam0" in line

    @pytest.mark.parametrize(
        ("content", "told"),
        [(b"", "JSON"), (b"{", "JSON"), (b'{"format": "x"}', "expected"), (b"[]", "expected")],
    )
    def test_bad_file(self, capsys, out, tmp_path, content, told):
        write_rig(tmp_path / "rig.json", captures.RIG)
        (tmp_path / "d.json").write_bytes(content)
        line = fails(
            capsys, out, "solve", "--rig", tmp_path / "rig.json", "--detections", tmp_path / "d.json"
        )
        assert told in line and "d.json" in line


@pytest.fixture
def recorded_bag(tmp_path):
    topics = [(f"/{v.camera}/detections", v) for v in captures.views(40)]
    return bag_of(tmp_path / "b", ("/rig", captures.RIG), ("/skeleton_model", captures.SKELETON), *topics)


@pytest.fixture(scope="module")
def long_bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("long")
    return repeat(write_bag(folder / "short", captures.views(50)), folder / "b", 50.0)
