"""Clocks while the motion goes on."""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.domain import ClockModel
from panoptic_ros.errors import ConfigError, DataError
from panoptic_ros.offsets import stage as stage_module
from panoptic_ros.offsets.config import OffsetsConfig
from panoptic_ros.offsets.stage import OffsetsStage

SECOND = 1_000_000_000
PER_PERSON = ("positions", "covariances", "scores", "views", "states", "person_scores", "ids")


def run(capture, stage):
    """All views and tracked people in the order of their stamps; the models that come out, and notices."""
    models, notices = [], []
    for item, tracked in zip(capture.sets, capture.tracked):
        for record in (*item.views, tracked):
            result = stage.step(record)
            models += result.outputs
            notices += result.notices
    return models, notices


@pytest.fixture(scope="module")
def capture(make_capture):
    return make_capture(seconds=5.0, drift=4e-5)


def shift(model: ClockModel, stamp_ns: int) -> float:
    """What a model adds to a stamp, s."""
    return 1e-9 * (model.master_from_device(stamp_ns)[0] - stamp_ns)


def test_models_come_near_the_truth_block_by_block(capture):
    stage = OffsetsStage(OffsetsConfig(active=True, block_s=1.0), capture.context)
    models, notices = run(capture, stage)
    assert [n.code for n in notices] == ["offsets.corrected"]
    last = {model.device: model for model in models}
    assert len(models) > len(last) >= 4
    end = int(capture.ticks[-1])
    for name, model in last.items():
        c = capture.rig.index(name)
        true = capture.offsets[c] + 4e-5 * (c - 2) * (1e-9 * (end - capture.ticks[0]) - 1.5)
        assert shift(model, end) == pytest.approx(true, abs=2e-3)
        assert np.sqrt(model.covariance[0, 0]) < 1.5e-3


def test_same_input_same_models_and_reset_is_as_new(capture):
    stage = OffsetsStage(OffsetsConfig(active=True), capture.context)
    first, _ = run(capture, stage)
    stage.reset()
    again, _ = run(capture, stage)
    other, _ = run(capture, OffsetsStage(OffsetsConfig(active=True), capture.context))
    assert first
    for a, b, c in zip(first, again, other):
        assert a.device == b.device == c.device and shift(a, 10**10) == shift(b, 10**10) == shift(c, 10**10)


def test_a_camera_that_joins_late_leaves_the_others_known_and_in_step(capture):
    stage = OffsetsStage(OffsetsConfig(active=True, block_s=1.0), capture.context)
    late, begin = capture.rig.names[0], int(capture.ticks[0]) + 2_500_000_000
    models = []
    for item, tracked in zip(capture.sets, capture.tracked):
        views = [view for view in item.views if view.camera != late or view.stamp_ns > begin]
        for record in (*views, tracked):
            models += stage.step(record).outputs
    first = {m.device: m for m in models if m.reference_ns < begin - SECOND}
    last = {m.device: m for m in models}
    assert late not in first and late in last and len(first) >= 3
    end = int(capture.ticks[-1])
    for name, model in first.items():
        assert shift(last[name], end) == pytest.approx(shift(model, end), abs=4e-3)


def test_a_camera_that_is_lost_keeps_its_clock(capture):
    stage = OffsetsStage(OffsetsConfig(active=True, block_s=1.0, memory_s=2.0), capture.context)
    models, _ = run(capture, stage)
    last = {m.device: m for m in models}
    later = []
    for k in range(1, 40):
        stamp = int(capture.ticks[-1]) + k * SECOND
        nobody = replace(
            capture.tracked[0],
            stamp_ns=stamp,
            **{name: getattr(capture.tracked[0], name)[:0] for name in PER_PERSON},
        )
        later += stage.step(nobody).outputs
    for model in later:  # as long as they are known
        assert shift(model, stamp) == pytest.approx(shift(last[model.device], stamp), abs=5e-3)
    assert later and later[-1].reference_ns < stamp - 10 * SECOND


def test_of_many_cameras_some_frames_of_each_are_kept(capture, monkeypatch):
    monkeypatch.setattr(stage_module, "ALL_FRAMES", 2)  # so five cameras are many: a third of the frames
    models, _ = run(capture, OffsetsStage(OffsetsConfig(active=True), capture.context))
    last = {model.device: model for model in models}
    assert len(last) >= 4
    middle = int(capture.ticks[len(capture.ticks) // 2])
    errors = [shift(model, middle) - capture.offsets[capture.rig.index(name)] for name, model in last.items()]
    assert np.ptp(errors) < 3e-3


def test_known_delays_are_left_out_of_what_is_found(capture):
    delays = {name: round(1e3 * offset, 3) for name, offset in zip(capture.rig.names, capture.offsets)}
    config = OffsetsConfig(
        active=True, block_s=1.0, delays_ms=tuple(f"{name}={ms}" for name, ms in delays.items())
    )
    models, _ = run(capture, OffsetsStage(config, capture.context))
    end = int(capture.ticks[-1])
    for model in models:
        assert abs(shift(model, end)) < 3e-3  # the drifts


def test_off_by_default(capture):
    models, notices = run(capture, OffsetsStage(OffsetsConfig(), capture.context))
    assert models == notices == []


def test_resting_people_give_no_models(make_capture):
    still = make_capture(motion=0.0, offsets=np.zeros(5))
    models, notices = run(still, OffsetsStage(OffsetsConfig(active=True), still.context))
    assert models == notices == []


def test_bad_input_is_refused(capture):
    stage = OffsetsStage(OffsetsConfig(active=True), capture.context)
    with pytest.raises(DataError):
        stage.step(replace(capture.tracked[0], skeleton_hash="00000000"))
    with pytest.raises(DataError):
        stage.step(replace(capture.sets[0].views[0], camera="elsewhere"))
    with pytest.raises(ConfigError, match="nobody"):
        OffsetsStage(OffsetsConfig(trusted_camera="nobody"), capture.context)
