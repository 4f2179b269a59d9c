"""Bindings to an installed libltc through ctypes, for comparison with this project's decoder.

libltc is not part of this package.
"""

from __future__ import annotations

import ctypes
import ctypes.util
from collections.abc import Callable

import numpy as np

from panoptic_ros.evaluation.timecode_bench import DecodedWord

Array = np.ndarray
NAMES = ("libltc.so.11", "libltc.dylib")
BLOCK, QUEUE = 1024, 64


class _Frame(ctypes.Structure):
    """Structure LTCFrameExt of ltc.h, version 1.3."""

    _fields_ = [
        ("bits", ctypes.c_uint8 * 12),
        ("first", ctypes.c_longlong),
        ("last", ctypes.c_longlong),
        ("reverse", ctypes.c_int),
        ("periods", ctypes.c_float * 80),
        ("low", ctypes.c_uint8),
        ("high", ctypes.c_uint8),
        ("volume", ctypes.c_double),
    ]


def load_libltc() -> Callable[[Array, int], list[DecodedWord]] | None:
    """Return the decoder of libltc; None if it is not installed."""
    for name in (ctypes.util.find_library("ltc"), *NAMES):
        try:
            library = ctypes.CDLL(name) if name else None
        except OSError:
            continue
        if library is not None:
            break
    else:
        return None
    library.ltc_decoder_create.restype = ctypes.c_void_p
    library.ltc_decoder_create.argtypes = [ctypes.c_int, ctypes.c_int]
    library.ltc_decoder_free.argtypes = [ctypes.c_void_p]
    library.ltc_decoder_write_float.argtypes = [
        ctypes.c_void_p,
        ctypes.c_void_p,
        ctypes.c_size_t,
        ctypes.c_longlong,
    ]
    library.ltc_decoder_read.argtypes = [ctypes.c_void_p, ctypes.POINTER(_Frame)]
    return lambda samples, rate: _decode(library, samples, rate)


def _decode(library: ctypes.CDLL, samples: Array, rate: int) -> list[DecodedWord]:
    data = np.ascontiguousarray(samples, np.float32)
    decoder = library.ltc_decoder_create(rate // 30, QUEUE)
    frame, words = _Frame(), []
    try:
        for first in range(0, len(data), BLOCK):
            count = min(BLOCK, len(data) - first)
            library.ltc_decoder_write_float(decoder, data.ctypes.data + 4 * first, count, first)
            # libltc discards words when its queue is full
            while library.ltc_decoder_read(decoder, ctypes.byref(frame)) > 0:
                start = frame.last + 1 if frame.reverse else frame.first
                words.append(DecodedWord(_label(bytes(frame.bits)), float(start)))
    finally:
        library.ltc_decoder_free(decoder)
    return words


def _label(data: bytes) -> str:
    """Return the label HH:MM:SS:FF of a word.

    Bytes 0 to 7 hold units and tens of frames, seconds, minutes and hours. Their upper bits are user bits.
    """
    pairs = [10 * (data[2 * k + 1] & mask) + (data[2 * k] & 15) for k, mask in enumerate((3, 7, 7, 3))]
    return ":".join(f"{value:02d}" for value in reversed(pairs))
