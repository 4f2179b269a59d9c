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
        doc="Largest factor by which the tape may run too fast or too slow.",
    )
    high_pass_hz: float = param(
        350.0,
        unit="Hz",
        ge=100.0,
        le=500.0,
        doc="Corner of the filter against DC and hum; half of the slowest bit rate's tone at most.",
    )
    lost_words: int = param(
        4, ge=1, le=50, doc="Consecutive unreadable words after which the signal is searched for anew."
    )
    channels: tuple[str, ...] = param(
        (),
        doc='Whose timecode the channels of a device carry, as "device=clock,clock", one for each channel, '
        "empty for one that carries none; in place of what its sound says. A device that nobody names is "
        "searched on all channels.",
        when="a sound card hears the timecodes of several clocks, and no sound.yaml says which.",
    )

    def __post_init__(self) -> None:
        Config.__post_init__(self)
        named_words("TimecodeConfig.channels", self.channels)
