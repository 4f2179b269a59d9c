"""What sync remembers."""

from __future__ import annotations

from fractions import Fraction

from panoptic_ros.domain import ClockModel, ScoreMaps, ViewDetections, VisibilityLimit
from panoptic_ros.state import Fields, StateLayout
from panoptic_ros.sync.agreement import Agreement, PendingLine
from panoptic_ros.sync.correction import CameraClock, StampCorrection
from panoptic_ros.sync.instants import CameraInstants, Grid, Pace
from panoptic_ros.sync.jumps import GuardedCamera, SetBackGuard
from panoptic_ros.sync.liveness import LiveCamera, Liveness
from panoptic_ros.sync.majority import Majority, Vote
from panoptic_ros.sync.outliers import StampLine, StampOutliers
from panoptic_ros.sync.overlap import Overlap
from panoptic_ros.sync.queue import CameraQueue, Waiting

LAYOUT = StateLayout(
    "sync",
    (
        "_outliers",
        "_correction",
        "_agreement",
        "_overlap",
        "_guard",
        "_came",
        "_queues",
        "_in_order",
        "_current",
        "_decided",
        "_instants",
        "_next",
        "_closed",
        "_stamp",
        "_liveness",
        "_first",
        "_index",
    ),
    (
        ClockModel,
        ScoreMaps,
        ViewDetections,
        VisibilityLimit,
        CameraClock,
        GuardedCamera,
        LiveCamera,
        PendingLine,
        StampLine,
        Vote,
        Waiting,
        Fields.named(StampOutliers, "_cameras"),
        Fields.named(
            StampCorrection, "_device _delays _clocks _cameras _most_held _heard _told _implausible"
        ),
        Fields.named(Liveness, "_cameras now_ns _passed_ns"),
        Fields.named(Agreement, "_by_arrival _by_stamps _stamps _lines _start_ns _began"),
        Fields.named(Majority, "votes offset reach _periods _count"),
        Fields.named(Overlap, "_cameras _joined _apart _told started _begin"),
        Fields.named(SetBackGuard, "_cameras _shift"),
        Fields.named(CameraQueue, "frames pace ended silent last_given _keeps_last"),
        Fields.named(Pace, "_steps newest"),
        Fields.named(Grid, "_rate _phase period"),
        Fields.named(CameraInstants, "master period _same_rate _phases _last"),
        Fields.named(Fraction, "_numerator _denominator", is_value=True),
    ),
    same={"configuration": "_config", "cameras": "_rig.names", "skeleton": "_skeleton_hash"},
)
