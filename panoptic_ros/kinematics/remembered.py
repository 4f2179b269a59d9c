"""Classes that the state of the kinematics stage may hold.

Classes that do not declare their attributes have them listed here.
"""

from __future__ import annotations

from panoptic_ros.domain.segments import SegmentedBody
from panoptic_ros.domain.subjects import BodyState, Device, Subject, TPose
from panoptic_ros.geometry.chain import Pose
from panoptic_ros.geometry.segment_chain import Chain
from panoptic_ros.kinematics.body.between import FootContacts, IncrementEvidenceBuilder
from panoptic_ros.kinematics.body.evidence import EvidenceBuilder, NoiseLevel
from panoptic_ros.kinematics.body.lengths import LengthEstimate, LengthTransition
from panoptic_ros.kinematics.body.measured_body import MeasuredBody
from panoptic_ros.kinematics.body.tracker import RecentInstants, SubjectTracker
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.balance import BalanceEstimate
from panoptic_ros.kinematics.imus.devices import RotationComparison, WornDevices
from panoptic_ros.kinematics.imus.fitting import ImuFitting
from panoptic_ros.kinematics.imus.mounting import MeanObservation, MountingEstimate
from panoptic_ros.kinematics.imus.streams import ImuStreams
from panoptic_ros.kinematics.people.person import PersonState, SolveSources
from panoptic_ros.kinematics.people.presence import SubjectPresence, SubjectSearch
from panoptic_ros.kinematics.people.seen_people import JointPositions, PersonSamples, ViewJoints
from panoptic_ros.kinematics.pose.targets import FloorPoints, Hinges, PosePrior
from panoptic_ros.kinematics.pose.window import (
    AccelerationModel,
    LaterInformation,
    PoseWindow,
    WindowEntry,
    _EliminatedPose,
)
from panoptic_ros.kinematics.timeline import InstantSchedule, InstantSelection, LagBuffer, _StampGap
from panoptic_ros.state import Fields

CLASSES = (
    KinematicsConfig,
    SegmentedBody,
    BodyState,
    Device,
    Subject,
    TPose,
    Chain,
    Pose,
    SolveSources,
    JointPositions,
    ViewJoints,
    FloorPoints,
    Hinges,
    PosePrior,
    AccelerationModel,
    _StampGap,
    _EliminatedPose,
    WindowEntry,
    LaterInformation,
    MeanObservation,
    Fields.named(
        PersonState,
        "_config subject weighing seen fitting tracker behind of_track came worn _alone _mounted "
        "_mounted_devices _without _unseen presence _returns _awaited_s _lost_s _several_s",
    ),
    Fields.named(SubjectPresence, "last_ns _missed _usual _company _absence"),
    Fields.named(SubjectSearch, "_place _stamp_ns _alone _others _first_ns _newcomer"),
    Fields.named(PersonSamples, "views joints"),
    Fields.named(
        ImuFitting,
        "heading offset_ns looking _clocks _states _stamps _turns _forces _held _poseless _settled _seen_s "
        "_next_s",
    ),
    Fields.named(
        ImuStreams,
        "names _numbers _stamps _values _force _weight _odd _silent _taken _flooding _rates _learnt "
        "_rates_told _unoriented _batch _batched _period _first _batches_told",
    ),
    Fields.named(LengthTransition, "_begin _body _passed_s"),
    Fields.named(MeasuredBody, "_seen _count _stride"),
    Fields.named(LagBuffer, "_instants"),
    Fields.named(InstantSelection, "_most waited_ns _left_out"),
    Fields.named(
        InstantSchedule,
        "_rate_hz _origin _count _before _first_imu _last _awaited _periods _slowest _ahead _others_go_on "
        "newest_ns",
    ),
    Fields.named(
        SubjectTracker,
        "subject body weighing _config _chain _count devices _window _pose _before _past _between "
        "iterations lengths _lengthening _length_spreads _next_look _next_update _noise",
    ),
    Fields.named(RecentInstants, "_stamps _strides _held"),
    Fields.named(IncrementEvidenceBuilder, "_rate_hz _contact _unseen_s"),
    Fields.named(FootContacts, "_ground _rate _tops _above _feet _unrest _apart _before _stood"),
    Fields.named(NoiseLevel, "_square _looks _since"),
    Fields.named(LengthEstimate, "_usual _sure _lengths _information _pull looks scales _unsure _moved"),
    Fields.named(
        WornDevices,
        "_config _subject _chain _devices names mounts segments positions _turn _unseen mounting _wearing "
        "_since_look _notices _told accelerated pushes _oriented _goals _rows _balance",
    ),
    Fields.named(RotationComparison, "_looks _count"),
    Fields.named(BalanceEstimate, "_chain _segments _masses _ground _shares _information _pull _state"),
    Fields.named(
        PoseWindow,
        "_chain _motion _lag _size _weights _poses _next _stride _information _pulled _open _eliminated "
        "_linked _after iterations",
    ),
    Fields.named(
        MountingEstimate,
        "_config _chain _segments _heading_sd _unseen _older _looks heading mountings _common _strap spreads "
        "_recent _several _suspect _moved mistaken slipped",
    ),
    Fields.named(
        EvidenceBuilder,
        "_config _subject _names _columns _segments _offsets _unmeasured _anchors rotations translations "
        "_paper_focal prior floor",
    ),
)
