"""Bodies over a WebSocket, by a real client."""

import json
import time

import captures
import numpy as np
import pytest
from bodies import BODY, MODEL, placed, some_pose
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.export.body_json import FORMAT, hello_text, instant_text
from panoptic_ros.export.body_socket import BodySocket
from panoptic_ros.geometry.rotations import from_quaternions
from panoptic_ros.kinematics.body_records import SolvedBody, body_set


def bodies(index=0):
    frames, places = placed(some_pose(1))
    solved = SolvedBody(BodyState(3_000_000_005, 4, places, frames), BODY, 2, 4, 0)
    return body_set(index, 3_000_000_005, 3_000_000_005, MODEL, captures.SKELETON, [solved])


@pytest.fixture
def socket():
    found = BodySocket()
    found.begin(hello_text(MODEL, "hall"))
    yield found
    found.close()


def offered(socket, text):
    while not socket.watched:
        time.sleep(0.01)
    socket.offer(text)


def test_a_client_can_place_the_segments_from_what_it_hears(socket):
    with connect(socket.address) as client:
        offered(socket, instant_text(bodies(7), MODEL))
        hello, instant = json.loads(client.recv(timeout=5)), json.loads(client.recv(timeout=5))
    assert hello["format"] == FORMAT and hello["frame_id"] == "hall" and len(hello["joint_names"]) == 60
    assert instant["index"] == 7 and instant["stamp"] == {"sec": 3, "nanosec": 5}
    (subject,) = instant["subjects"]
    assert subject["id"] == 4 and subject["source"] == "TRACK"
    turns = from_quaternions(np.array(subject["rotations"])[:, [3, 0, 1, 2]])
    frames, places = [turns[0]], [np.array(subject["root"])]
    for s in range(1, len(hello["segments"])):
        above = hello["parents"][s]
        places.append(places[above] + frames[above] @ subject["offsets"][s])
        frames.append(frames[above] @ turns[s])
    assert np.array(places) == pytest.approx(placed(some_pose(1))[1], abs=1e-4)
    assert np.array(places) == pytest.approx(np.array(subject["positions"]), abs=1e-4)


def test_who_is_late_gets_the_newest_alone(socket):
    with connect(socket.address, max_size=None) as client:
        offered(socket, "0")
        assert client.recv(timeout=5) == hello_text(MODEL, "hall") and client.recv(timeout=5) == "0"
        big = "x" * 3_000_000  # more than sockets hold while nobody reads
        for number in range(50):
            socket.offer(f"{number} {big}")
        socket.offer("last")
        heard = []
        while not heard or heard[-1] != "last":
            heard.append(client.recv(timeout=20)[:4])
    assert len(heard) < 40


def test_pages_of_other_sites_are_refused(socket):
    with pytest.raises(InvalidStatus):
        connect(socket.address, origin="https://example.org")
    with connect(socket.address, origin="http://localhost:3000"):
        pass


def test_a_client_that_has_left_is_forgotten_and_does_not_delay_the_end():
    socket = BodySocket()
    socket.begin(hello_text(MODEL, "hall"))
    with connect(socket.address):
        while not socket.watched:
            time.sleep(0.01)
    end = time.monotonic() + 4.0
    while socket.watched and time.monotonic() < end:
        time.sleep(0.01)
    assert not socket.watched
    with connect(socket.address):
        while not socket.watched:
            time.sleep(0.01)
        begun = time.monotonic()
        socket.close()
    assert time.monotonic() - begun < 3.0


def test_other_machines_need_the_token():
    socket = BodySocket("0.0.0.0")
    try:
        with connect(f"ws://127.0.0.1:{socket.port}/") as client:
            with pytest.raises(ConnectionClosed, match="token"):
                client.recv(timeout=5)
        with pytest.raises(EnvironmentProblem, match=r"nothing can listen .* another `stream_port`"):
            BodySocket("127.0.0.1", socket.port)
    finally:
        socket.close()
