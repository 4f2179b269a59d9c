"""One device's samples to words: the story of the method.

1. The stream is worked on in hops of fixed length, so words do not depend on how it was cut into blocks.
   Every hop is conditioned: clicks are bridged, DC and hum are filtered away (`signal`).
2. Until there is a signal, the decoder searches for one: the cell length and phase of most energy, the
   direction, and the place of the sync word (`word.acquisition`). It locks to the signal if the labels of its
   words count on (`follow.lock`, `label.stretch`). Where the speed changes it is tracked (`word.tracking`).
3. Each word of the signal is judged against the label that must come next, where the last words say that it
   begins (`follow.reading`). Then it is timed by a fit of its edges (`word.edges`).
4. Words are handed out as soon as one of them rules out the labels beside theirs.
5. After `lost_words` unreadable words all is forgotten, so that noise cannot poison anything, and 2 follows.
"""

from __future__ import annotations

import numpy as np

from panoptic_ros.timecode.config import TimecodeConfig
from panoptic_ros.timecode.follow.following import Follow
from panoptic_ros.timecode.follow.lock import lock
from panoptic_ros.timecode.follow.reading import Word, read_word, word_complete
from panoptic_ros.timecode.signal.stream import Hops, Stream
from panoptic_ros.timecode.word.acquisition import CHANGING, LONG, SHORT, acquire

Array = np.ndarray
HOP_SECONDS = 0.1
TURNS = ((SHORT, CHANGING), (LONG, CHANGING))  # what is looked for in successive hops


class LtcDecoder:
    """Words of one uninterrupted stream."""

    def __init__(self, config: TimecodeConfig, sample_rate: int):
        self._config = config
        self._hop = int(HOP_SECONDS * sample_rate)
        self._hops = Hops(self._hop)
        self._stream = Stream(sample_rate, config.high_pass_hz)
        self._follow: Follow | None = None  # the signal, once there is one
        self._held: list[Word] = []  # words that wait for one that upholds them
        self._read_until = -np.inf  # end of the last word that was handed out
        self._searches = 0

    def push(self, samples: Array) -> list[Word]:
        """Words that became complete with samples (N,)."""
        return [word for hop in self._hops.push(samples) for word in self._work(hop)]

    def finish(self) -> list[Word]:
        """The words that end with the stream."""
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

    def _search(self, last: bool) -> Follow | None:
        """Look for a signal: soon after its start, through noise, with changing speed."""
        self._searches += 1
        stream, config = self._stream, self._config
        for search in (SHORT, LONG, CHANGING) if last else TURNS[self._searches % len(TURNS)]:
            for found in acquire(stream.sums, stream.sums_rate, config.speed_range, search):
                follow = lock(stream, found, search, config, self._read_until)
                if follow is not None:
                    follow.signal = self._searches
                    return follow
        return None

    def _next_word(self, follow: Follow) -> list[Word]:
        """Read the next word; those that may be handed out now."""
        early = follow.early
        word = read_word(follow, self._stream)
        if word is None and early:  # the words so far are of something else
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
