"""Damaged and hostile files end in one line and exit code 2, within 500 MB and 5 s of processor time."""

import csv
import gzip
import json
import os
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import captures
import command_server
import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.domain import DetectionSet
from panoptic_ros.errors import DataError
from panoptic_ros.io.bag_streams import BagStream
from panoptic_ros.io.bags import BagReader, BagWriter
from panoptic_ros.io.messages import bag_messages, to_message
from panoptic_ros.io.models.cards import read_card
from panoptic_ros.io.plain_formats import write_detections
from panoptic_ros.io.resources import share_folder
from panoptic_ros.io.rigs import write_rig

MOST, CPU_S = 500 << 20, 5.0  # bytes beyond what the process has, and s
SERVER: list[subprocess.Popen] = []
BAG = str(share_folder() / "bags" / "sample")
LAUGHS = "a: &a [lol, lol, lol, lol, lol, lol, lol, lol, lol, lol]\n" + "".join(
    f"{name}: &{name} [{', '.join([f'*{before}'] * 10)}]\n" for before, name in zip("abcdefgh", "bcdefghi")
)


@pytest.fixture(scope="module", autouse=True)
def server():
    """A process that runs the commands of this module in children."""
    with subprocess.Popen(
        [sys.executable, command_server.__file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        SERVER.append(process)
        yield
        SERVER.clear()
        process.stdin.close()


def ended(tmp_path: Path, *words: object) -> tuple[int, list[str]]:
    """Return exit code and lines on stderr of a command that takes little memory and time."""
    told = tmp_path / "stderr"
    request = {"words": [str(word) for word in words], "folder": str(tmp_path), "told": str(told)}
    print(json.dumps(request), file=SERVER[0].stdin, flush=True)
    answer = json.loads(SERVER[0].stdout.readline())
    assert answer["memory"] < MOST and answer["cpu_s"] < CPU_S
    return answer["code"], told.read_text().splitlines()


def refused(tmp_path: Path, *words: object) -> str:
    """Return the one line of a command that is refused."""
    code, lines = ended(tmp_path, *words)
    assert code == 2 and len(lines) == 1, lines
    return lines[0]


@pytest.fixture
def files(tmp_path):
    """Write a rig and detections into a folder."""
    write_rig(tmp_path / "rig.json", captures.RIG)
    views = [captures.view(camera, 0, 10**9) for camera in captures.RIG.cameras]
    frame = DetectionSet(0, 10**9, captures.SKELETON.hash, tuple(views))
    write_detections(tmp_path / "detections.json.gz", captures.SKELETON.joint_names, [frame])
    return tmp_path


def solve(files: Path, *words: object, out: object = "out.json.gz") -> str:
    given = ["--detections", files / "detections.json.gz"] if "--detections" not in words else []
    return refused(files, "solve", "--rig", files / "rig.json", *given, "--out", out, *words)


def bomb(size: int) -> bytes:
    """Return a gzip file of zeros."""
    packer = zlib.compressobj(9, zlib.DEFLATED, 31)
    return b"".join(packer.compress(bytes(1 << 20)) for _ in range(size >> 20)) + packer.flush()


def test_damaged_and_swollen_gzip_files(files):
    data = bytearray((files / "detections.json.gz").read_bytes())
    data[len(data) // 2] ^= 0x40
    (files / "flipped.json.gz").write_bytes(data)
    assert "damaged" in solve(files, "--detections", files / "flipped.json.gz")
    (files / "cut.json.gz").write_bytes(data[: len(data) // 3])
    assert "cut" in solve(files, "--detections", files / "cut.json.gz")
    (files / "bomb.json.gz").write_bytes(bomb(320 << 20))
    assert "unpack to more than 32 MB" in solve(files, "--detections", files / "bomb.json.gz")
    assert "unpack to more than 32 MB" in refused(files, "rig", "check", files / "bomb.json.gz")


def test_documents_of_impossible_values(files):
    (files / "deep.json").write_text("[" * 100_000 + "]" * 100_000)
    assert "nested too deeply" in solve(files, "--detections", files / "deep.json")
    document = json.loads(gzip.decompress((files / "detections.json.gz").read_bytes()))
    document["frames"][0]["index"] = "first"
    (files / "index.json").write_text(json.dumps(document))
    assert "index = 'first'" in solve(files, "--detections", files / "index.json")
    huge = json.loads((files / "rig.json").read_text())
    huge["cameras"][0]["t"][0] = 10**400
    (files / "huge.json").write_text(json.dumps(huge))
    assert "not an array of numbers" in refused(files, "rig", "check", files / "huge.json")


def test_a_field_of_csv_that_is_too_long(files):
    columns = "device,stamp_ns,qw,qx,qy,qz,gx,gy,gz,ax,ay,az"
    (files / "imu.csv").write_text(f"{columns}\n{'a' * (csv.field_size_limit() + 1)},1,1,0,0,0,,,,0,0,9\n")
    (files / "subject.json").write_text('{"format": "panoptic-subject-1", "id": 1, "height_m": 1.8}')
    line = refused(
        files,
        "kinematics",
        "--imu",
        files / "imu.csv",
        "--subject",
        files / "subject.json",
        "--out",
        "k.json.gz",
    )
    assert "imu.csv, line 2" in line and "field larger" in line


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sync:\n  window_s: 2026-13-45\n", "month must be"),
        ("sync:\n  window_s: !!int x\n", "invalid literal"),
        ("sync: !!python/object/apply:os.system [x]\n", "not valid YAML"),
        ("- 1\n", "must hold"),
        (LAUGHS + "sync:\n  window_s: *i\n", "with its aliases expanded"),
        ("sync: &a {b: *a}\n", "within itself"),
    ],
)
def test_parameter_files(tmp_path, text, words):
    (tmp_path / "bad.yaml").write_text(text)
    line = refused(tmp_path, "run", "--bag", BAG, "--out", "out", "--config", tmp_path / "bad.yaml")
    assert words in line and "bad.yaml" in line


def test_aliases_in_cards_and_topics(files):
    (files / "laughs.yaml").write_text(LAUGHS + "name: *i\nleft: {image: *i}\nfixed_frame: *i\n")
    line = refused(files, "run", "--out", "out", "--topics", files / "laughs.yaml")
    assert "with its aliases expanded" in line
    with pytest.raises(DataError, match="with its aliases expanded"):
        read_card(str(files / "laughs.yaml"))


def test_skeletons_and_bias_tables_of_other_types(files):
    whole = (share_folder() / "config" / "skeletons" / "panoptic19.yaml").read_text()
    wrong = (("list", "Neck: neck", "Neck: [neck]"), ("number", "left_right:", "left_right: .nan #"))
    for name, old, new in wrong:
        assert old in whole
        (files / f"{name}.yaml").write_text(whole.replace(old, new))
        assert f"{name}.yaml" in solve(files, "--skeleton", files / f"{name}.yaml")
    folder = share_folder() / "config" / "biases"
    table = (folder / "movenet-multipose-panoptic19.yaml").read_text()
    rows = ("[1, 2026-11-27, 3]", f"[1, {10**400}, 3]", "{x: 1}", "[1, [], 2]")
    for name, row in zip("abcd", rows):
        wrong = table.replace("offsets:\n", f"offsets:\n  left_hip_x: {row}\n", 1)
        (files / f"{name}.yaml").write_text(wrong)
        assert f"{name}.yaml" in solve(files, "--set", f"assembly.bias_table={files / name}.yaml")
    assert "unknown skeleton" in solve(files, "--skeleton", "a" * 300)
    assert "File name too long" in solve(files, "--skeleton", "a" * 300 + ".yaml")


@pytest.mark.parametrize("kind", ["folder", "pipe", "device", "nothing", "empty", "utf-16"])
def test_files_that_are_none(files, kind):
    path = files / "x.json"
    if kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "empty":
        path.write_bytes(b"")
    elif kind == "utf-16":
        path.write_text("[1]", "utf-16")
    path = Path("/dev/zero") if kind == "device" else path
    assert str(path) in solve(files, "--detections", path)


def test_places_that_cannot_be_written(files):
    (files / "folder").mkdir()
    (files / "link").symlink_to("folder")
    (files / "dangling").symlink_to("nothing")
    for out in (".", "/", "folder", "link", "/dev/null"):
        assert "name a file" in solve(files, out=out)
    assert "is empty" in refused(files, "solve", "--rig", "r", "--detections", "d", "--out", "")
    assert "link to" in solve(files, out="dangling") and "is not a folder" in solve(files, out="dangling/x")
    assert "File name too long" in solve(files, out="a" * 300)
    for out, words in (
        ("/", "root of the file system"),
        ("", "is empty"),
        ("dangling", "link to"),
        ("rig.json", "it is a file"),
    ):
        assert words in refused(files, "simulate", "clean-4p5v", "--frames", "1", "--out", out)
    assert (files / "link").is_symlink() and (files / "dangling").is_symlink()


def test_results_go_through_a_link_to_a_file(files):
    (files / "target.json").write_text("old")
    (files / "out.json").symlink_to("target.json")
    out = str(files / "out.json")
    words = ["--rig", str(files / "rig.json"), "--detections", str(files / "detections.json.gz")]
    assert main(["solve", *words, "--out", out]) == 0
    assert (files / "out.json").is_symlink() and json.loads((files / "target.json").read_text())["frames"]


def png(width: int, height: int) -> bytes:
    """Return a black PNG of one bit per pixel, whose decoded image takes a thousand times its size."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    head = struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)
    rows = zlib.compress(bytes((width // 8 + 1) * height), 9)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")


def test_an_image_that_is_far_larger_than_its_file(files):
    for camera in captures.RIG.cameras:
        (files / camera.name).mkdir()
        (files / camera.name / "0.png").write_bytes(png(16000, 16000))
    line = refused(files, "run", files, "--out", files / "out", "--in-process", "--frame-rate", "25")
    assert "images are 16000x16000 but the rig states 1280x720" in line


def test_sync_tables_that_are_text(files):
    for camera in captures.RIG.cameras:
        (files / camera.name).mkdir()
        (files / camera.name / "0.png").write_bytes(png(1280, 720))
    (files / "synctables_a.json").write_text('{"hd": {"univ_time": "none"}, "kinect": {"color": "none"}}')
    assert "synctables_a.json" in refused(files, "run", files, "--out", files / "out", "--in-process")


def written(path: Path, alien: int) -> Path:
    """Write a bag of four cameras and five instants; one message of cam1 names another camera."""
    views = [captures.view(c, k, 10**9 + k * 10**8) for k in range(5) for c in captures.RIG.cameras]
    family = bag_messages()
    with BagWriter(path) as writer:
        writer.write("/rig", 10**9, to_message(captures.RIG, family))
        writer.write("/skeleton_model", 10**9, to_message(captures.SKELETON, family))
        for number, view in enumerate(views):
            message = to_message(view, family)
            if view.camera == "cam1" and number // 4 == alien:
                message.header.frame_id = "other"
            writer.write(f"/{view.camera}/detections", view.stamp_ns, message)
    return path


def test_a_message_of_another_camera_is_left_out_and_named(tmp_path, capsys):
    bag = written(tmp_path / "bag", alien=2)
    assert main(["run", "--bag", str(bag), "--out", str(tmp_path / "out"), "--in-process"]) == 0
    told = capsys.readouterr().out
    assert "1 sync: bad_message" in told
    assert f"{bag}, topic /cam1/detections: detections of camera other, not of cam1; left out" in told


def test_messages_that_cannot_be_brought_up_are_told_and_left_out(tmp_path, monkeypatch):
    bag = written(tmp_path / "bag", alien=9)

    def bring(data):
        if bring.count == 2:
            bring.count += 1
            raise struct.error("Invalid string length")
        bring.count += 1
        return data

    bring.count = 0
    monkeypatch.setattr(BagReader, "_brought_up", lambda self, connection: bring)
    stream = BagStream(bag, "/cam1/detections", "cam1", "detections")
    with BagReader(bag) as reader:
        items = list(stream.messages(reader))
    bad = [str(item) for item in items if isinstance(item, Exception)]
    assert len(items) == 5 and len(bad) == 1
    assert str(bag) in bad[0] and "/cam1/detections" in bad[0] and "Invalid string length" in bad[0]
    assert np.all([item.message.joint_count == 19 for item in items if not isinstance(item, Exception)])
