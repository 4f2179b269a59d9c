"""Read and write WAV files: PCM of 8 to 32 bits and floats, any number of channels."""

from __future__ import annotations

import io
import warnings
from pathlib import Path

import numpy as np

from panoptic_ros.errors import DataError, UsageError, UserError, one_line
from panoptic_ros.io.files import write_bytes
from panoptic_ros.io.loading import check_file, file_errors, read_bytes

Array = np.ndarray
HIGHEST_RATE = 10_000_000  # Hz; audio recorders reach 768 000


def read_wav(path: Path, channel: int = 0) -> tuple[int, Array]:
    """Read the sample rate (Hz) and one channel (counted from 0) as samples (N,) float32 in -1..1.

    Raises:
        DataError: if it is not a WAV file, or an empty one.
        UsageError: if the channel does not exist.
    """
    sample_rate, samples = _read(path)
    if not 0 <= channel < samples.shape[1]:
        raise UsageError(f"{path} has {samples.shape[1]} channels, counted from 0; there is no {channel}")
    return sample_rate, _as_float(path, samples[:, channel])


class WavFile:
    """WAV file of any length, whose samples are read on demand.

    Raises:
        DataError: if it is not a WAV file, or an empty one.
    """

    def __init__(self, path: Path):
        self.path = path
        self.sample_rate, self._stored = _read(path, mapped=True)

    @property
    def channels(self) -> int:
        """Return the number of channels."""
        return int(self._stored.shape[1])

    def __len__(self) -> int:
        return len(self._stored)

    def samples(self, first: int, end: int) -> Array:
        """Return samples (N, C) float32 in -1..1 from `first` to before `end`.

        Raises:
            DataError: if a sample is not finite.
        """
        return _as_float(self.path, np.asarray(self._stored[first:end]))


def _read(path: Path, mapped: bool = False) -> tuple[int, Array]:
    """Return the sample rate (Hz) and the samples (N, C) as stored.

    Args:
        mapped: memory-map the file if its format allows it.
    """
    from scipy.io import wavfile  # slow to import, and most runs do not need it

    check_file(path)
    data = None if mapped else read_bytes(path)
    try:
        with warnings.catch_warnings(), file_errors(path, "read"):
            warnings.simplefilter("ignore", wavfile.WavFileWarning)  # chunks that are not audio
            sample_rate, samples = wavfile.read(path if data is None else io.BytesIO(data), mmap=mapped)
    except NameError:  # scipy raises it for a file without a data chunk
        raise DataError(f"{path} is not a WAV file that can be read: it has no samples") from None
    except UserError:
        raise
    except Exception as error:  # scipy trusts the header, so a damaged file can raise any exception
        if mapped:  # 24-bit samples cannot be mapped
            return _read(path)
        raise DataError(f"{path} is not a WAV file that can be read: {one_line(error)}") from None
    if not len(samples):
        raise DataError(f"{path} has no samples")
    if not 0 < sample_rate <= HIGHEST_RATE:
        raise DataError(f"{path} has {sample_rate} samples a second; expected 1 to {HIGHEST_RATE}")
    return int(sample_rate), samples[:, None] if samples.ndim == 1 else samples


def _as_float(path: Path, samples: Array) -> Array:
    if samples.dtype.kind == "f":
        if not np.isfinite(samples).all():
            raise DataError(f"{path} has samples that are not finite")
        return samples.astype(np.float32)
    if samples.dtype == np.uint8:
        return ((samples.astype(np.float32) - 128.0) / 128.0).astype(np.float32)
    return (samples / float(-np.iinfo(samples.dtype).min)).astype(np.float32)


def write_wav(path: Path, sample_rate: int, samples: Array) -> None:
    """Write samples (N,) or (N, C) in -1..1 as 16-bit PCM; clip values beyond."""
    from scipy.io import wavfile  # slow to import, and most runs do not need it

    levels = np.clip(np.round(np.asarray(samples, np.float64) * 32767.0), -32768, 32767)
    buffer = io.BytesIO()
    wavfile.write(buffer, sample_rate, levels.astype(np.int16))
    write_bytes(path, buffer.getvalue())
