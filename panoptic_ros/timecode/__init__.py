"""Decode linear timecode (LTC, SMPTE ST 12-1) from audio, and time each word to a fraction of a sample.

Input: `AudioBlock`s of one or several devices. Output: one `TimecodeReading` per word, with the fractional
sample at which the word starts and its standard deviation.

Terms: a word is the 80-bit LTC codeword of one frame, and a cell is the duration of one of its bits. A tick
is the boundary of a half cell. A label is the time in a word: hours, minutes, seconds, frames. A counting is
a sequence of consecutive labels. Stopped timecode repeats one label.

`decoder` describes the whole method on one page. It uses four subpackages. Each of them imports only those
listed before it:

* `signal`: bridges clicks. A linear-phase high-pass filter then removes DC and hum (`conditioning`).
* `word`: turns a stretch of signal into the 80 bits of a word. At constant speed, cell length and phase are
  those that maximise the energy of the half-cell integrals (`acquisition`). No bits are decided in that step.
  Where the speed changes, half cells are tracked edge by edge (`tracking`). A two-state Viterbi search over
  half cells gives soft bits (`viterbi`). It does not depend on polarity, except for the sync word before each
  word. A least-squares fit to the edges of the decoded bits gives the start of a word (`edges`). The fit is a
  line, or a polynomial where the speed changes. The scatter of the edges gives the standard deviation of the
  start.
* `label`: turns words into consecutive labels. All words of a stretch are judged together against consecutive
  labels (`stretch`). Room echoes flip the same bits in every word, so a linear channel must also explain the
  labels. Later words are judged against the label expected next (`evidence`). They must also fit better than
  the labels of the neighbouring frames, so that stopped timecode is not read as counting. User bits of
  earlier words are assumed in that test. A word that clicks or noise contradict is reported only if the words
  around it are not contradicted. The reported user bits are the last certain ones, or 0 before any are
  certain.
* `follow`: reads one word after another (`reading`). The speed of the last words predicts where the next word
  begins (`following`). While the speed changes, the next word is tracked instead (`wander`).

All inner loops are compiled with `kernels`.

Limits:

* Frame rates 23.976 to 30 fps at 0.78 to 1.27 times nominal speed, forwards and backwards.
* Sample rates 8 to 96 kHz.
* SNR at constant speed: at least -6 dB (white noise over the band) at 48 kHz, and -3 dB at 16 kHz.
* SNR at changing speed: at least about 6 dB at 48 kHz, and about 9 dB at 16 kHz.
* If the speed error makes the word length fit another rate, the rate is a guess until the frame count has
  wrapped once. The label is not affected.
* A delay that all words share (room echoes, an asymmetric filter) shifts the start. The standard deviation
  does not include it.
"""
