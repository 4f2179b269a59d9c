"""Clock models from readings with known offset and drift."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.clocks.config import ClocksConfig
from panoptic_ros.clocks.stage import ClocksStage
from panoptic_ros.domain import ClockModel, FrameRate, Timecode, TimecodeReading
from panoptic_ros.stage import Notice

PAL = FrameRate(25, Fraction(25))
NTSC = FrameRate(30, Fraction(30000, 1001), True)
START = 5_000_000_000_000  # device time of the first reading


def readings(
    count: int,
    rate: FrameRate = PAL,
    first: int = 90_000,
    drift: float = 40e-6,
    jitter_s: float = 0.0,
    device: str = "mic",
    start_ns: int = START,
    seed: int = 0,
) -> list[TimecodeReading]:
    """A device whose clock runs `drift` slow against the timecode: master = device * (1 + drift) + const."""
    rng = np.random.default_rng(seed)
    result = []
    for k in range(count):
        seconds = float(k / rate.exact) / (1.0 + drift)
        stamp = start_ns + round(1e9 * (seconds + jitter_s * rng.standard_normal()))
        label = Timecode.from_frame_count(first + k, rate)
        result.append(TimecodeReading(device, stamp, label, 48000.0 * seconds, 0.02))
    return result


def run(items: list[TimecodeReading], **config: float) -> tuple[list[ClockModel], list[Notice]]:
    stage = ClocksStage(ClocksConfig(**config))
    results = [stage.step(item) for item in items] + [stage.flush()]
    return [m for r in results for m in r.outputs], [n for r in results for n in r.notices]


def master_error(
    model: ClockModel, k: int, items: list[TimecodeReading], rate: FrameRate, first: int
) -> float:
    """Seconds between the model and the truth at reading k, whose stamp must be exact."""
    truth = Fraction(first + k) / rate.exact
    return (model.master_from_device(items[k].stamp_ns)[0] - truth * 10**9) * 1e-9


@settings(max_examples=30, deadline=None)
@given(
    drift=st.floats(-2e-4, 2e-4),
    rate=st.sampled_from([PAL, NTSC]),
    first=st.integers(0, 2_000_000),
    start_ns=st.integers(0, 10**15),
)
def test_offset_and_drift_are_found(drift: float, rate: FrameRate, first: int, start_ns: int) -> None:
    items = readings(150, rate, first, drift, start_ns=start_ns)
    models, notices = run(items, period_s=1.0)
    assert not notices and len(models) in (5, 6)
    model = models[-1]
    assert model.drift == pytest.approx(drift, abs=2e-9)
    label_zero = Timecode.from_frame_count(first, rate).frame_count
    for k in (0, 75, 149):
        assert abs(master_error(model, k, items, rate, label_zero)) < 1e-8


def test_precision_with_jitter_is_what_is_stated() -> None:
    scaled = []
    for seed in range(30):
        clean, items = readings(250), readings(250, jitter_s=5e-4, seed=seed)
        model = run(items)[0][-1]
        at = int((model.reference_ns - START) / 4e7)
        error = master_error(model, at, clean, PAL, 90_000)
        scaled.append(error / np.sqrt(model.covariance[0, 0]))
        assert abs(model.drift - 40e-6) < 5 * np.sqrt(model.covariance[1, 1])
        assert np.sqrt(model.covariance[0, 0]) == pytest.approx(5e-4 / np.sqrt(250), rel=0.3)
    assert 0.6 < np.std(scaled) < 1.6


def test_late_stamps_of_a_busy_machine_are_left_out() -> None:
    items = readings(400)
    rng = np.random.default_rng(3)
    late = [
        TimecodeReading(
            r.device,
            r.stamp_ns + int(rng.integers(5, 15) * 1e6) * (rng.random() < 0.1),
            r.timecode,
            r.start_sample,
            r.std_samples,
        )
        for r in items
    ]
    model = run(late)[0][-1]
    assert abs(master_error(model, 200, items, PAL, 90_000)) < 2e-5


def test_wrong_labels_are_left_out() -> None:
    items = readings(200)
    bad = items[100]
    items[100] = TimecodeReading(
        bad.device, bad.stamp_ns, Timecode(3, 3, 3, 3, PAL), bad.start_sample, bad.std_samples
    )
    models, notices = run(items)
    assert not notices
    assert abs(master_error(models[-1], 150, items, PAL, 90_000)) < 1e-8


def test_midnight_is_counted_over() -> None:
    for rate in (PAL, NTSC):
        day = 24 * 107_892 if rate.drop_frame else 24 * 3600 * 25
        items = readings(200, rate, day - 100)
        models, notices = run(items)
        assert not notices
        assert abs(master_error(models[-1], 199, items, rate, day - 100)) < 1e-8


def test_a_jump_begins_a_new_line() -> None:
    first, second = readings(100), readings(100, first=500_000, start_ns=START + 4_000_000_000)
    models, notices = run(first + second)
    (notice,) = notices
    assert notice.code == "clocks.jump" and "mic jumped by +1.64e+04 s" in notice.text
    assert abs(master_error(models[-1], 50, second, PAL, 500_000)) < 1e-8
    assert abs(master_error(models[1], 50, first, PAL, 90_000)) < 1e-8


def test_models_are_renewed_every_period_and_forget_the_old() -> None:
    items = readings(500)
    assert len(run(items, period_s=1.0)[0]) == 20
    assert len(run(items, period_s=5.0)[0]) == 5
    assert len(run(items, period_s=0.0)[0]) == 500 - 26
    slow, fast = readings(500, drift=0.0), []
    for k, item in enumerate(readings(500, first=90_500, drift=1e-4)):
        fast.append(
            TimecodeReading(
                "mic",
                slow[-1].stamp_ns + 40_000_000 + item.stamp_ns - START,
                item.timecode,
                1e6 + k * 1920.0,
                0.02,
            )
        )
    model = run(slow + fast, window_s=5.0)[0][-1]
    assert model.drift == pytest.approx(1e-4, abs=1e-8)


def test_too_little_gives_no_model() -> None:
    assert run(readings(20))[0] == []
    assert run([])[0] == []


def test_devices_are_independent() -> None:
    one, two = readings(100), readings(100, NTSC, 5, drift=-1e-5, device="kinect", start_ns=77)
    mixed = [item for pair in zip(one, two) for item in pair]
    models = run(mixed)[0]
    for name, alone in (("mic", one), ("kinect", two)):
        expected = run(alone)[0]
        found = [model for model in models if model.device == name]
        assert [(m.reference_ns, m.offset_ns, m.drift) for m in found] == [
            (m.reference_ns, m.offset_ns, m.drift) for m in expected
        ]


def test_bad_readings_do_not_change_the_state() -> None:
    items = readings(60)
    stage = ClocksStage(ClocksConfig())
    for item in items[:30]:
        stage.step(item)
    (note,) = stage.step(items[10]).notices
    assert note.code == "clocks.stamp_back"
    back = TimecodeReading("mic", items[40].stamp_ns, items[40].timecode, 1.0, 0.1, reverse=True)
    assert stage.step(back).notices[0].code == "clocks.reverse"
    models = [m for item in items[30:] for m in stage.step(item).outputs] + list(stage.flush().outputs)
    assert models[-1].offset_ns == run(items)[0][-1].offset_ns


def test_flush_and_reset_leave_a_new_stage() -> None:
    items = readings(80)
    stage = ClocksStage(ClocksConfig())
    first = [m.offset_ns for item in items for m in stage.step(item).outputs]
    stage.flush()
    assert [m.offset_ns for item in items for m in stage.step(item).outputs] == first
    stage.reset()
    assert [m.offset_ns for item in items for m in stage.step(item).outputs] == first
