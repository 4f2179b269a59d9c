"""Decode the words in the samples of one device. This module shows the method from end to end.

1. Process the stream in hops of fixed length, so that words do not depend on the block size. Condition each
   hop: bridge clicks, then filter DC and hum (`signal`).
2. Search while no signal is locked: find the cell length and phase of maximum energy, the direction and the
   sync word position (`word.acquisition`). Lock to the signal if its labels are consecutive (`follow.lock`,
   `label.stretch`). Track the signal where its speed changes (`word.tracking`).
3. Judge each word against the next expected label, at the start that the last words predict
   (`follow.reading`). Then fit the word's edges to time it (`word.edges`).
4. Hold words back until one of them rules out the neighbouring labels. Then report them.
5. Drop the signal and all held words after `lost_words` unreadable words, so that noise cannot corrupt later
   words. Continue with step 2.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.follow.following import SignalTracker
from panoptic_ros.timecode.follow.lock import lock
from panoptic_ros.timecode.follow.reading import Word, read_word, word_complete
from panoptic_ros.timecode.signal.stream import Hops, Stream
from panoptic_ros.timecode.word.acquisition import CHANGING, LONG, SHORT, acquire

Array = np.ndarray
HOP_SECONDS = 0.1  # s, length of one hop
TURNS = ((SHORT, CHANGING), (LONG, CHANGING))  # searches tried at a hop; hops alternate between the two rows


class LtcDecoder:
    """Decoder of the timecode words in one uninterrupted stream of samples."""

    def __init__(self, config: TimecodeConfig, sample_rate: int):
        self._config = config
        self._hop = int(HOP_SECONDS * sample_rate)
        self._hops = Hops(self._hop)
        self._stream = Stream(sample_rate, config.high_pass_hz)
        self._follow: SignalTracker | None = None  # locked signal; None while searching
        # words read but not reported: no later word has ruled out the neighbouring labels
        self._held: list[Word] = []
        self._read_until = -np.inf  # samples, end of the last reported word
        self._searches = 0

    def push(self, samples: Array) -> list[Word]:
        """Return the words that samples (N,) completed."""
        return [word for hop in self._hops.push(samples) for word in self._work(hop)]

    def finish(self) -> list[Word]:
        """Return the words completed by the end of the stream."""
        return self._work(self._hops.finish(self._stream.delay + self._hop), last=True)

    def _work(self, samples: Array, last: bool = False) -> list[Word]:
        self._stream.append(samples)
        if self._follow is None:
            self._follow = self._search(last)
        words: list[Word] = []
        while self._follow is not None and word_complete(self._follow, self._stream):
            words += self._next_word(self._follow)
        self._stream.forget()
        return words

    def _search(self, last: bool) -> SignalTracker | None:
        """Search for a signal and lock to it: just after its start, in noise, or at changing speed.

        Returns: the locked signal, or None if none is found.
        """
        self._searches += 1
        stream, config = self._stream, self._config
        for search in (SHORT, LONG, CHANGING) if last else TURNS[self._searches % len(TURNS)]:
            for found in acquire(stream.sums, stream.sums_rate, config.speed_range, search):
                follow = lock(stream, found, search, config, self._read_until)
                if follow is not None:
                    follow.signal = self._searches
                    return follow
        return None

    def _next_word(self, follow: SignalTracker) -> list[Word]:
        """Read the next word and return the words that can now be reported."""
        early = follow.early
        word = read_word(follow, self._stream)
        if word is None and early:  # the held words do not belong to this signal
            self._held = []
        if follow.misses >= self._config.lost_words:
            self._follow, self._held = None, []
            return []
        if word is None or not word.known:
            return []
        self._held.append(word)
        if not word.upheld:
            return []
        words, self._held = self._held, []
        self._read_until = word.end
        return words
