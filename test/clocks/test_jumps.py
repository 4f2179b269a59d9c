"""What jumps, and what runs on: clocks, timecode, sample counters, midnight, devices that stop or swap."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from panoptic_ros.clocks.config import ClocksConfig
from panoptic_ros.clocks.stage import ClocksStage
from panoptic_ros.domain import ClockModel, FrameRate, Timecode, TimecodeReading

PAL = FrameRate(25, Fraction(25))
DROP = FrameRate(30, Fraction(30000, 1001), True)
EPOCH = 1_700_000_000_000_000_000
SECOND = 10**9
DAY = {PAL: 24 * 3600 * 25, DROP: 24 * 107_892}


class World:
    """Devices that hear timecode; `true_ns` is the time since the start of the generator.

    Every reading is a step of (true time, device stamp), so that errors are known exactly.
    """

    def __init__(self, rate=PAL, first=1000, **config):
        self.rate, self.first, self.stage = rate, first, ClocksStage(ClocksConfig(**config))
        self.label_shift, self.models, self.notices, self.clock = 0, {}, [], {}
        self.given = []

    def device(self, name, offset_ns=EPOCH, drift=0.0, samples=0.0):
        self.clock[name] = [offset_ns, drift, samples]

    def stamp(self, name, true_ns):
        offset, drift, _ = self.clock[name]
        return offset + round(true_ns * (1 + drift))

    def hear(self, name, start_s, end_s, jitter=None):
        for k in range(round(start_s * self.rate.exact), round(end_s * self.rate.exact)):
            true_ns = round(k * SECOND / self.rate.exact)
            label = Timecode.from_frame_count(self.first + k + self.label_shift, self.rate)
            sample = self.clock[name][2] + true_ns * 48e-6
            late = 0 if jitter is None else round(SECOND * jitter())
            item = TimecodeReading(name, self.stamp(name, true_ns) + late, label, sample, 0.01)
            result = self.stage.step(item)
            for model in result.outputs:
                self.models[model.device] = model
                self.given.append((true_ns, model))
            self.notices += [(n.code, n.values["device"]) for n in result.notices]

    def hear_all(self, names, start_s, end_s):
        for k in range(round(start_s * 10), round(end_s * 10)):
            for name in names:
                self.hear(name, k / 10, (k + 1) / 10)

    def error(self, name, true_s, shift_s=0.0):
        """Master time of the newest model less the truth, s."""
        true_ns = round(true_s * SECOND)
        master = self.models[name].master_from_device(self.stamp(name, true_ns))[0]
        truth = (self.first / self.rate.exact) * SECOND + true_ns
        return float(master - truth) / SECOND - shift_s


@pytest.mark.parametrize("step", [0.25, -0.4, 3600.0, -86_400.0, 0.003])
def test_a_clock_that_jumps_has_a_new_line_within_a_quarter_of_a_second(step):
    world = World()
    world.device("cam", drift=30e-6)
    world.hear("cam", 0, 10)
    assert abs(world.error("cam", 10)) < 1e-6
    world.clock["cam"][0] += round(step * SECOND)
    world.hear("cam", 10, 10.25)
    assert world.notices == [("clocks.jump", "cam")]
    assert world.models["cam"].segment == 1
    assert abs(world.error("cam", 10.25)) < 1e-6
    world.hear("cam", 10.25, 40)
    assert world.notices == [("clocks.jump", "cam")]
    assert abs(world.error("cam", 40)) < 1e-6


@pytest.mark.parametrize("at", [0.4, 5.0])
@pytest.mark.parametrize("step", [-0.005, 0.001, 0.3, -86_400.0])
def test_a_clock_that_jumps_in_its_first_second(at, step):
    """Before there is a model; also by exactly a day, after which labels are the same."""
    world = World()
    world.device("cam")
    world.hear("cam", 0, at)
    world.clock["cam"][0] += round(step * SECOND)
    world.hear("cam", at, at + 1.5)
    assert world.notices == [("clocks.jump", "cam")] and world.models["cam"].segment == 1
    assert abs(world.error("cam", at + 1.5)) < 1e-6


@pytest.mark.parametrize("frames", [1, -5, 90_000])
@pytest.mark.parametrize("step", [0.41, -3600.0, 86_400.0, -86_400.0])
def test_the_timecode_and_a_clock_that_jump_together(step, frames):
    world = World()
    for name in "abc":
        world.device(name, drift=1e-5)
    world.hear_all("abc", 0, 5)
    world.label_shift = frames
    world.clock["a"][0] += round(step * SECOND)
    world.hear_all("abc", 5, 8)
    assert [abs(world.error(name, 8)) < 1e-5 for name in "abc"] == [True] * 3
    assert sorted(world.notices) == [("clocks.jump", "a"), *(("clocks.timecode_jump", n) for n in "bc")]


def test_a_clock_that_jumps_twice_and_is_silent_between():
    world = World()
    for name in "ab":
        world.device(name)
    world.hear_all("ab", 0, 3)
    world.clock["a"][:] = [EPOCH - 3770 * SECOND, 1e-5, 7e5]
    world.hear_all("ab", 3, 3.2)
    world.clock["a"][:] = [EPOCH - 90_000 * SECOND, 1e-5, 7e5]
    world.hear_all("b", 3.2, 8)
    world.hear_all("ab", 8, 11)
    assert [code for code, name in world.notices if name == "a"].count("clocks.jump") == 1
    assert abs(world.error("a", 11)) < 1e-5 and abs(world.error("b", 11)) < 1e-6


def test_a_device_that_was_off_for_a_night_counts_its_days():
    world = World()
    world.device("cam")
    world.hear("cam", 0, 3)
    world.hear("cam", 50_400, 50_403)
    assert world.notices == [] and abs(world.error("cam", 50_403)) < 1e-6


def test_master_time_runs_on_where_the_timecode_jumps_for_all():
    world = World()
    for name, drift in (("a", 5e-5), ("b", -5e-5)):
        world.device(name, drift=drift)
    world.hear_all("ab", 0, 8)
    world.label_shift = 3
    world.hear_all("ab", 8, 12)
    assert sorted(world.notices) == [("clocks.timecode_jump", "a"), ("clocks.timecode_jump", "b")]
    for name in "ab":
        assert abs(world.error(name, 12)) < 1e-6 and world.models[name].segment == 0
    for true_ns, model in world.given:
        truth = (world.first / PAL.exact) * SECOND + true_ns
        stamp = world.stamp(model.device, true_ns)
        assert abs(float(model.master_from_device(stamp)[0] - truth)) < 2e3
    world.device("late", offset_ns=17)
    world.hear_all(["a", "b", "late"], 12, 15)
    assert abs(world.error("late", 15)) < 1e-6


def test_a_device_that_was_off_while_the_timecode_jumped_follows_the_others():
    world = World()
    for name in "ab":
        world.device(name, samples=1e5)
    world.hear_all("ab", 0, 5)
    world.hear_all("a", 5, 8)
    world.label_shift = -2
    world.hear_all("a", 8, 12)
    world.clock["b"][2] = -12 * 48_000.0  # its count of samples began anew
    world.hear_all("ab", 12, 16)
    assert abs(world.error("a", 16)) < 1e-6 and abs(world.error("b", 16)) < 1e-6
    assert world.notices.count(("clocks.silent", "b")) == 1
    assert not [n for n in world.notices if n[0] == "clocks.jump"]


@pytest.mark.parametrize("rate", [PAL, DROP])
def test_midnight_with_and_without_a_generator_set_anew(rate):
    for rejam in (0, 3, -3):
        world = World(rate, first=DAY[rate] - round(5 * rate.exact))
        world.device("a")
        world.device("b", drift=2e-5)
        world.hear_all("ab", 0, 5)
        world.label_shift = rejam
        world.hear_all("ab", 5, 9)
        assert {code for code, _ in world.notices} == ({"clocks.timecode_jump"} if rejam else set())
        for name in "ab":
            assert abs(world.error(name, 9)) < 1e-6
        world.device("after midnight", drift=-3e-5)
        world.hear_all(["a", "after midnight"], 9, 12)
        assert abs(world.error("after midnight", 12)) < 1e-6


def test_a_device_that_stops_and_resumes_stays_on_its_line():
    world = World()
    world.device("cam", drift=40e-6)
    world.hear("cam", 0, 20)
    error_before = world.error("cam", 80)
    _, std = world.models["cam"].master_from_device(world.stamp("cam", 80 * SECOND))
    assert abs(error_before) < 3e-9 * std and 2e4 < std < 1e5  # half a ppm of wander
    world.hear("cam", 80, 80.5)
    assert world.notices == [] and abs(world.error("cam", 80.5)) < 2e-6


def test_two_devices_that_swap():
    world = World()
    world.device("a", offset_ns=EPOCH, drift=3e-5)
    world.device("b", offset_ns=5 * SECOND, drift=-4e-5, samples=7e6)
    world.hear_all("ab", 0, 6)
    world.clock["a"], world.clock["b"] = world.clock["b"], world.clock["a"]
    world.hear_all("ab", 6, 8)
    assert sorted(world.notices) == [("clocks.jump", "a"), ("clocks.jump", "b")]
    world.hear_all("ab", 8, 12)
    for name in "ab":
        assert abs(world.error(name, 12)) < 2e-6


def test_lost_words_and_lost_samples_change_nothing():
    world = World()
    world.device("cam", drift=1e-5)
    world.hear("cam", 0, 5)
    world.hear("cam", 5.5, 8)
    world.clock["cam"][2] -= 1024  # an overrun that the driver did not tell
    world.hear("cam", 8.2, 12)
    assert world.notices == [] and abs(world.error("cam", 12)) < 1e-6


def test_one_way_stamps_do_not_pull_the_line_with_their_mean_delay():
    rng = np.random.default_rng(2)
    world = World()
    world.device("cam", drift=4e-5)
    world.hear("cam", 0, 30, lambda: rng.gamma(2.0, 7e-4) + (rng.random() < 0.05) * rng.uniform(2e-3, 25e-3))
    model = world.models["cam"]
    assert abs(world.error("cam", 30)) < 3e-4  # the mean delay is 2 ms
    assert abs(world.error("cam", 30)) < 4e-9 * model.master_from_device(world.stamp("cam", 30 * SECOND))[1]
    assert not world.notices


def test_noise_that_begins_does_not_starve_a_line():
    rng = np.random.default_rng(3)
    world = World()
    world.device("cam")
    world.hear("cam", 0, 10)
    world.hear("cam", 10, 14, lambda: rng.uniform(-8e-3, 8e-3))
    assert [code for code, _ in world.notices] == ["clocks.noisy"]
    assert world.models["cam"].until_ns > world.stamp("cam", 12 * SECOND)
    assert abs(world.error("cam", 14)) < 3e-3


def test_delays_of_devices_are_taken_off():
    world = World(delays_ms=("cam=12.5", "*=1"))
    for name in ("cam", "other"):
        world.device(name)
        world.hear(name, 0, 4)
    assert world.error("cam", 4) == pytest.approx(0.0125, abs=1e-7)
    assert world.error("other", 4) == pytest.approx(0.001, abs=1e-7)


def test_two_generators_do_not_move_each_other():
    world = World()
    world.device("a")
    other = World(first=900_000)
    other.stage = world.stage
    other.device("b")
    for k in range(40):
        world.hear("a", k / 10, (k + 1) / 10)
        other.hear("b", k / 10, (k + 1) / 10)
    world.label_shift = 5
    for k in range(40, 80):
        world.hear("a", k / 10, (k + 1) / 10)
        other.hear("b", k / 10, (k + 1) / 10)
    assert abs(world.error("a", 8)) < 1e-6 and abs(other.error("b", 8)) < 1e-6
    assert other.notices == []


@pytest.mark.parametrize(("speed", "given"), [(29.97 / 25, False), (1 / 1.001, True), (1.0, True)])
def test_timecode_of_another_rate_than_it_says_is_told_once_and_no_clock(speed, given):
    world = World()
    world.device("a", drift=1 / speed - 1)
    world.device("b")
    world.hear_all("ab", 0, 12)
    assert world.notices == ([] if speed == 1.0 else [("clocks.timecode_rate", "a")])
    assert ("a" in world.models) == given and abs(world.error("b", 12)) < 1e-6


def test_a_rate_that_turns_out_to_be_another_begins_anew():
    world = World(FrameRate(30, Fraction(30000, 1001)), first=100_000)
    world.device("cam")
    wrong = FrameRate(30, Fraction(30))
    for k in range(10):
        label = Timecode.from_frame_count(100_000 + k, wrong)
        stamp = world.stamp("cam", round(k * SECOND / world.rate.exact))
        world.stage.step(TimecodeReading("cam", stamp, label, k * 1601.6, 0.01))
    world.hear("cam", 10 / world.rate.exact, 3)
    assert world.notices == [("clocks.rate", "cam")]
    assert abs(world.error("cam", 3)) < 1e-6 and abs(world.models["cam"].drift) < 1e-7


def test_models_state_where_they_were_observed():
    world = World()
    world.device("cam")
    world.hear("cam", 0, 3)
    model = world.models["cam"]
    assert isinstance(model, ClockModel) and model.from_ns == EPOCH and model.wander == pytest.approx(5e-7)
    assert EPOCH + 2 * SECOND <= model.until_ns <= EPOCH + 3 * SECOND
    assert replace(model, wander=0.0).master_from_device(model.until_ns)[1] < 1e3


def test_a_device_that_was_off_while_both_its_clock_and_the_timecode_jumped():
    world = World()
    for name in "ab":
        world.device(name, drift=2e-5)
    world.hear_all("ab", 0, 5)
    world.label_shift = -1500
    world.hear_all("a", 5, 8)
    world.clock["b"][0] += 40_000 * SECOND
    world.hear_all("ab", 8, 10)
    assert abs(world.error("a", 10)) < 2e-6 and abs(world.error("b", 10)) < 2e-6


@pytest.mark.parametrize("seed", range(12))
def test_whatever_happens_every_device_has_a_right_line_again_soon(seed):
    rng = np.random.default_rng(seed)
    world = World([PAL, DROP][seed % 2], first=int(rng.integers(0, DAY[[PAL, DROP][seed % 2]])))
    for name in "ab":
        world.device(name, int(rng.integers(10**14, EPOCH)), rng.uniform(-5e-5, 5e-5), rng.uniform(0, 1e6))
    world.hear_all("ab", 0, 3)
    now = 3.0
    for _ in range(3):
        event, name = rng.integers(0, 5), "ab"[rng.integers(2)]
        if event == 0:
            step = rng.choice([0.05, -0.05, 1.0, -1.0, 100, -100, 40_000, -40_000])
            world.clock[name][0] += round(SECOND * step)
        elif event == 1:
            world.label_shift += int(rng.integers(-5000, 5000))
        elif event == 2:
            world.clock[name][2] -= rng.uniform(0, 3e5)
        elif event == 3:
            world.clock["a"], world.clock["b"] = world.clock["b"], world.clock["a"]
        else:
            now = round(now + rng.uniform(0, 100), 1)
        world.hear_all("ab", now, now + 2)
        now += 2
    for name in "ab":
        model = world.models[name]
        assert world.stamp(name, round(now * SECOND)) - model.until_ns < 1.1 * SECOND
        assert abs(model.drift + world.clock[name][1]) < 3e-6
    assert abs(world.error("a", now) - world.error("b", now)) < 1e-5
