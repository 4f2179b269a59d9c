"""Linear timecode (LTC, SMPTE ST 12-1) from audio: labels and the exact instants they stand for.

In: `AudioBlock`s of one or several devices. Out: a `TimecodeReading` per word, with the fractional
sample at which it starts and a standard deviation.

How: clicks are bridged, a linear-phase high pass takes away DC and hum (`conditioning`); cell length and
phase are those that give the largest energy of half-cell integrals, with no decisions on the way
(`acquisition`). The words of a stretch are then judged together against labels that count on, by a two-
state Viterbi search over half cells, soft and free of polarity (`labels`) but for what the sync word before
each says of it (`levels`), and, as echoes of a room turn the same bits in all of them, through the linear
channel that explains them best (`echoes`). They are followed one by one against the label that must come next
(`following`, `decoder`), which is judged with the user bits of the words before and against the labels of the
frames beside (`evidence`): timecode that stands still must not count on. A word's start is a least-squares
fit of the known edge train to the samples (`timing`), with the shape of an edge and the droop of a coupling
capacitor learnt from the words (`edge_shape`) and the speed from the last ones (`pace`). The stated deviation
is what the scatter of edges and of words says, and what all edges of a word leave alike. A word that clicks
or noise contradict is reported only between others that do not; user bits are the last that were certain, 0
before (`user_bits`).
Loops are compiled (`kernels`, `fit_kernels`, `shape_kernels`, `line_kernels`, `click_kernels`); `cells` is
what they are tested against.

Limits: 23.976 to 30 fps at 0.78 to 1.27 times their speed, forwards and backwards, 8 to 96 kHz; down to
-6 dB of white noise over the band at 48 kHz and -3 dB at 16 kHz; speed changes of 3 % at 3 Hz need 15 dB
or so. Where the speed is so far off that the length of a word fits another rate, the rate (not the
label) is a guess until the frame count has wrapped once. A delay that all words share (echoes of a room, a
lopsided filter) is part of the start and not of its deviation.
"""
from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.stage import TimecodeStage
from panoptic_ros.timecode.whole_file import decode_recording

__all__ = ["TimecodeConfig", "TimecodeStage", "decode_recording"]
