"""Echoes of a room make the same error in every word; a linear channel tells right labels from wrong ones.

Echoes of one word fall on the same bits of the next, as most bits of words do not change. They turn bits in
pairs (where the edge between two bits is lost another appears, so the parity of the word does not show it),
and they do so in every word, so more words do not help. But echoes are linear: a filter as long as a word
explains the levels if the labels are right, and leaves large residuals if they are wrong.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Array = np.ndarray
LATE = 160  # half cells by which echoes come late, at most: a word
EARLY = 2  # half cells by which a filter of zero phase or an inexact grid spreads edges forward
PRIOR = 0.01  # variance of noise over that of a coefficient of the filter


def echo_nats(levels: Sequence[Array], signs: Sequence[Array]) -> float:
    """How badly signs explain levels through the linear channel that fits best; only differences matter.

    Args:
        levels: (160,) of the half cells of consecutive words in the order of the stream.
        signs: (160,) of each word.

    Returns: nats, if noise is Gaussian and of unknown level.
    """
    heard, sent = np.concatenate(levels).astype(np.float64), np.concatenate(signs).astype(np.float64)
    late = min(LATE, len(heard) // 4)
    shifted = np.lib.stride_tricks.sliding_window_view(sent, late + EARLY)
    answers = heard[late - 1 : late - 1 + len(shifted)]
    power = float(answers @ answers)
    if power <= 0.0:
        return 0.0
    ridge = PRIOR * len(answers)
    normal = shifted.T @ shifted + ridge * np.eye(late + EARLY)
    filtered = np.linalg.solve(normal, shifted.T @ answers)
    rest = answers - shifted @ filtered
    unexplained = float(rest @ rest) + ridge * float(filtered @ filtered)
    return 0.5 * len(answers) * float(np.log(max(unexplained / power, 1e-12)))
