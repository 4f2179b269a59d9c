"""Who may connect: one set of rules for the page and for the stream of bodies."""

import pytest

from panoptic_ros.export.access import Access


@pytest.mark.parametrize("name", ["127.0.0.1:8765", "localhost:8765", "LOCALHOST", "[::1]:8765", "[::1]"])
def test_every_name_of_this_machine_is_known(name):
    access = Access("127.0.0.1")
    assert not access.is_foreign({"Host": name})
    assert not access.is_foreign({"Host": name, "Origin": f"http://{name}"})
    assert not access.is_foreign({"Host": "localhost:1", "Origin": f"https://{name}"})


@pytest.mark.parametrize(
    "origin", ["http://elsewhere.example", "null", "http://localhost.elsewhere.example", "["]
)
def test_pages_of_other_sites_are_foreign(origin):
    for host in ("127.0.0.1", "0.0.0.0"):
        assert Access(host).is_foreign({"Host": "127.0.0.1:8765", "Origin": origin})


def test_a_name_that_leads_here_is_foreign_unless_other_machines_may_come():
    headers = {"Host": "robot.local:8765", "Origin": "http://robot.local:8765"}
    assert Access("127.0.0.1").is_foreign(headers) and Access("::1").is_foreign({})
    assert not Access("0.0.0.0").is_foreign(headers)


def test_addresses_hold_the_token_unless_it_is_open_here():
    assert Access("127.0.0.1", open_here=True).address("ws", 7) == "ws://127.0.0.1:7/"
    assert Access("127.0.0.1", open_here=True).has_token("/?token=")
    for host, shown in (("127.0.0.1", "127.0.0.1"), ("::1", "[::1]"), ("0.0.0.0", "<this machine's name>")):
        access = Access(host)
        assert access.address("http", 7) == f"http://{shown}:7/?token={access.token}"
        assert access.has_token(f"/data?token={access.token}")
        assert not access.has_token("/") and not access.has_token("/?token=guess")
    assert Access("0.0.0.0", open_here=True).token
