"""Sources of audio: files and live microphones.

Every source is a `SoundSource`: the blocks of one device in order, with the names of the clocks whose
timecode its channels carry. A new kind of source needs a class of that form and an entry in `described`.
"""

from panoptic_ros.capture.sound.described import described_sound, open_sound
from panoptic_ros.capture.sound.folder import SOUND_NAMES, folder_sounds, sound_files, track_sound
from panoptic_ros.capture.sound.source import SoundSource
from panoptic_ros.capture.sound.track import known_tracks, read_sound
from panoptic_ros.capture.sound.video import VideoSound
from panoptic_ros.capture.sound.wav import WavSource

__all__ = [
    "SOUND_NAMES",
    "SoundSource",
    "VideoSound",
    "WavSource",
    "described_sound",
    "folder_sounds",
    "known_tracks",
    "open_sound",
    "read_sound",
    "sound_files",
    "track_sound",
]
