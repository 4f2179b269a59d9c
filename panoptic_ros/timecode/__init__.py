"""Linear timecode (LTC, SMPTE ST 12-1) from audio: labels and the exact instants they stand for.

In: `AudioBlock`s of one or several devices. Out: a `TimecodeReading` per word, with the fractional
sample at which it starts and a standard deviation.

How: a linear-phase high pass takes away DC and hum (`conditioning`); cell length and phase are those
that give the largest energy of half-cell integrals, with no decisions on the way (`acquisition`); bits
follow by a two-state Viterbi search, soft and free of polarity (`cells`); words are read at the
place where sync words repeat (`words`), then followed one by one (`decoder`). A word's start is a
least-squares fit of the known edge train to the samples (`timing`). A label is reported only if
consecutive words agree (`continuity`).

Limits: 23.976 to 30 fps at 0.78 to 1.27 times their speed, forwards and backwards, 8 to 96 kHz, about
10 dB of signal to noise. Where the speed is so far off that the length of a word fits another
rate, the rate (not the label) is a guess until the frame count has wrapped once.
"""
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.stage import TimecodeStage

__all__ = ["TimecodeConfig", "TimecodeStage"]
