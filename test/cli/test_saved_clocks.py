"""One file of clocks and line delays for `solve`, `continuous` and `run`."""

import json
from dataclasses import replace

import captures
import numpy as np
import pytest
from recordings import write_bag
from rolling import rolling_points, with_line_delays

from panoptic_ros.cli.main import main
from panoptic_ros.domain import DetectionSet
from panoptic_ros.io.plain_formats import read_skeletons, write_detections
from panoptic_ros.io.rigs import write_rig

FRAMES, RATE, START = 75, 30.0, 10**12
NOISE_PX = 0.2
CLOCKS = {
    "cam0": {"offset_s": 0.0, "drift_ppm": 0.0, "line_delay_us": 0.0},
    "cam1": {"offset_s": 0.04, "drift_ppm": 2000.0, "line_delay_us": 0.0},
    "cam2": {"offset_s": -0.03, "drift_ppm": 0.0, "line_delay_us": 30.0},
    "cam3": {"offset_s": 0.0, "drift_ppm": 0.0, "line_delay_us": 20.0},
}
SPREAD = {"offset_sd_s": 1e-4, "drift_sd_ppm": 9.0, "line_delay_sd_us": 0.5}
RIG = with_line_delays(captures.RIG, [clock["line_delay_us"] for clock in CLOCKS.values()])


def people(time_s):
    """Two people, one of whom walks fast."""
    return captures.people(2.5 * (time_s - 1e-9 * START))


def taken():
    """Views of cameras whose images begin together, with the timestamps of their own clocks."""
    rng, sets = np.random.default_rng(0), []
    for index in range(FRAMES):
        master, views = START + round(index * 1e9 / RATE), []
        for camera in RIG.cameras:
            clock = CLOCKS[camera.name]
            points = rolling_points(camera, people, 1e-9 * master)
            points = points + NOISE_PX * rng.standard_normal(points.shape)
            scores = np.where(camera.contains(points), 0.9, 0.0)
            points = np.where(scores[..., None] > 0.0, points, np.nan)
            drift = 1e-6 * clock["drift_ppm"]
            since = (master - START - 1e9 * clock["offset_s"]) / (1.0 + drift)
            view = captures.view(camera, index, master)
            views.append(replace(view, stamp_ns=START + round(since), points=points, scores=scores))
        sets.append(DetectionSet(index, master, captures.SKELETON.hash, tuple(views)))
    return sets


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    folder, sets = tmp_path_factory.mktemp("saved"), taken()
    write_rig(folder / "rig.json", captures.RIG)  # it states no line delay
    write_detections(folder / "detections.json.gz", captures.SKELETON.joint_names, sets)
    write_bag(folder / "bag", [view for item in sets for view in item.views])
    clocks = {name: {**clock, **SPREAD} for name, clock in CLOCKS.items()}
    write(folder / "clocks.json", {"format": "panoptic-clocks-1", "reference_ns": START, "cameras": clocks})
    older = [
        {"name": name, "applied": True, "offset_s": clock["offset_s"], "drift": 1e-6 * clock["drift_ppm"]}
        for name, clock in CLOCKS.items()
    ]
    write(folder / "older.json", {"format": "panoptic-offsets-1", "reference_ns": START, "cameras": older})
    write_rig(folder / "rolling.json", RIG)
    return folder


def write(path, content):
    path.write_text(json.dumps(content))


def error_mm(path):
    """Median over frames of the worst error of a joint of the person who walks."""
    worst = []
    for frame in read_skeletons(path).frames:
        if START + 5e8 < frame.stamp_ns < START + 2e9:
            gaps = np.linalg.norm(frame.positions - people(1e-9 * frame.stamp_ns)[0], axis=-1).max(-1)
            worst.append(1e3 * np.nan_to_num(gaps, nan=np.inf).min(initial=np.inf))
    return np.median(worst)


def run(verb, capture, folder, *options, rig="rig.json"):
    out = folder / "s.json.gz"
    files = ["--rig", str(capture / rig), "--detections", str(capture / "detections.json.gz")]
    assert main([verb, *files, "--out", str(out), *map(str, options)]) == 0
    return error_mm(out)


@pytest.mark.parametrize("verb", ["solve", "continuous"])
def test_clocks_drifts_and_line_delays_of_a_file_are_applied(capture, tmp_path, capsys, verb):
    assert run(verb, capture, tmp_path, "--offsets", capture / "clocks.json") < 5.0
    text = capsys.readouterr().out
    assert "with drifts" in text and "drift +2000 ppm" in text and "30.0 us per row" in text
    older = run(verb, capture, tmp_path, "--offsets", capture / "older.json", rig="rolling.json")
    assert older < 5.0
    assert run(verb, capture, tmp_path) > 12.0


def test_continuous_writes_known_clocks_as_it_read_them(capture, tmp_path):
    out = tmp_path / "clocks.json"
    run("continuous", capture, tmp_path, "--offsets", capture / "clocks.json", "--clocks-out", out)
    written, given = (json.loads(path.read_text()) for path in (out, capture / "clocks.json"))
    since = 1e-9 * (written["reference_ns"] - given["reference_ns"])
    for name, clock in given["cameras"].items():
        found = written["cameras"][name]
        assert found.pop("observable")
        offset = clock["offset_s"] + 1e-6 * clock["drift_ppm"] * since
        expected = {**clock, "offset_s": offset}
        assert found == {key: pytest.approx(value, rel=1e-3, abs=1e-8) for key, value in expected.items()}


def test_estimates_start_from_known_clocks_and_refer_to_the_stamps_of_the_recording(capture, tmp_path):
    out, near = tmp_path / "clocks.json", json.loads((capture / "clocks.json").read_text())
    near["cameras"]["cam1"]["offset_s"] += 0.004
    write(tmp_path / "near.json", near)
    options = [
        "--offsets",
        tmp_path / "near.json",
        "--clocks",
        "--trusted-camera",
        "cam0",
        "--clocks-out",
        out,
    ]
    assert run("continuous", capture, tmp_path, *options) < 5.0
    found = json.loads(out.read_text())
    for name, clock in CLOCKS.items():
        own = found["cameras"][name]
        since = 1.25 - 1e-9 * (found["reference_ns"] - START)  # in the middle
        middle = own["offset_s"] + 1e-6 * own["drift_ppm"] * since
        expected = clock["offset_s"] + 1e-6 * clock["drift_ppm"] * 1.25
        assert abs(middle - expected) < 1e-3 and own["observable"]


def test_a_run_takes_clocks_and_line_delays_and_the_drifts_of_its_own_recording(capture, tmp_path):
    elsewhere = json.loads((capture / "clocks.json").read_text())
    elsewhere["reference_ns"] += 3600 * 10**9
    write(tmp_path / "elsewhere.json", elsewhere)
    arguments = ["run", "--bag", str(capture / "bag"), "--in-process", "--no-pictures", "--out"]
    errors, told = {}, {}
    for name, options in (
        ("own", ["--offsets", str(capture / "clocks.json")]),
        ("elsewhere", ["--offsets", str(tmp_path / "elsewhere.json")]),
        ("without", []),
    ):
        assert main([*arguments, str(tmp_path / name), *options]) == 0
        errors[name] = error_mm(tmp_path / name / "skeletons.json.gz")
        report = json.loads((tmp_path / name / "report.json").read_text())
        told[name] = " ".join(notice["text"] for notice in report["notices"])
    assert errors["own"] < errors["elsewhere"] < 12.0 and errors["without"] > 20.0  # 2 ms of drift are 4 mm
    assert "with drifts" in told["own"] and "drift +2000 ppm" in told["own"]
    assert "without drifts" in told["elsewhere"]
    assert "cam1 drifts by +120.0 ms a minute" in told["elsewhere"]


@pytest.mark.parametrize("verb", ["solve", "continuous"])
def test_a_clock_may_be_off_by_more_than_views_of_a_set_may_be_apart(capture, tmp_path, verb):
    sets, clocks = taken(), json.loads((capture / "clocks.json").read_text())
    for k, item in enumerate(sets):
        views = [
            replace(view, stamp_ns=view.stamp_ns - 5 * 10**9 * (view.camera == "cam3")) for view in item.views
        ]
        sets[k] = replace(item, views=tuple(views))
    write_detections(tmp_path / "detections.json.gz", captures.SKELETON.joint_names, sets)
    clocks["cameras"]["cam3"]["offset_s"] += 5.0
    write(tmp_path / "clocks.json", clocks)
    write_rig(tmp_path / "rig.json", captures.RIG)
    out = tmp_path / "out"
    out.mkdir()
    assert run(verb, tmp_path, out, "--offsets", tmp_path / "clocks.json") < 5.0
    seen = [frame.views.max(initial=0) for frame in read_skeletons(out / "s.json.gz").frames]
    assert max(seen) == 4


@pytest.mark.parametrize("verb", ["solve", "continuous"])
def test_a_file_that_cannot_be_used_is_one_line(capture, tmp_path, capsys, verb):
    files = ["--rig", str(capture / "rig.json"), "--detections", str(capture / "detections.json.gz")]
    write(tmp_path / "k.json", {"format": "panoptic-clocks-1", "cameras": {"cam1": {"drift_ppm": 1.0}}})
    write(tmp_path / "none.json", {"format": "panoptic-clocks-1", "cameras": {"other": {"offset_s": 1.0}}})
    for name, says in (
        ("k.json", "offset_s of cam1 is missing"),
        ("none.json", "corrects none"),
        ("x", "No such"),
    ):
        out = ["--out", str(tmp_path / "s.json"), "--offsets", str(tmp_path / name)]
        assert main([verb, *files, *out]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert says in line and not (tmp_path / "s.json").exists()
