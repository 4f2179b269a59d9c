"""Every record survives the way through a message, bit for bit, in both families."""

import copy
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from damage import damage

from panoptic_ros.domain import (
    AssociationSet,
    AudioBlock,
    BodyStateSet,
    Camera,
    ClockModel,
    DepthSensor,
    DetectionSet,
    Evidence,
    FrameRate,
    Groups,
    ImuSample,
    Occluders,
    PartMotions,
    PatchTracks,
    PatchTrajectories,
    PoseSet,
    Prediction,
    ProposalSet,
    RefinedPoseSet,
    Rig,
    ScoreMaps,
    SkeletonModel,
    SubjectSet,
    Timecode,
    TimecodeReading,
    TimeShift,
    TrackedPoseSet,
    TrackSet,
    ViewAppearance,
    ViewDetections,
    ViewFrame,
    ViewSources,
    VisibilityLimit,
)
from panoptic_ros.errors import DataError, UserError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.messages import (
    bag_messages,
    camera_info_message,
    compressed_image_message,
    frame_from_message,
    from_message,
    image_message,
    to_message,
)
from panoptic_ros.io.messages.family import bag_typestore, decode_cdr

rng = np.random.default_rng(0)


def maps():
    sizes = np.array([[2, 3], [4, 1]])
    return ScoreMaps(
        (20, 10),
        rng.normal(size=(2, 3)),
        [0, 1],
        [0, -1],
        [[1, 2], [3, 9]],
        sizes,
        rng.integers(0, 255, 10),
    )


def view(camera="cam0", people=2, with_maps=True):
    points, scores = rng.normal(size=(people, 3, 2)), rng.uniform(0.1, 1, (people, 3))
    if people:
        points[0, 1], scores[0, 1] = np.nan, 0.0
    return ViewDetections(
        camera,
        123456789012345,
        7,
        (640, 480),
        "cafe0123",
        points,
        scores,
        rng.uniform(size=people),
        maps() if with_maps and people else None,
    )


def poses(cls, people=2, **more):
    positions = rng.normal(size=(people, 3, 3))
    covariances = np.tile(np.eye(3) * 1e-4, (people, 3, 1, 1))
    scores, states = rng.uniform(0.1, 1, (people, 3)), np.ones((people, 3))
    if people:
        positions[0, 1] = covariances[0, 1] = np.nan
        scores[0, 1] = states[0, 1] = 0
    views = rng.integers(0, 5, (people, 3))
    return cls(
        3,
        10**18 + 1,
        "cafe0123",
        positions,
        covariances,
        scores,
        views,
        states,
        rng.uniform(size=people),
        **more,
    )


def shift(people=2):
    return TimeShift(*(rng.normal(size=(people, 3, *tail)) for tail in ((3, 3), (3,), (3,), (3, 3))))


def sources(people=2):
    return ViewSources(("a", "b", "c"), [7, 0, 2**40], rng.integers(-1, 3, (people, 3)))


LIMIT = VisibilityLimit(rng.integers(0, 65535, (3, 4)).astype(np.uint16))
SET = DetectionSet(
    5, 99, "cafe0123", (view("a"), view("b", 0), replace(view("c", with_maps=False), limit=LIMIT))
)


def association(people=2, followed=3):
    """Two 2D people in the first view, none in the second, one in the third; three joints."""
    seen, shape = 3, (followed, 3)
    evidence = Evidence(
        np.array([4, 0, 7]),
        np.array([0, 1, 2]),
        np.array([0, 2, 2, 3]),
        np.array([0, 0, 2]),
        np.array([1, 0, 0]),
        rng.normal(size=(seen, 3, 2)),
        rng.uniform(size=(seen, 3)),
        rng.uniform(size=(seen, 3)),
        rng.normal(size=3),
    )
    prediction = Prediction(
        rng.normal(size=(*shape, 3)),
        rng.normal(size=(*shape, 3)),
        rng.uniform(size=shape),
        rng.uniform(size=(*shape, 3)),
        rng.uniform(size=shape) < 0.5,
    )
    member = np.array([[-1, 1, 2], [-1, 0, -1]])[:people]
    return AssociationSet(
        SET,
        evidence,
        Groups(member, member == 1),
        np.array([2, -1])[:people],
        rng.normal(size=(people, 3, 3)),
        prediction,
    )


ASSOCIATION = association()
TRACKS = TrackSet(
    5,
    99,
    "cafe0123",
    np.array([3, -1]),
    rng.normal(size=(2, 3, 6)),
    rng.uniform(size=(2, 3, 3)),
    rng.uniform(size=(2, 3)),
    np.array([[0.0, np.inf, 0.1], [0.2, 0.3, np.inf]]),
    np.array([0.0, 0.4]),
)
RATE = FrameRate(30, Fraction(30000, 1001), True)
CAMERA = Camera(
    "cam0",
    (640, 480),
    Intrinsics(np.array([[500.0, 0, 320], [0, 501, 240], [0, 0, 1]]), [0.1, 0.2, 0, 0, 1]),
    Rigid(np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]), np.array([0.1, 0.2, 0.3])),
)
ROOT = rng.normal(0.0, 1e-3, (15, 15))
FISHEYE = replace(
    CAMERA,
    name="cam1",
    intrinsics=Intrinsics(CAMERA.intrinsics.matrix, [0.1, 0.2, 0, 0.01], "fisheye"),
    covariance=np.diag(np.arange(14.0)),
)
STATED = replace(CAMERA, type="hd", panel="3", clock="ltc", line_delay_us=12.5, covariance=ROOT @ ROOT.T)
SENSORS = (
    DepthSensor(replace(FISHEYE, name="k"), "cam1", 0.00025),
    DepthSensor(replace(CAMERA, name="lidar")),
)
BODIES = BodyStateSet(
    4,
    7,
    9,
    "abcd1234",
    ("hips", "thigh", "shin"),
    [-1, 0, 1],
    [3, 0],
    [2, 1],
    [4, 0],
    [0, 6],
    rng.normal(size=(2, 3, 3)),
    rng.normal(size=(2, 12)),
    rng.normal(size=(2, 3, 3)),
    rng.normal(size=(2, 3, 4)),
    rng.normal(size=(2, 3, 6)),
    np.full((2, 3, 6, 6), np.nan),
    rng.normal(size=(2, 2, 3)),
    rng.normal(size=(2, 2, 3, 3)),
)
PATCH_TRACKS = PatchTracks(
    "cam0",
    99,
    8,
    50,
    7,
    "cafe0123",
    *rng.normal(size=(2, 4, 2)),
    rng.uniform(size=(4, 3)),
    [0, 0, 1, 2],
    [3, 1, 0, 9],
)
MOTIONS = PartMotions(
    [3, 5], [0, 4], *rng.normal(size=(3, 2, 3)), rng.normal(size=(2, 6, 6)), [20, 7], [0.8, 1.4]
)
PATCHES = PatchTrajectories(
    5,
    99,
    50,
    "cafe0123",
    [8, 9, 11],
    [0, 2, 7],
    [3, 3, 5],
    [0, 1, 4],
    rng.normal(size=(3, 3)),
    rng.normal(size=(3, 3)),
    rng.uniform(size=3),
    ("cam0", "cam1"),
    rng.uniform(size=(3, 2)),
    MOTIONS,
    [[3, 5]],
)

RECORDS = [
    ViewAppearance("cam0", 99, 8, np.where(rng.uniform(size=(4, 2, 3)) < 0.2, np.nan, 0.7)),
    PATCH_TRACKS,
    PATCHES,
    Rig((STATED, FISHEYE), depth_sensors=SENSORS),
    view(),
    view(people=0),
    SET,
    ASSOCIATION,
    TRACKS,
    SubjectSet(7, [3, 0], rng.normal(size=(2, 3)), [-1, 5], [-1, 4]),
    ImuSample("wrist", 7, [0.6, 0.0, 0.8, 0.0], [np.nan] * 3, [0.1, 0.2, 9.8]),
    BODIES,
    ProposalSet(
        ASSOCIATION, rng.normal(size=(3, 3)), [0, 1, 1], [0.1, 0.2, 0.3], [2, 3, 4], [[0, 1]], [0], [0.5]
    ),
    poses(PoseSet),
    poses(PoseSet, 0),
    poses(TrackedPoseSet, ids=[4, 2]),
    poses(RefinedPoseSet, ids=[7, 1]),
    poses(TrackedPoseSet, ids=[4, 2], newest_ns=10**18 + 7, time_shift=shift()),
    poses(PoseSet, side_votes=rng.normal(size=(2, 4))),
    poses(PoseSet, corrections=rng.normal(size=(2, 3, 3))),
    poses(PoseSet, sources=sources()),
    poses(PoseSet, 0, sources=sources(0)),
    poses(RefinedPoseSet, ids=[7, 1], sources=sources()),
    SkeletonModel("s", ("a", "b", "c"), 0, ((0, 1), (0, 2)), 1, ((1, 2),), ((0, (1, 2)),)),
    Rig((CAMERA,), "map"),
    Rig((CAMERA,), "map", Occluders.box((4.0, 0.1, 2.5), np.eye(3), (0.0, 2.0, 1.25))),
    AudioBlock("mic", 5, 48000, 48000, rng.uniform(-1, 1, 50)),
    AudioBlock("mic", 5, 48000, 48000, rng.uniform(-1, 1, (50, 3)), ("A", "", "B")),
    TimecodeReading("mic", 17, Timecode(1, 2, 3, 4, RATE), 12.25, 0.5, True, 0xDEADBEEF),
    TimecodeReading("mic", 17, Timecode(1, 2, 3, 4, RATE), 12.25, 0.5, clock="A", sample_rate=48000),
    ClockModel("mic", 17, 0.25, 1e-6, np.eye(2)),
    ClockModel("b", 17, -(2**62) - 1, 1e-6, np.eye(2), 0.25, 5, 10**18 + 1, 1e-7, 3),
]


def same(a, b):
    if isinstance(a, np.ndarray):
        equal_nan = a.dtype.kind == "f"
        return a.dtype == b.dtype and a.shape == b.shape and np.array_equal(a, b, equal_nan=equal_nan)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b))
    names = [n for c in type(a).__mro__ for n in getattr(c, "__slots__", ())]
    if type(a).__module__.startswith("panoptic_ros") and names:
        return type(a) is type(b) and all(same(getattr(a, n), getattr(b, n)) for n in names)
    return a == b


@pytest.mark.parametrize("record", RECORDS, ids=lambda r: type(r).__name__)
def test_round_trip_through_bag_bytes(record):
    store = bag_typestore()
    message = to_message(record, bag_messages())
    data = store.serialize_cdr(message, message.__msgtype__)
    back = from_message(store.deserialize_cdr(data, message.__msgtype__), type(record).__name__)
    assert same(record, back)


@pytest.mark.ros
@pytest.mark.parametrize("record", RECORDS, ids=lambda r: type(r).__name__)
def test_round_trip_through_ros_bytes(record):
    serialization = pytest.importorskip("rclpy.serialization")
    from panoptic_ros.nodes.middleware.family import ros_messages

    message = to_message(record, ros_messages())
    data = serialization.serialize_message(message)
    back = from_message(serialization.deserialize_message(data, type(message)), type(record).__name__)
    assert same(record, back)
    kind = type(to_message(record, bag_messages())).__msgtype__
    assert same(record, from_message(decode_cdr(data, kind), type(record).__name__))


def test_image_round_trip_and_padding():
    frame = ViewFrame("cam0", 5, 0, rng.integers(0, 255, (6, 4, 3), np.uint8))
    message = image_message(frame, bag_messages())
    assert np.array_equal(frame_from_message(message, "cam0", 0).image, frame.image)
    padded = np.zeros((6, 20), np.uint8)
    padded[:, :12] = frame.image.reshape(6, 12)
    message.step, message.data = 20, padded.reshape(-1)
    assert np.array_equal(frame_from_message(message, "cam0", 0).image, frame.image)
    message.encoding, message.step = "mono8", 20
    assert frame_from_message(message, "cam0", 0).image.shape == (6, 4, 3)
    message.encoding = "32FC1"
    with pytest.raises(DataError, match="32FC1"):
        frame_from_message(message, "cam0", 0)


@pytest.mark.parametrize(
    ("camera", "model", "count"), [(CAMERA, "plumb_bob", 5), (FISHEYE, "equidistant", 4)]
)
def test_camera_info_names_the_lens_as_ros_does(camera, model, count):
    message = camera_info_message(camera, 7, bag_messages())
    assert message.distortion_model == model and len(message.d) == count
    assert np.array_equal(message.d, camera.intrinsics.distortion)


def test_an_unknown_lens_is_refused():
    message = to_message(Rig((CAMERA,)), bag_messages())
    message.cameras[0].lens = "omni"
    with pytest.raises(DataError, match=r"Camera.lens is 'omni', expected 'brown' or 'fisheye'"):
        from_message(message, "Rig")


def test_compressed_image_round_trip():
    frame = ViewFrame("cam0", 5, 0, np.full((32, 48, 3), 128, np.uint8))
    message = compressed_image_message(frame, bag_messages(), 95)
    back = frame_from_message(message, "cam0", 3)
    assert back.frame_number == 3 and np.abs(back.image.astype(int) - 128).max() <= 2
    message.data = message.data[:20]
    with pytest.raises(DataError, match="cannot be decoded"):
        frame_from_message(message, "cam0", 0)


@pytest.mark.parametrize(
    ("field", "value", "match"),
    [
        ("scores", np.ones(5), "values"),
        ("points", np.full(12, np.inf), "not finite|infinite"),
        ("points", np.full(12, 1e160), "holds 1e\\+160; at most 1e\\+12 is possible"),
        ("points", np.full(12, 1e9), "points of camera .* holds 1e\\+09 px; at most"),
        ("image_width", 0, "image_size"),
        ("person_scores", np.array([0.1, np.nan]), "scores"),
        ("limits", np.ones(5, np.uint16), "ViewDetections.limits has 5 values, expected 0 x 0"),
    ],
)
def test_bad_content_is_refused(field, value, match):
    message = to_message(view(with_maps=False), bag_messages())
    setattr(message, field, value)
    with pytest.raises(DataError, match=match):
        from_message(message, "ViewDetections")


def test_a_second_and_more_in_nanosec_is_refused():
    message = to_message(view(with_maps=False), bag_messages())
    message.header.stamp.nanosec = 10**9
    with pytest.raises(DataError, match="nanosec = 1000000000"):
        from_message(message, "ViewDetections")


@pytest.mark.parametrize("record", RECORDS, ids=lambda r: type(r).__name__)
def test_damaged_messages_are_refused_or_read_but_never_break_the_reader(record):
    own = np.random.default_rng(7)
    family, read = bag_messages(), 0
    for _ in range(150):
        message = copy.deepcopy(to_message(record, family))
        damage(message, own)
        with suppress(UserError):
            from_message(message, type(record).__name__)
            read += 1
    assert read


def test_subjects_may_be_ids_alone():
    message = to_message(SubjectSet(7, [3, 0]), bag_messages())
    message.places, message.times, message.tracks = (np.zeros(0),) * 3
    assert same(from_message(message, "SubjectSet"), SubjectSet(7, [3, 0]))
    message.tracks = np.zeros(3, np.int64)
    with pytest.raises(DataError, match=r"SubjectSet.tracks has 3 values, expected 2"):
        from_message(message, "SubjectSet")
