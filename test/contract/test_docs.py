"""The documents: every link has a target, and sizes stay within their limits."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("docs/notes/*.md")])
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
README_BYTES, PAGES_BYTES, NOTE_BYTES = 6_000, 120_000, 3_000  # what a lab reads in an evening
GENERATED = ("parameters.md", "accuracy.md")


def anchors(text):
    """The anchors of headings, as GitHub forms them."""
    headings = re.findall(r"^#+ (.*)$", re.sub(r"```.*?```", "", text, flags=re.DOTALL), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def broken(page, text):
    """Links of a page that lead nowhere."""
    found = []
    for link in LINK.findall(re.sub(r"```.*?```", "", text, flags=re.DOTALL)):
        path, _, anchor = link.partition("#")
        if "://" in link or link.startswith("mailto:"):
            continue
        target = (page.parent / path).resolve() if path else page
        if not target.exists() or (anchor and anchor not in anchors(target.read_text())):
            found.append(link)
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    assert broken(page, page.read_text()) == []


def test_a_broken_link_is_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("# A page\n[a](none.md) [b](#nothing) [c](#a-page) [d](page.md) [e](page.md#none)")
    assert broken(page, page.read_text()) == ["none.md", "#nothing", "page.md#none"]


def test_sizes():
    assert (ROOT / "README.md").stat().st_size <= README_BYTES
    pages = [page for page in (ROOT / "docs").glob("*.md") if page.name not in GENERATED]
    assert sum(page.stat().st_size for page in pages) <= PAGES_BYTES
    notes = (ROOT / "docs" / "notes").glob("*.md")
    assert [note.name for note in notes if note.stat().st_size > NOTE_BYTES] == []
