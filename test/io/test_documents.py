"""Documents are bounded in size, nesting and what aliases expand to; errors are one short line."""

import gzip
import os
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from panoptic_ros.errors import DataError, one_line, shown
from panoptic_ros.io import documents
from panoptic_ros.io.documents import csv_rows, decoded, parse_xml, read_json, read_text, read_yaml
from panoptic_ros.io.loading import MIB, parsing, read_bytes, unpacked

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(),
    lambda inner: st.lists(inner) | st.tuples(inner) | st.dictionaries(st.text(), inner),
    max_leaves=30,
)


@given(VALUES)
def test_a_shown_value_is_the_beginning_of_its_representation(value):
    text = shown(value, 40)
    if len(repr(value)) <= 40:
        assert text == repr(value)
    else:
        assert len(text) <= 43
        assert text.endswith("...") or "bits" in text
        assert "bits" in text or repr(value)[:20] == text[:20]


def test_a_value_of_any_size_is_shown_at_once():
    value = ["lol"]
    for _ in range(60):
        value = [value] * 10
    assert len(shown(value)) <= 63 and len(one_line(ValueError(value))) < 310
    assert shown(10**5000) == "a whole number of 16610 bits"
    assert one_line(ValueError("a\n  b" * 1000)).startswith("a ba b")
    assert one_line(ValueError()) == "ValueError"


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (KeyError("a"), "'a' is missing"),
        (IndexError("list index out of range"), "too short"),
        (RecursionError(), "nested too deeply"),
        (MemoryError(), "memory"),
        (StopIteration(), "too early"),
        (zlib.error("x"), "a value is wrong: x"),
        (OverflowError("too large"), "too large"),
    ],
)
def test_whatever_a_parser_raises_names_the_file(error, words):
    with pytest.raises(DataError, match=f"a.json: .*{words}"), parsing("a.json"):
        raise error


def test_an_attribute_of_another_type_is_told_by_its_value():
    with pytest.raises(DataError, match="'none' stands where a table is expected"), parsing("a.json"):
        "none".items()
    with pytest.raises(KeyboardInterrupt), parsing("a.json"):
        raise KeyboardInterrupt


@given(st.lists(st.binary(max_size=4000), min_size=1, max_size=5), st.integers(0, 20))
def test_members_of_a_gzip_file_are_joined(parts, padding):
    data = b"".join(gzip.compress(part, mtime=0) for part in parts) + bytes(padding)
    assert unpacked(data, "a.gz", MIB) == b"".join(parts)


def test_gzip_files_are_bounded():
    small = gzip.compress(bytes(20 * MIB), 9)
    assert len(unpacked(small, "a.gz", 32 * MIB)) == 20 * MIB  # a small file may be packed well
    with pytest.raises(DataError, match="holds more than 8 MB"):
        unpacked(small, "a.gz", 8 * MIB)
    with pytest.raises(DataError, match="unpack to more than 32 MB"):
        unpacked(gzip.compress(bytes(40 * MIB), 9), "a.gz", 1024 * MIB)
    with pytest.raises(DataError, match="parts"):
        unpacked(gzip.compress(b"") * 5000, "a.gz", MIB)
    with pytest.raises(DataError, match="cut"):
        unpacked(gzip.compress(os.urandom(1000))[:-9], "a.gz", MIB)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_texts_of_windows_are_read(tmp_path, encoding):
    (tmp_path / "a.yaml").write_text("a: [1, é]\n", encoding)
    assert read_yaml(tmp_path / "a.yaml") == {"a": [1, "é"]}
    assert list(csv_rows(decoded("a,b\r\n1,2\r\n".encode(encoding), "a.csv"), "a.csv"))[1] == (2, ["1", "2"])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: &a [*a]", "within itself"),
        ("[" * 70 + "]" * 70, "levels deep"),
        ("a: 2026-13-45", "month"),
        ("&a [1]\n--- *a", "not valid YAML"),
        ("? [a]\n: b", "not valid YAML"),
        ("!!bool foo", "foo"),
        ("a: " + "9" * 5000, "digits"),
        ("a: !!python/object/apply:os.system [x]", "not valid YAML"),
        (
            "a: &a {x: 1}\nb: &b {<<: ["
            + ", ".join(["*a"] * 99)
            + "]}\nc: &c {<<: ["
            + ", ".join(["*b"] * 99)
            + "]}\nd: {<<: ["
            + ", ".join(["*c"] * 99)
            + "]}",
            "aliases expanded",
        ),
    ],
)
def test_hostile_yaml(tmp_path, text, words):
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(DataError, match=rf"a\.yaml.*{words}") as caught:
        read_yaml(tmp_path / "a.yaml")
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400


def test_sizes_are_bounded(tmp_path, monkeypatch):
    (tmp_path / "a.yaml").write_text("#" + " " * MIB)
    with pytest.raises(DataError, match=r"a\.yaml holds more than 1 MB"):
        read_yaml(tmp_path / "a.yaml")
    with pytest.raises(DataError, match="more than 0.5 MB"):
        read_json(tmp_path / "a.yaml", MIB // 2)
    monkeypatch.setattr(documents, "MOST_VALUES", 10)
    assert read_text(tmp_path / "a.yaml").startswith("#")


def test_entities_of_xml_are_refused():
    with pytest.raises(DataError, match="entities"):
        parse_xml("<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>", "a.xml")


def test_pipes_of_a_shell_are_read_and_named_pipes_are_not(tmp_path):
    reading, writing = os.pipe()
    os.write(writing, b"[1]")
    os.close(writing)
    assert read_json(f"/proc/self/fd/{reading}") == [1]
    os.close(reading)
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", "/dev/zero"):
        with pytest.raises(DataError, match="device or a named pipe"):
            read_bytes(path)
