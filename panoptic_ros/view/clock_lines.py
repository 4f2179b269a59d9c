"""Text lines that report clock offsets estimated from motion or from sound."""

from __future__ import annotations

import numpy as np

from panoptic_ros.continuous.motion_result import ContinuousMotion
from panoptic_ros.offsets.clocks import CameraClocks
from panoptic_ros.offsets.sound import SoundClockEstimate

AIR = 3.0  # gate, in standard deviations of the difference, beyond which motion and sound offsets contradict


def clock_lines(clocks: CameraClocks) -> list[str]:
    """Return text lines with the offset and drift of every camera, estimated from motion."""
    width = max(len(name) for name in clocks.cameras)
    lines = ["clocks from motion (to be added to the stamps):"]
    for c, name in enumerate(clocks.cameras):
        offset, deviation = 1e3 * clocks.offsets[c], 1e3 * clocks.deviations[c]
        drift, wobble = 1e6 * clocks.drifts[c], 1e6 * clocks.drift_deviations[c]
        if not clocks.known[c]:
            text = f"unknown ({deviation:.0f} ms at best): too little motion in its view; stamps kept"
        elif clocks.applied[c]:
            text = f"{offset:+8.2f} ms +- {deviation:.2f}   drift {drift:+4.0f} ppm +- {wobble:.0f}"
        else:
            text = f"{offset:+8.2f} ms +- {deviation:.2f}   no more than chance; stamps kept"
        lines.append(f"  {name:<{width}}  {text}")
    for name, far in zip(clocks.cameras, clocks.strays):
        if far > 0.0:
            lines.append(f"  {name} strays from this by up to {1e3 * far:.0f} ms: does its clock jump?")
    if not clocks.known.any():
        lines.append("  too little motion to compare the clocks; let a person walk about for 5 s")
    if clocks.bias > 0.0:
        bias = f"{1e3 * clocks.bias:.0f} mm"
        lines.append(f"  2D joints are {bias} off for seconds on end; the deviations include it")
    if not clocks.converged:
        lines.append(f"  the estimate still moved after {clocks.iterations} iterations; trust it less")
    return lines


def sound_lines(found: SoundClockEstimate) -> list[str]:
    """Return text lines with the offset and drift of every camera, estimated from sound."""
    clocks = found.clocks
    width = max(len(name) for name in clocks.cameras)
    lines = ["clocks from sound (to be added to the stamps):"]
    offsets, deviations = clocks.stated_at(found.middles_ns)
    for c, name in enumerate(clocks.cameras):
        offset, deviation = offsets[c], 1e3 * deviations[c]
        shown = f"{1e3 * offset:+11.2f} ms" if abs(offset) < 1.0 else f"{offset:+11.4f} s "
        if not clocks.known[c]:
            text = f"not known: {found.unknown.get(name, '')}; stamps kept"
        elif offset == 0.0 and deviation == 0.0:
            text = "its stamps are kept, the others count from them"
        elif clocks.applied[c]:
            drift, wobble = 1e6 * clocks.drifts[c], 1e6 * clocks.drift_deviations[c]
            text = f"{shown} +- {deviation:.1f} ms   drift {drift:+4.0f} ppm +- {wobble:.0f}"
        else:
            text = f"{shown} +- {deviation:.1f} ms   no more than chance; stamps kept"
        lines.append(f"  {name:<{width}}  {text}")
    if clocks.known.any():
        place = "where the rig has the cameras" if found.placed else "up to --apart from each other"
        lines.append(
            f"  sound takes {1e3 * found.apart_s:.0f} ms between microphones {place}; the deviations allow "
            "for it"
        )
    return lines


def pair_lines(found: SoundClockEstimate) -> list[str]:
    """Return one text line about each camera pair."""
    lines = []
    for pair in found.pairs:
        what = f"agree in {pair.clear} of {pair.windows} windows of 2 s"
        if not pair.linked:
            what = f"not compared: {pair.why}" if pair.why else "not compared"
        elif pair.why and not pair.clear:
            what = f"linked by others only: {pair.why}"
        lines.append(f"  {pair.first} and {pair.second}: {what}")
    return lines


def contradictions(sound: SoundClockEstimate, motion: CameraClocks) -> list[str]:
    """Return warnings about cameras whose motion offset contradicts their sound offset.

    Args:
        sound: Clocks estimated from sound.
        motion: Clocks estimated from motion, on timestamps already corrected by `sound`.
    """
    known = sound.clocks.known & motion.known
    if known.sum() < 2:
        return []
    count, gauge = len(known), np.eye(int(known.sum())) - 1.0 / known.sum()
    pick = np.ix_(np.flatnonzero(known), np.flatnonzero(known))
    joint = sound.clocks.covariance[:count, :count][pick] + motion.covariance[:count, :count][pick]
    both = np.zeros(count)
    both[known] = np.sqrt(np.maximum(np.diag(gauge @ joint @ gauge), 0.0))
    beside = motion.offsets - np.median(motion.offsets[known])
    return [
        (
            f"  the clock of {name} from motion is {1e3 * beside[c]:+.0f} ms off that from sound, with an "
            f"uncertainty of {1e3 * both[c]:.0f} ms: do its images come later than its sound?"
        )
        for c, name in enumerate(sound.clocks.cameras)
        if known[c] and abs(beside[c]) > AIR * both[c]
    ]


def camera_time_lines(motion: ContinuousMotion, clocks: bool, lines: bool) -> list[str]:
    """Return one line per camera: clock offset, drift and line delay with standard deviations.

    Args:
        clocks, lines: which of them were estimated.
    """
    texts = []
    for c, name in enumerate(motion.cameras):
        offset, drift, line = motion.clocks.values[:, c]
        known, steady, rolled = motion.clocks.observable[:, c]
        offset_sd, drift_sd, line_sd = motion.clocks.deviations[:, c]
        parts = []
        if clocks and known:
            parts.append(f"{1e3 * offset:+.2f} ms +- {1e3 * offset_sd:.2f}")
            drifting = f"{1e6 * drift:+.0f} ppm +- {1e6 * drift_sd:.0f}"
            parts.append(drifting if steady else "drift not observable")
        elif clocks:
            parts.append("clock not observable, stamps kept")
        if lines and rolled:
            parts.append(f"{1e6 * line:.1f} us per row +- {1e6 * line_sd:.1f}")
        elif lines:
            parts.append("line delay not observable")
        texts.append(f"{name}: {', '.join(parts)}")
    if not motion.clocks.observable.all():
        texts.append("not observable: too little motion in the views, or too short a recording")
    return texts
