"""Heading and clock of IMUs from motion: exact from exact motion, sure only of what motion tells.

Sums over headings and offsets are those of turning and comparing one by one.
"""

from dataclasses import replace

import numpy as np
import pytest

from panoptic_ros.domain.subjects import ImuSeries
from panoptic_ros.geometry.rotations import turn_about_z
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.recorded_motions import read_clips
from panoptic_ros.kinematics.imus.alignment import OFFSETS_S, _valley, align, compare_turned, felt_of
from panoptic_ros.simulation.bodies.capture import BodyScene, simulate_body
from panoptic_ros.simulation.bodies.imus import ImuNoise, unknown_heading

NONE = ImuNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def take():
    scene = BodyScene(seconds=9.0, cameras=1, imus=NONE)
    return simulate_body(scene, 1, read_body_model(), read_clips())


def felt(take, heading=0.0, late_s=0.0, spoil=lambda series: series):
    moved = {
        name: unknown_heading(spoil(series), heading).shifted(round(1e9 * late_s))
        for name, series in take.devices.items()
    }
    return {name: felt_of(series, 60.0) for name, series in moved.items()}


def states(take, begin_s=3.0, seconds=5.0):
    first = take.stamps[0] + round(1e9 * begin_s)
    return [s for s in take.truth() if first <= s.stamp_ns <= first + round(1e9 * seconds)]


@pytest.mark.parametrize(("heading", "late_s"), [(2.5, 0.06), (-3.1, -0.093), (0.4, 0.0)])
def test_exact_motion_tells_heading_and_clock_exactly(take, heading, late_s):
    subject = replace(take.subject, heading_known=False)
    found = align(subject, states(take), felt(take, heading, late_s))
    off = (found.heading - heading + np.pi) % (2 * np.pi) - np.pi
    assert abs(np.degrees(off)) < 0.6 and abs(found.offset + late_s) < 0.002
    assert found.enough and found.late == (late_s != 0.0)


def test_a_known_heading_is_not_looked_for(take):
    found = align(take.subject, states(take), felt(take, 0.0, -0.05))
    assert found.heading == 0.0 and abs(found.offset - 0.05) < 0.002


def test_somebody_who_stands_still_tells_no_heading(take):
    subject = replace(take.subject, heading_known=False)
    assert align(subject, states(take, 0.0, 1.8), felt(take, 1.0)) is None


def test_gaps_of_a_device_are_left_out(take):
    def gappy(series):
        there = np.ones(len(series.stamps), bool)
        there[250:300] = there[400:430] = False
        return ImuSeries(*(part[there] for part in vars(series).values()))

    subject = replace(take.subject, heading_known=False)
    found = align(subject, states(take), felt(take, 1.0, 0.03, gappy))
    assert abs(np.degrees(found.heading - 1.0)) < 0.6 and abs(found.offset + 0.03) < 0.002


def test_devices_without_orientation_tell_nothing(take):
    def bare(series):
        return replace(series, quaternions=np.full_like(series.quaternions, np.nan))

    subject = replace(take.subject, heading_known=False)
    assert align(subject, states(take), felt(take, 1.0, 0.03, bare)) is None


def test_a_rough_bottom_says_no_more_than_it_is_wide():
    rng, wide = np.random.default_rng(4), 0.012
    for place in rng.uniform(-0.05, 0.05, size=20):
        rough = rng.normal(0.0, 0.7, len(OFFSETS_S))
        found, unsure = _valley(OFFSETS_S, 0.5 * ((OFFSETS_S - place) / wide) ** 2 + rough)
        assert 0.6 * wide < unsure < 1.7 * wide and abs(found - place) < wide
    assert _valley(OFFSETS_S, rng.normal(0.0, 0.7, len(OFFSETS_S)))[1] == np.inf


@pytest.mark.parametrize("heading", [0.0, 1.1, -2.7])
def test_sums_are_those_of_turned_vectors(heading):
    rng = np.random.default_rng(2)
    when, stamps = np.cumsum(rng.integers(5, 20, size=60)), np.arange(100, 400, 17)
    vectors, goals = rng.normal(size=(60, 3)), rng.normal(size=(len(stamps), 3))
    vectors[30:33] = np.nan
    halves = rng.normal(size=(len(stamps), 3, 3))
    information, offsets = halves @ halves.swapaxes(1, 2), np.array([-40.0, 0.0, 12.5])
    turn, found = np.array([np.cos(heading), np.sin(heading)]), []
    for offset in offsets:
        there = np.stack([np.interp(stamps - offset, when, vectors[:, j]) for j in range(3)], axis=-1)
        known = np.isfinite(there).all(-1)
        left = (goals - there @ turn_about_z(heading).T)[known]
        found.append((np.einsum("ti,tij,tj->", left, information[known], left), known.sum()))
    seen = stamps, goals, information
    matrices, pulls, constants, numbers = compare_turned((when, vectors), seen, offsets)
    sums = turn @ matrices @ turn - 2.0 * pulls @ turn + constants
    assert sums == pytest.approx([total for total, _ in found]) and (numbers == [n for _, n in found]).all()
