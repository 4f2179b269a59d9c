"""Clicks are bridged, and nothing else."""

from __future__ import annotations

import numpy as np

from panoptic_ros.domain import Timecode
from panoptic_ros.simulation.ltc_signal import (
    encode_ltc,
    timecode_rate,
)
from panoptic_ros.timecode.signal.clicks import ClickLimits, bridge_clicks


def test_clicks_are_bridged_and_nothing_else() -> None:
    signal = encode_ltc(Timecode.from_frame_count(777, timecode_rate("25")), 3, 48000).samples.astype(float)
    limits = ClickLimits(reach=72, piece=600, share=0.8, most=2.4, longest=28)
    np.testing.assert_array_equal(bridge_clicks(signal, limits), signal)
    bad = signal.copy()
    bad[2000:2006] += 1.5
    bad[3333] -= 2.0
    clean = bridge_clicks(bad, limits)
    assert np.abs(clean).max() < 0.3
    changed = np.flatnonzero(clean != signal)
    assert set(changed) <= set(range(1998, 2008)) | set(range(3331, 3336))
