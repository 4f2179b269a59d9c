"""Sound in simulated rooms: the way takes its time, echoes fall as they should, clocks run as they say."""

import numpy as np
import pytest

from panoptic_ros.simulation.room_sound import (
    SPEED_OF_SOUND,
    AcousticRoom,
    DrySound,
    SimulatedRecorder,
    record,
)
from panoptic_ros.simulation.voices import RATE, clap, talk

SOURCE = np.array([2.0, 2.5, 1.5])


@pytest.mark.parametrize("far", [0.5, 2.0, 4.0])
def test_the_direct_sound_comes_first_after_its_way_and_as_loud_as_its_distance_says(far):
    room = AcousticRoom((7.0, 6.0, 3.0), 0.3)
    response = room.response(SOURCE, SOURCE + [far, 0.0, 0.0], np.random.default_rng(0))
    at = far / SPEED_OF_SOUND * RATE
    near = slice(max(0, round(at) - 2), round(at) + 3)
    assert np.abs(response[: max(0, round(at) - 20)]).max(initial=0.0) < 0.05 / far
    assert np.abs(response[near]).max() == pytest.approx(1.0 / far, rel=0.4)


@pytest.mark.parametrize("seconds", [0.3, 0.8])
def test_echoes_fall_by_sixty_decibels_in_the_reverberation_time(seconds):
    room, microphone = AcousticRoom((7.0, 6.0, 3.0), seconds), np.array([5.5, 4.0, 1.2])
    response = room.response(SOURCE, microphone, np.random.default_rng(1))
    left = np.cumsum(response[::-1] ** 2)[::-1]  # Schroeder's backward integral
    level = 10.0 * np.log10(left / left[0])
    time = np.arange(len(level)) / RATE
    falls = (level < -5.0) & (level > -25.0)
    slope = np.polyfit(time[falls], level[falls], 1)[0]
    assert -60.0 / slope == pytest.approx(seconds, rel=0.25)


def test_a_recorder_hears_by_its_own_clock():
    burst = clap(np.random.default_rng(2))
    sound = DrySound(SOURCE, [(30.0, burst)])
    quiet = AcousticRoom((7.0, 6.0, 3.0), 0.05)
    recorder = SimulatedRecorder((2.0, 2.5, 1.9), 44_100, begin_s=1.0, clock_s=77.0, drift=1e-4, snr_db=40.0)
    samples = record(quiet, [sound], recorder, 32.0, (1,))
    peak = int(np.abs(samples).argmax()) / 44_100
    heard = 30.0 + 0.4 / SPEED_OF_SOUND + float(np.abs(burst).argmax()) / RATE
    assert recorder.clock_s + peak == pytest.approx(recorder.stamp_s(heard), abs=5e-4)
    assert len(samples) == 32 * 44_100 and samples.dtype == np.float32 and np.abs(samples).max() <= 0.5


def test_noise_is_as_loud_as_asked_and_talk_has_pauses():
    speech = talk(np.random.default_rng(3), 4.0)
    assert np.sqrt(np.mean(speech**2)) == pytest.approx(1.0)
    loud = np.sqrt(np.mean(speech[: len(speech) // 800 * 800].reshape(-1, 800) ** 2, axis=1))
    assert np.quantile(loud, 0.1) < 0.2 * np.quantile(loud, 0.9)
    recorder = SimulatedRecorder((3.0, 2.5, 1.5), RATE, snr_db=0.0)
    sound = [DrySound(SOURCE, [(0.5, speech)])]
    clean, noisy = (
        record(AcousticRoom(), sound, SimulatedRecorder(recorder.place, RATE, snr_db=db), 5.0, (4,))
        for db in (60.0, 0.0)
    )
    assert np.corrcoef(clean, noisy)[0, 1] == pytest.approx(np.sqrt(0.5), abs=0.05)
