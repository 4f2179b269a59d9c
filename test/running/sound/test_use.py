"""Runs on cameras of two clocks, by the timecodes that one recorder hears of both."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.domain import AudioBlock, ViewDetections
from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.io.bags import BagReader, BagWriter
from panoptic_ros.io.messages import bag_messages, from_message, to_message
from panoptic_ros.io.rigs import read_rig, write_rig
from panoptic_ros.io.wav import WavFile, write_wav
from panoptic_ros.running.evaluate import evaluate
from panoptic_ros.running.plans.bag_plan import plan_bags
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.planning import plan_capture
from panoptic_ros.running.runs.run import run
from panoptic_ros.running.simulations.takes import write_take
from panoptic_ros.simulation import SKELETON
from panoptic_ros.view.pictures import write_image

FRAMES = 45
SECOND = 10**9
CLOCKS = {"cam00": "A", "cam01": "B", "cam02": "A", "cam03": "B", "cam04": "A", "cam05": "B"}


@pytest.fixture(scope="module")
def taken(tmp_path_factory):
    """The simulation, and a folder with its truth, rig, sound and bag."""
    folder = tmp_path_factory.mktemp("take") / "take"
    return write_take("two-clocks-3p6v", folder, frames=FRAMES, bag=True), folder


@pytest.fixture(scope="module")
def solved(taken, tmp_path_factory):
    """Results of the bag in one process."""
    out = tmp_path_factory.mktemp("solved") / "out"
    return run(plan_bags([taken[1] / "bag"]), out, in_process=True, pictures=False), out


def rewritten(path, bag, change):
    """A bag whose records are changed; None leaves one out."""
    family = bag_messages()
    kinds = {"AudioBlock": "AudioBlock", "ViewDetections": "ViewDetections", "Rig": "Rig"}
    with BagReader(bag) as source, BagWriter(path) as target:
        for topic, stamp, message in source.messages():
            kind = kinds.get(source.topics[topic].split("/")[-1])
            record = change(from_message(message, kind)) if kind else message
            if record is not None:
                target.write(topic, stamp, to_message(record, family) if kind else record)
    return path


def mpjpe_mm(folder, out):
    return evaluate(folder / "truth.json.gz", out / "skeletons.json.gz").values["mpjpe_mm"]


def test_skeletons_are_on_the_master_time_line_and_as_good_as_with_true_stamps(taken, solved, tmp_path):
    simulation, folder = taken
    outcome, out = solved
    assert outcome.report.summary.frames == FRAMES and not outcome.report.dropped
    generators = dict(zip("AB", simulation.scene.timing.generators))

    def with_true_stamps(record):
        if isinstance(record, AudioBlock):
            return None
        if not isinstance(record, ViewDetections):
            return replace(record, cameras=tuple(replace(c, clock="") for c in record.cameras))
        own = generators[CLOCKS[record.camera]]
        since = (record.stamp_ns - own.stamp_ns(own.begin_s)) / (1.0 + 1e-6 * own.drift_ppm)
        return replace(record, stamp_ns=simulation.master_ns(own.begin_s + since / SECOND))

    true = rewritten(tmp_path / "true", folder / "bag", with_true_stamps)
    run(plan_bags([true]), tmp_path / "out", in_process=True, pictures=False)
    assert mpjpe_mm(folder, out) < 1.01 * mpjpe_mm(folder, tmp_path / "out")
    assert mpjpe_mm(folder, out) < 5.0


def test_the_bag_of_a_run_has_its_sound_and_gives_the_same_again(taken, solved, tmp_path):
    with BagReader(solved[1] / "bag") as bag, BagReader(taken[1] / "bag") as before:
        assert bag.counts["/timecode/audio"] == before.counts["/timecode/audio"]
        stamps = [stamp for _, stamp, _ in bag.messages()]
    assert max(stamps) - min(stamps) < 12 * SECOND  # on one time line, whatever the clocks
    run(plan_bags([solved[1] / "bag"]), tmp_path / "out", in_process=True, pictures=False)
    again, first = ((path / "skeletons.json.gz").read_bytes() for path in (tmp_path / "out", solved[1]))
    assert again == first


@pytest.mark.ros
def test_the_graph_gives_the_same_bytes(taken, solved, tmp_path):
    pytest.importorskip("rclpy")
    words = ["run", "--bag", str(taken[1] / "bag"), "--out", str(tmp_path / "out"), "--no-pictures"]
    assert main(words) == 0
    graph, process = ((path / "skeletons.json.gz").read_bytes() for path in (tmp_path / "out", solved[1]))
    assert graph == process


# ---------------------------------------------------------------- folders


@pytest.fixture
def folder(taken, tmp_path, monkeypatch):
    """A capture folder with the sound, and tiny images that nobody looks at."""
    monkeypatch.setattr(RunOptions, "detector", lambda options: (SKELETON, {}))
    path = tmp_path / "capture"
    path.mkdir()
    rig = read_rig(taken[1] / "rig.json")
    cameras = tuple(replace(c, image_size=(8, 6)) for c in rig.cameras)
    write_rig(path / "rig.json", replace(rig, cameras=cameras))
    generators = dict(zip("AB", taken[0].scene.timing.generators))
    rows = ["camera,frame,stamp_ns"]
    for name in rig.names:
        (path / name).mkdir()
        for k in range(3):
            write_image(path / name / f"{k}.png", np.zeros((6, 8, 3), np.uint8))
            own = generators[CLOCKS[name]]
            rows.append(f"{name},{k},{own.stamp_ns(own.begin_s + k / own.true_rate)}")
    (path / "timestamps.csv").write_text("\n".join(rows))
    for name in ("timecode.wav", "sound.yaml"):
        (path / name).write_bytes((taken[1] / name).read_bytes())
    return path


def sound_of(folder):
    """Rate and samples of its recording, to be written again."""
    file = WavFile(folder / "timecode.wav")
    return file.sample_rate, file.samples(0, len(file))


def test_a_recording_beside_the_cameras_is_used_as_the_bag_is(folder, taken, solved, tmp_path):
    plan, bag = plan_capture(folder), plan_bags([taken[1] / "bag"])
    assert plan.devices == ("timecode",) and plan.stages[:3] == ("timecode", "clocks", "detection")
    assert plan.configs["sync"].clocks == tuple(f"{c}={clock}" for c, clock in CLOCKS.items())
    assert plan.configs["clocks"].master_clock == "A"
    assert plan.shifts["cam00"] == 0
    assert plan.shifts == pytest.approx(bag.shifts, abs=2e4)  # noise of another recording
    detections = tuple(stream for stream in bag.streams if stream.key == "detections")
    mixed = replace(bag, streams=detections, sounds=plan.sounds)
    run(mixed, tmp_path / "out", in_process=True, pictures=False)
    assert mpjpe_mm(taken[1], tmp_path / "out") == pytest.approx(mpjpe_mm(taken[1], solved[1]), rel=0.01)


def test_without_timecode_it_is_told_before_anything_starts(folder):
    rate, samples = sound_of(folder)
    noise = np.random.default_rng(0).normal(0, 0.1, (2 * rate, 2))
    write_wav(folder / "timecode.wav", rate, noise)
    with pytest.raises(DataError, match="clock A, which stamps cam00, cam02, cam04: timecode.wav has no t"):
        plan_capture(folder)
    write_wav(folder / "timecode.wav", rate, np.stack([samples[:, 0], 0.1 * samples[:, 0] ** 2], 1))
    with pytest.raises(DataError, match="clock B, which .*: timecode.wav has timecode of A only"):
        plan_capture(folder)


def test_channels_that_are_swapped_are_told(folder):
    rate, samples = sound_of(folder)
    write_wav(folder / "timecode.wav", rate, samples[:, ::-1])
    with pytest.raises(DataError, match="channels of timecode seem to be swapped: cameras of clock A fit"):
        plan_capture(folder)


def test_sound_of_another_rate_is_told(folder):
    write_wav(folder / "timecode.wav", 44_100, sound_of(folder)[1])
    with pytest.raises(DataError, match="no timecode of clock B.* Hz instead of the stated 44100 Hz"):
        plan_capture(folder)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("timecode.wav: [A, B, X]", "3 channels of .*timecode.wav are named .A, B, X., but it has 2"),
        (
            "timecode.wav: [A, C]",
            "no recording has the timecode of clock B, which stamps cam01, cam03, cam05",
        ),
        ("other.wav: [A, B]", "names other.wav; .* has timecode.wav"),
        (
            "timecode.wav: {clocks: [A, B], begin: 3}",
            "unknown key 'begin'; known are clocks, start_ns, track",
        ),
        ("timecode.wav: [[A], B]", "is not a list of clocks"),
        ("[timecode.wav]", "must hold the clocks of files"),
    ],
)
def test_a_sound_yaml_that_cannot_be_meant_is_told(folder, text, message):
    (folder / "sound.yaml").write_text(text)
    with pytest.raises(DataError, match=message):
        plan_capture(folder)


def test_a_clock_that_only_a_parameter_names_is_told_at_once(folder):
    (folder / "timecode.wav").unlink()
    (folder / "sound.yaml").unlink()
    with pytest.raises(
        UsageError, match=r"sync.clocks names \*=nope, but no recording has the timecode of clock nope"
    ):
        plan_capture(folder, RunOptions({"sync": {"clocks": ["*=nope"]}}))
    assert not plan_capture(folder).devices  # clocks of the rig alone change nothing


def test_another_master_clock_and_one_that_is_not_there(folder):
    plan = plan_capture(folder, RunOptions({"sync": {"master_clock": "B"}}))
    assert plan.configs["clocks"].master_clock == "B" and plan.shifts["cam01"] == 0
    assert plan.shifts["cam00"] == pytest.approx(-plan_capture(folder).shifts["cam01"], abs=2e6)
    with pytest.raises(UsageError, match="master_clock = 'X' is the timecode of no channel; named are A, B"):
        plan_capture(folder, RunOptions({"sync": {"master_clock": "X"}}))


def test_sound_that_tells_of_no_camera_is_left_alone(folder):
    rate, samples = sound_of(folder)
    write_wav(folder / "talk.wav", rate, samples[:, 0] * 0.01)
    plan = plan_capture(folder)
    assert plan.devices == ("timecode",)
    assert any(line.startswith("talk.wav is not used: it gives no clock") for line in plan.notices)


def test_a_late_timecode_is_waited_for_and_its_silence_left_out(folder):
    rate, samples = sound_of(folder)
    late = np.concatenate([np.zeros((4 * rate, 2)), samples])
    write_wav(folder / "timecode.wav", rate, late)
    plan = plan_capture(folder)
    (sound,) = plan.sounds
    assert 3 * rate < sound["from_sample"] <= 4 * rate
    assert plan.shifts["timecode/audio"] < 36_000 * SECOND - 9 * SECOND  # still before the first frames


def test_stamps_of_the_recording_are_those_of_the_folder(folder):
    rows = (folder / "timestamps.csv").read_text()
    stamps = "".join(f"\ntimecode,{k * 4800},{77 * SECOND + k * 100_000_000}" for k in range(20))
    (folder / "timestamps.csv").write_text(rows + stamps)
    plan = plan_capture(folder)
    assert plan.shifts["timecode/audio"] == pytest.approx((36_000 - 1.5 - 77 - 5) * SECOND, abs=1e6)
    (folder / "timestamps.csv").write_text(rows + "\ntimecode,0,1\ntimecode,1,2\ntimecode,2,3")
    with pytest.raises(DataError, match="of sound, a frame is the index of the first sample of a block"):
        plan_capture(folder)


def test_a_device_whose_own_clock_stamps_the_cameras(folder):
    """Each camera on the clock of the recorder, which hears one timecode."""
    (folder / "sound.yaml").write_text("timecode.wav: [timecode, '']")
    rig = read_rig(folder / "rig.json")
    cameras = tuple(replace(camera, clock="timecode") for camera in rig.cameras)
    write_rig(folder / "rig.json", replace(rig, cameras=cameras))
    rows = [f"{name},{k},{2 * SECOND + k * 40_000_000}" for name in rig.names for k in range(3)]
    (folder / "timestamps.csv").write_text("\n".join(["camera,frame,stamp_ns", *rows]))
    plan = plan_capture(folder)
    assert plan.shifts["cam00"] == pytest.approx((36_000 - 1.5) * SECOND, abs=1e6)
    assert plan.configs["sync"].clocks == tuple(f"{name}=timecode" for name in rig.names)


# ---------------------------------------------------------------- sound that fails while it runs


def test_sound_that_stops_is_told_in_the_report_and_held_over(tmp_path):
    folder = tmp_path / "take"
    write_take("two-clocks-3p6v", folder, frames=130, bag=True)

    def change(record):
        stops = isinstance(record, AudioBlock) and record.first_sample > 2.0 * record.sample_rate
        return None if stops else record

    bag = rewritten(tmp_path / "bag", folder / "bag", change)
    outcome = run(plan_bags([bag]), tmp_path / "out", in_process=True, pictures=False)
    told = [notice.text for notice in outcome.report.notices if notice.code == "sync.clock_silent"]
    assert told and all(
        "had no observations for 3 s of frames; its line is held over" in text for text in told
    )
    assert outcome.report.summary.frames == 130 and mpjpe_mm(folder, tmp_path / "out") < 5.0


def test_names_that_are_swapped_in_a_bag_are_told(taken, tmp_path):
    def change(record):
        return replace(record, clocks=record.clocks[::-1]) if isinstance(record, AudioBlock) else record

    with pytest.raises(DataError, match="the channels of timecode seem to be swapped: cameras of clock"):
        plan_bags([rewritten(tmp_path / "bag", taken[1] / "bag", change)])


def test_lost_sound_is_told_and_moves_nothing(taken, solved, tmp_path):
    def change(record):
        lost = isinstance(record, AudioBlock) and 9 * 4800 <= record.first_sample < 11 * 4800
        return None if lost else record

    bag = rewritten(tmp_path / "bag", taken[1] / "bag", change)
    outcome = run(plan_bags([bag]), tmp_path / "out", in_process=True, pictures=False)
    told = [notice.text for notice in outcome.report.notices if notice.code == "timecode.gap"]
    assert told == ["audio of timecode lost 9600 samples before sample 52800"]
    assert mpjpe_mm(taken[1], tmp_path / "out") == pytest.approx(mpjpe_mm(taken[1], solved[1]), rel=0.01)
