"""Linear timecode (LTC, SMPTE ST 12-1) from audio: labels, and the exact instants that they stand for.

In: `AudioBlock`s of one or several devices. Out: a `TimecodeReading` per word, with the fractional
sample at which it starts and a standard deviation.

`decoder` is the method on one page. It uses four rooms, each of which knows only those before it:

* `signal`: clicks are bridged, a linear-phase high pass takes DC and hum away (`conditioning`).
* `word`: cell length and phase are those with the largest energy of half-cell integrals, with no decisions
  on the way (`acquisition`); where the speed changes, half cells are followed edge by edge (`tracking`).
  Bits come from a two-state Viterbi search over half cells, which is soft and free of polarity but for what
  the sync word before each says of it (`viterbi`). A word's start is a least-squares fit of a line, or of a
  polynomial where the speed changes, to its known edges. The scatter of the edges gives its deviation
  (`edges`).
* `label`: the words of a stretch are judged together against labels that count on (`stretch`). Echoes of a
  room turn the same bits in all words, so labels must also be explained by a linear channel.
  Later words are judged against the label that must come next, with the user bits of the words before and
  against the labels of the frames beside (`evidence`): timecode that stands still must not count on. A word
  that clicks or noise contradict is reported only between others that do not. User bits are the last that
  were certain, 0 before.
* `follow`: words are read one by one (`reading`), each where the speed of the last words predicts it
  (`following`), or where it is tracked while the speed changes (`wander`).

Loops are compiled (`kernels`).

Limits: 23.976 to 30 fps at 0.78 to 1.27 times their speed, forwards and backwards, 8 to 96 kHz; down to
-6 dB of white noise over the band at 48 kHz and -3 dB at 16 kHz; speeds that change need 6 dB at 48 kHz
and 9 dB at 16 kHz or so. Where the speed is so far off that the length of a word fits another rate, the rate
(not the label) is a guess until the frame count has wrapped once. A delay that all words share (echoes of a
room, a lopsided filter) is part of the start and not of its deviation.
"""

from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.recording import decode_recording
from panoptic_ros.timecode.stage import TimecodeStage

__all__ = ["TimecodeConfig", "TimecodeStage", "decode_recording"]
