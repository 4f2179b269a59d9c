"""The sound of a device as a stream of samples, and its clock."""

import numpy as np
import pytest

from panoptic_ros.domain import AudioBlock
from panoptic_ros.errors import DataError
from panoptic_ros.offsets.sound.listening import EDGES, SampleStream, band_energies, coarse_energies, cut

RATE = 8000


def blocks(samples, rate=RATE, start=0, step=700, ppm=0.0, lost=()):
    for k in range(0, len(samples), step):
        if k // step not in lost:
            stamp = start + round(1e9 * k / rate * (1.0 + 1e-6 * ppm))
            yield AudioBlock("mic", stamp, 100 + k, rate, samples[k : k + step])


def test_pieces_are_the_samples_with_silence_where_some_are_lost():
    samples = np.random.default_rng(0).uniform(-1, 1, (50_000, 2)).astype(np.float32)
    stream = SampleStream(blocks(samples, lost=(3, 4, 30)))
    found = np.concatenate(list(stream))
    for k in (3, 4, 30):
        samples[700 * k : 700 * (k + 1)] = 0.0
    assert np.array_equal(found, samples) and stream.count == 50_000


def test_cuts_are_the_same_from_a_stream_as_from_the_whole():
    samples = np.random.default_rng(1).uniform(-1, 1, (60_000, 1)).astype(np.float32)
    spans = [(-50, 400), (390, 900), (30_000, 34_000), (59_000, 61_000), (70_000, 70_010)]
    padded = np.pad(samples, ((50, 11_000), (0, 0)))
    found = list(cut(SampleStream(blocks(samples)), spans))
    assert all(np.array_equal(own, padded[50 + a : 50 + b]) for own, (a, b) in zip(found, spans, strict=True))


def test_coarse_energies_do_not_depend_on_how_sound_is_cut_into_blocks():
    samples = np.random.default_rng(2).uniform(-1, 1, (40_000, 1)).astype(np.float32)
    whole, cuts = (
        coarse_energies(SampleStream(blocks(samples, 22_050, step=step)), 100.0, 0.025)
        for step in (40_000, 333)
    )
    assert np.allclose(whole, cuts) and abs(len(whole) - 40_000 / 220.5) < 4


def test_a_tone_is_in_its_band_and_bands_beyond_the_rate_are_empty():
    tone = np.sin(2.0 * np.pi * 1000.0 * np.arange(RATE) / RATE).astype(np.float32)[:, None]
    energies = band_energies(tone, np.arange(10) * 400, 200, RATE)
    band = int(np.searchsorted(EDGES, 1000.0)) - 1
    assert (energies.argmax(axis=1) == band).all() and (energies[:, band] > 0.9 * energies.sum(axis=1)).all()
    assert (energies[:, EDGES[1:] > 0.47 * RATE] == 0.0).all()


def test_stamps_that_run_beside_the_samples_are_a_line_and_others_are_refused():
    samples = np.zeros((80_000, 1), np.float32)
    stream = SampleStream(blocks(samples, start=5_000_000_000, ppm=300.0))
    list(stream)
    time = stream.time()
    assert time.excess == pytest.approx(3e-4, rel=1e-3) and abs(time.start_ns - 5_000_000_000) < 1e5
    assert time.seconds == 10.0
    moved = list(blocks(samples))
    moved[60] = AudioBlock("mic", moved[60].stamp_ns + 10**9, moved[60].first_sample, RATE, moved[60].samples)
    stream = SampleStream(moved)
    list(stream)
    with pytest.raises(DataError, match="mic stray"):
        stream.time()


@pytest.mark.parametrize("change", ["back", "rate", "nothing"])
def test_blocks_that_do_not_follow_each_other_are_refused(change):
    one, two = list(blocks(np.zeros((1400, 1), np.float32)))
    bad = {
        "back": [two, one],
        "rate": [one, AudioBlock("mic", two.stamp_ns, two.first_sample, 16_000, two.samples)],
        "nothing": [],
    }[change]
    stream = SampleStream(bad)
    with pytest.raises(DataError):
        list(stream)
        stream.time()
