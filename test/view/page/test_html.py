"""The page is one document that asks nobody for anything."""

import json
import re

from panoptic_ros.view.page.html import STATIC, page


def test_every_module_that_is_imported_is_there_and_used():
    imported = {"main.js", "guide.js"}
    for path in STATIC.rglob("*.js"):
        if path.parent.name != "vendor":
            imported |= set(re.findall(r'from "#view/([^"]+)"', path.read_text()))
    there = {path.relative_to(STATIC).as_posix() for path in STATIC.rglob("*.js")}
    assert imported == there


def test_no_address_of_another_host_is_in_the_page():
    for path in [*STATIC.rglob("*.js"), *STATIC.glob("*.html"), STATIC / "style.css"]:
        if path.parent.name == "vendor":
            continue
        assert not re.search(r"""(?:https?:)?//[a-z0-9-]+\.[a-z]""", path.read_text()), path


def test_the_whole_page_is_small():
    assert len(page()) < 1_000_000
    assert sum(path.stat().st_size for path in STATIC.rglob("*") if path.is_file()) < 1_000_000


def test_data_cannot_end_their_element():
    html = page({"facts": {"title": "</script><script>alert(1)</script>"}, "blocks": []}).decode()
    (text,) = re.findall(r'id="data">(.*?)</script>', html, re.DOTALL)
    assert json.loads(text)["facts"]["title"] == "</script><script>alert(1)</script>"
    assert 'id="data"' not in page().decode()
