"""Parameters of the timecode stage."""

from __future__ import annotations

from dataclasses import dataclass

from panoptic_ros.params import Config, named_words, param


@dataclass(frozen=True, kw_only=True)
class TimecodeConfig(Config):
    """Parameters of linear timecode (LTC) decoding."""

    agreeing_words: int = param(
        3, ge=2, le=10, doc="Consecutive words whose labels must agree before any of them is reported."
    )
    speed_range: float = param(
        1.27,
        ge=1.01,
        le=1.4,
        doc="Greatest factor by which the tape may run too fast or too slow.",
    )
    high_pass_hz: float = param(
        350.0,
        unit="Hz",
        ge=100.0,
        le=500.0,
        doc="Corner frequency of the high-pass filter against DC and hum. At most half the frequency of "
        "the slowest bit rate's tone.",
    )
    lost_words: int = param(
        4,
        ge=1,
        le=50,
        doc="Consecutive unreadable words after which the decoder searches for the signal again.",
    )
    channels: tuple[str, ...] = param(
        (),
        doc='Clock whose timecode each channel of a device carries, as "device=clock,clock": one name per '
        "channel, empty for a channel without timecode. It overrides the names that come with the sound. "
        "Without names, all channels of a device are searched.",
        when="a sound card receives the timecodes of several clocks, and no sound.yaml names them.",
    )

    def __post_init__(self) -> None:
        Config.__post_init__(self)
        named_words("TimecodeConfig.channels", self.channels)
