"""One port for the page and its data; who may have them."""

import asyncio
import gzip
import json
from contextlib import asynccontextmanager

import pytest
from recorded_scene import SKELETON, as_bytes, make_poses, make_rig
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from panoptic_ros.errors import DataError, EnvironmentProblem
from panoptic_ros.view.page.html import page
from panoptic_ros.view.page.live import LiveScene
from panoptic_ros.view.page.live_talk import LiveTalk
from panoptic_ros.view.page.recorded import RecordedScene
from panoptic_ros.view.page.recorded_talk import RecordedTalk
from panoptic_ros.view.page.server import PageServer


def run(coroutine):
    return asyncio.run(asyncio.wait_for(coroutine, 30))


def data_of(address):
    """Where the page of an address gets its data."""
    return address.replace("http", "ws").replace("/?", "/data?")


async def asked(address, path="", **headers):
    """(status, headers, body) of a page; path: in place of the address's own."""
    place, own = address.removeprefix("http://").split("/", 1)
    port, path = place.rsplit(":", 1)[1], path or f"/{own}"
    reader, writer = await asyncio.open_connection("127.0.0.1", int(port))
    fields = {"Host": f"127.0.0.1:{port}", **{k.replace("_", "-"): v for k, v in headers.items()}}
    lines = [f"GET {path} HTTP/1.1", *(f"{key}: {value}" for key, value in fields.items()), "", ""]
    writer.write("\r\n".join(lines).encode())
    head, _, body = (await reader.read()).partition(b"\r\n\r\n")
    writer.close()
    lines = head.decode().split("\r\n")
    return int(lines[0].split()[1]), dict(line.lower().split(": ", 1) for line in lines[1:]), body


@asynccontextmanager
async def served(talk, host="127.0.0.1"):
    async with PageServer(talk, host, 0).listening() as address:
        yield address


async def nothing(connection):
    await connection.wait_closed()


def test_the_page_is_served_and_nothing_else():
    async def check():
        async with served(nothing) as address:
            status, headers, body = await asked(address)
            assert (status, body) == (200, page()) and headers["content-type"].startswith("text/html")
            status, headers, body = await asked(address, Accept_Encoding="gzip, br")
            assert gzip.decompress(body) == page() and headers["content-encoding"] == "gzip"
            assert (await asked(address.replace("/?", "/../../etc/passwd?")))[0] == 404

    run(check())


def test_other_sites_and_names_that_lead_here_are_refused():
    async def check():
        async with served(nothing) as address:
            assert (await asked(address, Origin="http://elsewhere.example"))[0] == 403
            assert (await asked(address, Host="elsewhere.example:80"))[0] == 403
            data = data_of(address)
            with pytest.raises(InvalidStatus, match="403"):
                await connect(data, origin="http://elsewhere.example")
            async with connect(data, origin=address.split("/?")[0]):
                pass

    run(check())


def test_other_users_of_this_machine_need_the_token():
    async def check():
        async with served(nothing) as address:
            assert (await asked(address))[0] == 200
            assert (await asked(address, "/"))[0] == (await asked(address, "/data"))[0] == 403
            with pytest.raises(InvalidStatus, match="403"):
                await connect(data_of(address).split("?")[0])

    run(check())


def test_other_machines_need_the_token():
    async def check():
        async with served(nothing, "0.0.0.0") as address:
            assert "?token=" in address
            port, token = address.split(":")[-1].split("/?token=")
            local = f"http://127.0.0.1:{port}/"
            assert (await asked(local))[0] == 403
            assert (await asked(local, "/?token=guess"))[0] == 403
            assert (await asked(local, f"/?token={token}", Host="robot.local:1"))[0] == 200
            with pytest.raises(InvalidStatus):
                await connect(f"ws://127.0.0.1:{port}/data")

    run(check())


def test_a_port_that_is_taken_is_told():
    async def check():
        async with served(nothing) as address:
            port = int(address.split(":")[-1].split("/")[0])
            with pytest.raises(EnvironmentProblem, match=f"port {port}.*give another --port"):
                async with PageServer(nothing, "127.0.0.1", port).listening():
                    pass

    run(check())


def test_a_recording_answers_for_its_seconds(recording):
    scene = RecordedScene(recording, "test")

    async def check():
        async with served(RecordedTalk(scene)) as address:
            async with connect(data_of(address), max_size=None) as page:
                facts = json.loads(await page.recv())
                assert facts == json.loads(json.dumps(scene.facts()))
                assert json.loads(await page.recv())["type"] == "presence"
                await page.send("no json")
                await page.send(json.dumps({"block": 2, "keys": []}))
                assert await page.recv() == scene.block(2)

    run(check())


def test_a_live_page_gets_facts_health_and_the_newest():
    scene, rig = LiveScene(), make_rig()

    async def check():
        async with served(LiveTalk(scene)) as address:
            async with connect(data_of(address)) as page:
                assert json.loads(await page.recv())["type"] == "waiting"
                scene.begin(rig, SKELETON)
                told = []
                while "facts" not in told:
                    told.append(json.loads(await page.recv())["type"])
                assert json.loads(await page.recv())["type"] == "health"
                for index in range(10):
                    scene.take("skeletons", "", as_bytes(make_poses(rig, index, 10**18 + index)), 1.0, 0)
                    await asyncio.sleep(0.01)
                packets = [await page.recv() for _ in range(2)]
                assert all(isinstance(packet, bytes) for packet in packets)
                await page.send('{"drawn": 0}')
                words = await page.recv()
                while isinstance(words, str):
                    words = await page.recv()
                assert as_bytes(make_poses(rig, 9, 10**18 + 9)) in words
            while scene.wanted():
                await asyncio.sleep(0.01)

    run(check())


def test_a_second_that_cannot_be_read_is_named(recording, monkeypatch):
    def damaged(scene, number, keys=()):
        raise DataError("the bag is damaged")

    monkeypatch.setattr(RecordedScene, "block", damaged)

    async def check():
        async with served(RecordedTalk(RecordedScene(recording, "test"))) as address:
            async with connect(data_of(address), max_size=None) as page:
                await page.send('{"block": 2}')
                said = [json.loads(await page.recv()) for _ in range(3)]
        assert said[-1] == {"type": "problem", "text": "the bag is damaged", "block": 2}

    run(check())
