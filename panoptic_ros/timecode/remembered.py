"""What the timecode stage remembers of a device."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from fractions import Fraction

from panoptic_ros.domain import FrameRate, Timecode
from panoptic_ros.state import Fields, StateLayout
from panoptic_ros.timecode.decoder import LtcDecoder
from panoptic_ros.timecode.follow.breaks import Heard
from panoptic_ros.timecode.follow.following import Follow
from panoptic_ros.timecode.follow.reading import Word
from panoptic_ros.timecode.follow.wander import Wander
from panoptic_ros.timecode.label.counting import Counting
from panoptic_ros.timecode.label.evidence import Evidence, UserBits, Verdict
from panoptic_ros.timecode.label.expected import ExpectedLabels
from panoptic_ros.timecode.label.stretch import Solution
from panoptic_ros.timecode.signal.clicks import ClickLimits
from panoptic_ros.timecode.signal.conditioning import Conditioner
from panoptic_ros.timecode.signal.half_cells import Grid
from panoptic_ros.timecode.signal.stream import Buffer, Hops, Stream
from panoptic_ros.timecode.word.viterbi import WordLevels


@dataclass
class Channel:
    """One channel of a device that is searched for timecode.

    Args:
        number: of the channel, counted from 0.
        clock: whose timecode it carries; None: nobody says.
    """

    number: int
    clock: str | None
    decoder: LtcDecoder
    last: Heard | None = None


@dataclass
class Device:
    """One uninterrupted stream of a device.

    Args:
        clocks: of its channels, as they are named.
        main: of channels that nobody named, the one whose timecode the device's clock is held against.
        several: whether another timecode was heard on others, too.
    """

    name: str
    sample_rate: int
    first_sample: int
    clocks: tuple[str, ...]
    channels: list[Channel]
    stamps: deque[tuple[int, int]] = field(default_factory=deque)  # first sample and stamp of blocks
    next_sample: int = 0
    main: int | None = None
    several: bool = False


LAYOUT = StateLayout(
    "timecode",
    ("_devices",),
    (
        Channel,
        ClickLimits,
        Counting,
        Device,
        FrameRate,
        Grid,
        Heard,
        Solution,
        Timecode,
        Verdict,
        Word,
        WordLevels,
        Fields.named(Fraction, "_numerator _denominator", is_value=True),
        Fields.named(LtcDecoder, "_config _hop _hops _stream _follow _held _read_until _searches"),
        Fields.named(Hops, "_length _pending _count"),
        Fields.named(Stream, "sample_rate first up _conditioner _recorded _sums"),
        Fields.named(Buffer, "values", make=Buffer.of),
        Fields.named(
            Conditioner, "up _step _low_pass _between _half _beside reach _piece _clicks _raw _history"
        ),
        Fields.named(
            Follow,
            "grid number labels reverse wander misses read signal first _line _wavers _scatter",
        ),
        Fields.named(
            ExpectedLabels,
            "user _solution _countings _rates _ahead _evidence _labels _verdicts _last_ahead",
        ),
        Fields.named(Wander, "reverse level _place _cell _tracked"),
        Fields.named(UserBits, "_nats certain _other _bits _value"),
        Fields.named(Evidence, "_levels _free _user contradiction same_user"),
    ),
    shared=("_config",),
    same={"configuration": "_config"},
)
