"""The page's own arithmetic is that of the package."""

import base64

import numpy as np
import pytest
from bodies import BODY, MODEL, placed, some_pose
from node_js import needs_node, run_js
from recorded_scene import (
    SKELETON,
    START_NS,
    as_bytes,
    make_patches,
    make_poses,
    make_rig,
    make_view,
    places,
    write_scene,
)

from panoptic_ros.domain import Camera
from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.bags import BagReader
from panoptic_ros.io.body_models import read_body_shape
from panoptic_ros.io.colors import rgb_of
from panoptic_ros.io.messages.family import decode_cdr
from panoptic_ros.io.resources import share_folder
from panoptic_ros.kinematics.body_records import SolvedBody, body_set
from panoptic_ros.view.page.facts import camera_document, schemas, shape_document
from panoptic_ros.view.page.packets import PacketKind, PageMessage, pack
from panoptic_ros.view.page.recorded import RecordedScene

pytestmark = needs_node
RIG = make_rig()


def text(data):
    return base64.b64encode(data).decode()


BYTES = 'const bytes = (text) => Uint8Array.from(Buffer.from(text, "base64"));'


def cameras_of_all_kinds():
    rng = np.random.default_rng(5)
    matrix = [[600.0, 1.5, 330.0], [0.0, 590.0, 250.0], [0.0, 0.0, 1.0]]
    lenses = [
        Intrinsics(matrix, []),
        Intrinsics(matrix, [-0.4, 0.2, 0.003, -0.002, -0.05]),
        Intrinsics(matrix, [-0.9, 0.0]),
        Intrinsics(matrix, [0.1, -0.03, 0.01, -0.002], "fisheye"),
        Intrinsics(matrix, [-0.6, 0.0, 0.0, 0.0], "fisheye"),
        Intrinsics(matrix, [0.3, -0.2, 1e-3, 2e-3, 0.1, 0.2, -0.1, 0.15]),
        Intrinsics(matrix, [-0.2, 0.1, 1e-3, 2e-3, 0, 0, 0, 0.01, 2e-3, -1e-3, 1e-3, 2e-3, 0.03, -0.04]),
    ]
    for i, lens in enumerate(lenses):
        rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        rotation *= np.sign(np.linalg.det(rotation))
        yield Camera(f"cam{i}", (640, 480), lens, Rigid(rotation, rng.normal(size=3)))


def test_every_lens_projects_as_in_the_package():
    points = np.random.default_rng(1).normal(scale=3.0, size=(400, 3))
    cameras = list(cameras_of_all_kinds())
    found = run_js(
        """
        import { makeCamera, project } from "#view/lens.js";
        const pixels = data.cameras.map(makeCamera).map((c) => data.points.map((p) => project(c, ...p)));
        console.log(JSON.stringify(pixels));
        """,
        {"cameras": [camera_document(camera) for camera in cameras], "points": points.tolist()},
    )
    for camera, pixels in zip(cameras, found):
        expected, seen = camera.project(points)
        assert [pixel is not None for pixel in pixels] == seen.tolist()
        assert 20 < seen.sum() < 380
        given = np.array([pixel for pixel in pixels if pixel is not None])
        assert np.abs(given - expected[seen]).max() < 1e-6


def test_pixels_are_taken_back_to_their_rays():
    cameras = list(cameras_of_all_kinds())
    pixels = np.random.default_rng(2).uniform([250, 180], [400, 320], (50, 2))
    found = run_js(
        """
        import { makeCamera, unproject } from "#view/lens.js";
        const rays = data.cameras.map(makeCamera).map((c) => data.pixels.map((p) => unproject(c, ...p, 2)));
        console.log(JSON.stringify(rays));
        """,
        {"cameras": [camera_document(camera) for camera in cameras], "pixels": pixels.tolist()},
    )
    for camera, points in zip(cameras, found):
        assert np.abs(camera.project(np.array(points))[0] - pixels).max() < 1e-3
        assert np.allclose(camera.cam_from_world.apply(np.array(points))[:, 2], 2.0)


def plain(value):
    """A message as JSON."""
    if hasattr(value, "__msgtype__"):
        fields = {name: item for name, item in vars(value).items() if name.islower()}  # but constants
        return {name: plain(item) for name, item in fields.items() if name != "__msgtype__"}
    if isinstance(value, np.ndarray):
        return [None if isinstance(x, float) and not np.isfinite(x) else x for x in value.tolist()]
    if hasattr(value, "tobytes"):
        return value.tolist()
    if isinstance(value, list):
        return [plain(item) for item in value]
    return value


def test_messages_of_every_type_of_a_real_bag_are_decoded_as_in_the_package():
    with BagReader(share_folder() / "bags" / "sample") as bag:
        chosen = {}
        for name, _, data, kind in bag.raw():
            chosen.setdefault(name, []).append((bytes(data), kind))
    cases = [case for several in chosen.values() for case in several[:3]]
    poses = make_poses(RIG, 40, START_NS)
    cases += [(as_bytes(poses, little), "panoptic_msgs/msg/Skeletons") for little in (True, False)]
    cases.append((as_bytes(make_view(RIG.cameras[0], poses, 5), False), "panoptic_msgs/msg/ViewDetections"))
    found = run_js(
        BYTES
        + """
        import { Decoder } from "#view/cdr.js";
        const decoder = new Decoder(data.schemas);
        const plain = (key, value) => ArrayBuffer.isView(value) ? Array.from(value) : value;
        const found = data.cases.map(([text, type]) => decoder.decode(bytes(text), type));
        console.log(JSON.stringify(found, plain));
        """,
        {
            "schemas": schemas(kind for _, kind in cases),
            "cases": [(text(data), kind) for data, kind in cases],
        },
    )
    for (data, kind), message in zip(cases, found):
        assert message == plain(decode_cdr(data, kind)), kind


def test_packets_are_taken_apart_and_what_is_none_is_refused():
    messages = [PageMessage(3, b"abc"), PageMessage(0, b""), PageMessage(70000, bytes(range(100)))]
    found = run_js(
        BYTES
        + """
        import { unpack } from "#view/packets.js";
        const { kind, number, messages } = unpack(bytes(data.packet).buffer);
        let refused = 0;
        for (const text of ["", "AAAA", data.packet.slice(4)]) {
          try { unpack(bytes(text).buffer); } catch { refused += 1; }
        }
        console.log(JSON.stringify({ kind, number, refused,
          messages: messages.map(({ topic, bytes }) => [topic, Buffer.from(bytes).toString("base64")]),
          aligned: messages.map(({ bytes }) => (bytes.byteOffset + 4) % 8) }));
        """,
        {"packet": text(pack(PacketKind.BLOCK, 2**32 - 1, messages))},
    )
    assert found["messages"] == [[topic, text(data)] for topic, data in messages]
    assert (found["kind"], found["number"], found["refused"]) == (1, 2**32 - 1, 3)
    assert found["aligned"] == [0, 0, 0]


def test_colours_are_those_of_all_pictures():
    found = run_js(
        'import { rgbOf } from "#view/colors.js"; console.log(JSON.stringify(data.map(rgbOf)));',
        list(range(-1, 60)),
    )
    assert np.allclose(found, [rgb_of(identity) for identity in range(-1, 60)])


def test_a_tile_pairs_an_image_with_the_people_of_its_own_stamp(recording):
    scene = RecordedScene(recording, "test")
    blocks = [text(scene.block(number)) for number in range(scene.block_count)]
    found = run_js(
        BYTES
        + """
        import { Store } from "#view/store.js";
        import { unpack } from "#view/packets.js";
        const store = new Store(data.facts);
        const messages = data.blocks.reverse().flatMap((block) => unpack(bytes(block).buffer).messages);
        for (const message of messages) store.add(message);
        const pairs = [];
        for (let t = 0; t < 4e9; t += 17e6) {
          const pair = store.pairAt("cam2", t), now = store.instantAt(t);
          const frame = pair.view.message.frame_number;
          pairs.push([t, now.index, pair.instant.index, frame, pair.preview.t - pair.view.t]);
        }
        const steps = [1, -1, 5, -5].map((n) => store.stepFrom(1e9, n).index);
        console.log(JSON.stringify({ pairs, steps, count: store.instants.length,
          rate: store.rateAt("cam0", 2e9), problems: store.problems,
          ids: store.instantAt(1.5e9).people.map((p) => p.id),
          edge: store.stepFrom(3.99e9, 1).index }));
        """,
        {"facts": scene.facts(), "blocks": blocks},
    )
    assert found["count"] == 120 and found["problems"] == 0 and found["ids"] == list(places(45))
    for t, now, shown, frame, apart in found["pairs"]:
        assert now == int(t * 30 / 1e9 + 1e-6)
        assert shown == now - now % 3 and frame == 1000 + shown and apart == 0
    assert found["steps"] == [31, 29, 35, 25] and found["edge"] == 119
    assert np.isclose(found["rate"], 30.0, atol=0.1)


@pytest.mark.parametrize("shift", [0.0, 3600.0])
def test_a_driver_that_counts_anew_is_paired_by_time(shift):
    """Numbers 0 to 9, and 20 s later 0 to 3 again, of which the last view has not come yet."""
    found = run_js(
        """
        import { Store } from "#view/store.js";
        const store = new Store({ schemas: {}, topics: [], kind: "recorded", begin_ns: 0 }), s = 1e9;
        const add = (n, begin, seen) => {
          if (seen) store._addView("left", (begin + n + data) * s, { frame_number: n });
          store._addInstant((begin + n) * s, { view_cameras: ["left"], view_frames: [n], skeletons: [] });
        };
        const views = () => store.instants.map((item) => store.viewOf("left", item));
        const times = () => views().map((view) => view && view.t / s - data);
        for (let n = 0; n < 10; n++) add(n, 0, true);
        const before = times();
        for (let n = 0; n < 4; n++) add(n, 20, n < 3);
        console.log(JSON.stringify([before, times()]));
        """,
        shift,
    )
    assert found == [[*range(10)], [*range(10), 20, 21, 22, None]]


def test_people_are_shown_where_there_are_no_images(tmp_path):
    write_scene(tmp_path / "bag", 10, previews=False)
    scene = RecordedScene(tmp_path / "bag", "test")
    found = run_js(
        BYTES
        + """
        import { Store } from "#view/store.js";
        import { unpack } from "#view/packets.js";
        const store = new Store(data.facts);
        for (const message of unpack(bytes(data.block).buffer).messages) store.add(message);
        const pair = store.pairAt("cam1", 0.2e9);
        console.log(JSON.stringify([pair.preview, pair.instant.index, pair.view.message.frame_number]));
        """,
        {"facts": scene.facts(), "block": text(scene.block(0))},
    )
    assert found == [None, 6, 1006]


def test_evidence_tells_views_and_residuals(recording):
    scene = RecordedScene(recording, "test")
    found = run_js(
        BYTES
        + """
        import { Store } from "#view/store.js";
        import { unpack } from "#view/packets.js";
        import { makeCamera } from "#view/lens.js";
        import { evidence, personEvidence, principalSpread, spread, cholesky } from "#view/people.js";
        const store = new Store(data.facts);
        for (const message of unpack(bytes(data.block).buffer).messages) store.add(message);
        const cameras = new Map(data.facts.cameras.map((c) => [c.name, makeCamera(c)]));
        const instant = store.instantAt(0), person = instant.people[0];
        console.log(JSON.stringify({
          rows: evidence(store, cameras, instant, person, 1),
          views: personEvidence(store, cameras, instant, person), axes: principalSpread(person, 1),
          spread: spread(person, 1), root: cholesky([4, 2, 0.4, 2, 5, 1, 0.4, 1, 3]) }));
        """,
        {"facts": scene.facts(), "block": text(scene.block(0))},
    )
    assert [row["camera"] for row in found["rows"]] == list(RIG.names)
    for row in found["rows"]:
        assert row["state"] == "seen" and np.allclose(row["residual"], [3.0, -4.0]) and row["score"] == 0.8
    poses = make_poses(RIG, 0, 0)
    seen = [np.isfinite(make_view(camera, poses, 0).points[0]).all(-1).sum() for camera in RIG.cameras]
    assert [(row["camera"], row["joints"]) for row in found["views"]] == list(zip(RIG.names, seen))
    assert np.allclose([row["rms"] for row in found["views"]], 5.0)
    assert np.allclose(found["axes"], [30.0, 20.0, 10.0]) and np.allclose(found["spread"], [10.0, 20.0, 30.0])
    a, b, c, d, e, f = found["root"]
    lower = np.array([[a, 0, 0], [b, d, 0], [c, e, f]])
    assert np.allclose(lower @ lower.T, [[4, 2, 0.4], [2, 5, 1], [0.4, 1, 3]])


def test_live_times_that_are_old_are_forgotten(recording):
    scene = RecordedScene(recording, "test")
    found = run_js(
        BYTES
        + """
        import { Store } from "#view/store.js";
        import { unpack } from "#view/packets.js";
        const store = new Store(data.facts);
        for (const block of data.blocks) for (const m of unpack(bytes(block).buffer).messages) store.add(m);
        store.forget(2e9);
        console.log(JSON.stringify([store.instants[0].t, store.views.get("cam1").byFrame.size,
          Math.min(...store.previews.get("cam1").times), store.pairAt("cam1", 1.9e9)]));
        """,
        {"facts": scene.facts(), "blocks": [text(scene.block(number)) for number in range(4)]},
    )
    assert found[0] >= 2e9 and found[1] <= 60 and found[2] >= 2e9 and found[3] is None


def test_the_player_waits_for_data_and_stops_at_the_end():
    found = run_js(
        """
        import { Player, clockText } from "#view/player.js";
        const player = new Player(false, 0, 3e9), seen = [];
        player.toggle();
        player.advance(1000, () => true); seen.push(player.t);
        player.advance(1000, () => false); seen.push(player.t);
        player.faster(1); player.advance(500, () => true); seen.push(player.t);
        player.advance(9000, () => true); seen.push(player.t, player.playing);
        player.toggle(); seen.push(player.t, player.playing);
        player.seek(-5); seen.push(player.t);
        player.seek(9e9); seen.push(player.t);
        console.log(JSON.stringify([seen, [0, 61.5e9, 3723.004e9].map(clockText)]));
        """
    )
    assert found[0] == [1e9, 1e9, 2e9, 3e9, False, 0, True, 0, 3e9]
    assert found[1] == ["0:00.00", "1:01.50", "1:02:03.00"]


def test_seconds_that_a_picture_needs_come_first_and_few_are_on_their_way():
    found = run_js(
        """
        import { Blocks } from "#view/blocks.js";
        const asked = [], blocks = new Blocks(3599.5e9, (k) => asked.push(k));
        const after = (t, ...came) => {
          came.forEach((k) => blocks.came(k));
          blocks.load(t);
          return asked.splice(0);
        };
        const found = { first: after(1000.2e9) };
        found.moved = after(50.2e9); // while two are on their way
        found.whole = [after(50.2e9, 1000, 999), blocks.isWhole(50.2e9)];
        found.whole.push(after(50.2e9, 50), blocks.isWhole(50.2e9));
        blocks.failed(49);
        found.failed = [blocks.isWhole(50.2e9), blocks.isThere(49.5e9), after(50.2e9)];
        found.ahead = [after(50.2e9, 51, 52), after(50.2e9, 53)];
        found.ends = [after(0), after(0, 0, 1), blocks.isWhole(0.5e9)];
        found.ends.push(after(3599.2e9, 2, 3), after(3599.2e9, 3598, 3599));
        found.matters = [46, 47, 50, 51].map((k) => blocks.matters(k, 50.2e9));
        console.log(JSON.stringify(found));
        """
    )
    assert found["first"] == [1000, 999] and found["moved"] == []
    assert found["whole"] == [[50, 49], False, [51], False]
    assert found["failed"] == [True, False, [52]] and found["ahead"] == [[53], []]
    assert found["ends"] == [[0, 1], [2, 3], True, [3599, 3598], []]
    assert found["matters"] == [False, True, True, False]


def test_far_seconds_are_forgotten_when_there_are_many():
    found = run_js(
        """
        import { Blocks } from "#view/blocks.js";
        const blocks = new Blocks(3599.5e9, () => {});
        [10, 11, 12, 13].forEach((k) => blocks.came(k));
        blocks.load(500e9); // two on their way
        const found = [blocks.forgetFar(500e9)];
        [14, 500].forEach((k) => blocks.came(k));
        found.push(blocks.forgetFar(500e9), blocks.loaded, blocks.isThere(10e9));
        blocks.load(10e9);
        console.log(JSON.stringify([...found, [...blocks.states.keys()]]));
        """
    )
    assert found == [None, [498e9, 507e9], [[500e9, 501e9]], False, [500, 499, 10]]


def test_lanes_of_the_time_line_do_not_overlap():
    rng = np.random.default_rng(3)
    starts = np.sort(rng.uniform(0, 20, 60))
    spans = [[i, start, start + rng.uniform(0.1, 3)] for i, start in enumerate(starts)]
    lanes = run_js(
        'import { arrange } from "#view/timeline.js"; console.log(JSON.stringify(arrange(data)));', spans
    )
    for i, (_, begin, end) in enumerate(spans):
        for j in range(i):
            assert lanes[i] != lanes[j] or end < spans[j][1] or begin > spans[j][2]


def test_health_of_statuses_and_of_a_report():
    statuses = [
        {
            "name": "sync",
            "owner": "panoptic_ros",
            "level": 1,
            "message": "",
            "values": {"taken": "9", "step_p50_ms": "0.5", "step_p99_ms": "2.5", "dropped.late": "3"},
        },
        {
            "name": "camera_cam1",
            "owner": "",
            "level": 0,
            "message": "",
            "values": {"taken": "0", "step_p50_ms": "nan", "step_p99_ms": "nan", "dropped.overtaken": "4"},
        },
        {
            "name": "clock of cam1",
            "owner": "cam1",
            "level": 0,
            "message": "ok",
            "values": {"offset_s": "0.012", "std_us": "40"},
        },
        {
            "name": "fusion: cam1 detections",
            "owner": "cam1",
            "level": 1,
            "message": "silent for 3 s",
            "values": {"taken": "9", "lost": "2", "left_out": "1", "bad": "0", "step_p50_ms": "1"},
        },
    ]
    cameras = {"cam0": {"rate_hz": 30, "age_s": 0.01}, "cam1": {"rate_hz": 0, "age_s": 3.2}}
    found = run_js(
        """
        import { captionOf, fromHealth } from "#view/health.js";
        const health = fromHealth(data);
        console.log(JSON.stringify([health, Object.values(health.cameras).map((c) => captionOf(c, true))]));
        """,
        {"cameras": cameras, "statuses": statuses},
    )
    health, captions = found
    assert health["stages"] == [{"stage": "sync", "p50": 0.5, "p99": 2.5}]
    assert health["cameras"]["cam1"]["dropped"] == 4 + 3
    assert health["dropped"] == [["sync: late", 3], ["camera_cam1: overtaken", 4]]
    assert ["fusion: cam1 detections", "silent for 3 s"] in health["warnings"]
    assert health["cameras"]["cam1"]["clock"] == "12.00 ms ± 40 µs"
    assert captions == [[["30 Hz"], "good"], [["0.0 Hz", "silent 3 s", "7 dropped"], "bad"]]
    assert SKELETON.head == 1


def test_balls_of_a_body_lie_where_its_capsules_are():
    frames, places = placed(some_pose(3))
    body = SolvedBody(BodyState(5, 4, places, frames), BODY, 2, 4, 0)
    data = as_bytes(body_set(0, 5, 5, MODEL, SKELETON, [body]))
    kind = "panoptic_msgs/msg/Bodies"
    found = run_js(
        BYTES
        + """
        import { Decoder } from "#view/cdr.js";
        import { ballsOf } from "#view/bodies.js";
        const message = new Decoder(data.schemas).decode(bytes(data.message), data.kind);
        console.log(JSON.stringify(ballsOf(message, message.bodies[0], data.shape)));
        """,
        {"schemas": schemas([kind]), "message": text(data), "kind": kind, "shape": shape_document()},
    )
    centres, sizes = np.array([ball["at"] for ball in found]), np.array([ball["radius"] for ball in found])
    axes = np.array([ball["axes"] for ball in found]).reshape(-1, 3, 3)
    for capsule in read_body_shape(MODEL).capsules(BODY.offsets):
        turn, origin = frames[capsule.segment], places[capsule.segment]
        for end, radius in zip((capsule.begin, capsule.end), capsule.radii):
            away = np.linalg.norm(centres - (origin + turn @ end), axis=1) + np.abs(sizes - radius)
            nearest = away.argmin()
            assert away[nearest] < 1e-6
            expected = turn @ np.diag([radius, radius * capsule.wide, radius])
            assert (np.abs(axes - expected).max((1, 2)) < 1e-6).any()


def test_patches_are_those_of_the_message_and_a_picture_has_those_that_its_camera_sees():
    patches = make_patches(RIG, 40, START_NS)
    kind = "panoptic_msgs/msg/PatchTrajectories"
    everywhere, seen, hidden, nowhere, empty = run_js(
        BYTES
        + """
        import { Decoder } from "#view/cdr.js";
        import { patchesOf, seenBy } from "#view/patches.js";
        const message = new Decoder(data.schemas).decode(bytes(data.message), data.kind);
        const last = data.cameras.at(-1);
        console.log(JSON.stringify([patchesOf(message), seenBy(message, "cam1"), seenBy(message, last),
          seenBy(message, "no such camera"), patchesOf(null)]));
        """,
        {"schemas": schemas([kind]), "message": text(as_bytes(patches)), "kind": kind, "cameras": RIG.names},
    )
    assert np.allclose([patch["at"] for patch in everywhere], patches.positions)
    assert np.allclose([patch["normal"] for patch in everywhere], patches.normals)
    assert [patch["part"] for patch in everywhere] == patches.parts.tolist()
    assert seen == everywhere and hidden == nowhere == empty == []


def test_a_click_means_the_nearest_joint_else_the_person_whose_bone_is_there():
    found = run_js(
        """
        import { pickPerson } from "#view/people.js";
        const person = (id, x) => ({ id, states: [1, 1, 1, 0],
          positions: new Float64Array([x, 0, 9, x, 100, 9, x + 100, 100, 9, x, 50, 9]) });
        const people = [person(3, 0), person(8, 300)], bones = [[0, 1], [1, 2], [2, 3]];
        const pixelOf = ([x, y]) => x > 350 ? null : [x, y];
        console.log(JSON.stringify(data.map((spot) => pickPerson(people, bones, pixelOf, spot, 10))));
        """,
        [[3, 5], [3, 40], [4, 92], [50, 109], [50, 111], [309, 50], [350, 100], [150, 50]],
    )
    bone = {"id": 3, "joint": None}
    assert found == [
        {"id": 3, "joint": 0},
        bone,
        {"id": 3, "joint": 1},
        bone,
        None,
        {"id": 8, "joint": None},
        None,
        None,
    ]
