"""Random damage to files, by bytes, words or values; the same seed repeats the same damage."""

from __future__ import annotations

import gzip
import json
import random
import re
from collections.abc import Callable
from typing import Any

from panoptic_ros.io.loading import GZIP

Mutation = Callable[[bytes, random.Random], bytes]
WORDS = re.compile(rb'"[^"\n]*"|[-+\w.]+|[\[\]{}:,<>=]')  # tokens of JSON, YAML, TOML, XML, CSV and BVH
DIGITS = 400  # digits of an integer beyond the range of a float
DEEP = 5000  # levels of nesting; Python's parsers accept some hundred
HOSTILE_WORDS = (
    b"",
    b"null",
    b"true",
    b"nan",
    b"-inf",
    b"1e400",
    b"-1",
    b"0",
    b"0.5",
    b"1e-320",
    b"9" * DIGITS,
    b"9" * 5000,
    b"word",
    b'"word"',
    b"[]",
    b"{}",
    b"[[]]",
    b"{a: 1}",
    b"2026-13-45",
    b"2026-11-27",
    b"!!python/none x",
    b"!!int x",
    b"*a",
    b"&a [*a]",
    b"[" * DEEP,
    b"{a: " * 900,
    b"<a>",
    b"\0",
    b"\xff\xfe",
    b"\r",
    b"a" * 140_000,
    b"\xef\xbb\xbf",
    b"18446744073709551616",
    b"0x7f",
    b"1_000",
    b"1:30:00",
    b",",
    b":",
    b"?",
    b"%",
)
HOSTILE_VALUES: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    -1,
    1,
    0.5,
    1e-320,
    1e308,
    -1e308,
    float("inf"),
    float("nan"),
    10**DIGITS,
    -(2**63),
    2**64,
    "",
    "word",
    "a" * 3000,
    "\0",
    "\ud800",
    "/",
    "..",
    "1",
    [],
    [[]],
    [None],
    [1, "a"],
    [[1], [2, 3]],
    ["a"] * 40,
    {},
    {"a": 1},
    {"": None},
    [{}],
    {"name": "a"},
    [1.0, 2.0, 3.0],
    [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
)


def mutated(data: bytes, rng: random.Random) -> bytes:
    """Return a damaged copy; of a gzip file, either the compressed bytes or the content is damaged."""
    if data[:2] == GZIP and rng.random() < 0.7:
        return gzip.compress(mutated(gzip.decompress(data), rng), 1, mtime=0)
    mutations: tuple[Mutation, ...] = BYTES if b"\0" in data[:4096] else TEXT
    for _ in range(rng.choice((1, 1, 1, 2, 5))):
        data = rng.choice(mutations)(data, rng)
    return data


def _flip(data: bytes, rng: random.Random) -> bytes:
    """Flip up to eight bits."""
    found = bytearray(data)
    for _ in range(rng.randint(1, 8) if found else 0):
        found[rng.randrange(len(found))] ^= 1 << rng.randrange(8)
    return bytes(found)


def _flip_early(data: bytes, rng: random.Random) -> bytes:
    """Replace bytes of the first kilobyte, where binary formats have their headers."""
    found = bytearray(data)
    for _ in range(rng.randint(1, 4) if found else 0):
        found[rng.randrange(min(len(found), 1024))] = rng.choice((0, 1, 0x7F, 0x80, 0xFF, rng.randrange(256)))
    return bytes(found)


def _cut(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randint(0, len(data))]


def _splice(data: bytes, rng: random.Random) -> bytes:
    """Copy a part of the file to another position in it."""
    begin, end = sorted(rng.randint(0, len(data)) for _ in range(2))
    at = rng.randint(0, len(data))
    return data[:at] + data[begin : min(end, begin + 4096)] + data[at:]


def _delete(data: bytes, rng: random.Random) -> bytes:
    begin = rng.randint(0, len(data))
    return data[:begin] + data[begin + rng.choice((1, 2, 4, 16, 256)) :]


def _blank(data: bytes, rng: random.Random) -> bytes:
    """Overwrite a part with one value, like a disk that loses a block."""
    begin, count = rng.randint(0, len(data)), rng.choice((4, 64, 512))
    return data[:begin] + bytes([rng.choice((0, 255, 32))]) * count + data[begin + count :]


def _word(data: bytes, rng: random.Random) -> bytes:
    """Replace a word, number or bracket by a hostile word."""
    words = list(WORDS.finditer(data))
    if not words:
        return rng.choice(HOSTILE_WORDS)
    word = rng.choice(words)
    return data[: word.start()] + rng.choice(HOSTILE_WORDS) + data[word.end() :]


def _swap(data: bytes, rng: random.Random) -> bytes:
    """Exchange two words."""
    words = list(WORDS.finditer(data))
    if len(words) < 2:
        return data
    a, b = sorted(rng.sample(words, 2), key=lambda word: word.start())
    return data[: a.start()] + b[0] + data[a.end() : b.start()] + a[0] + data[b.end() :]


def _lines(data: bytes, rng: random.Random) -> bytes:
    """Delete, repeat or move a line."""
    lines = data.splitlines(keepends=True)
    if not lines:
        return b"\n"
    line = lines.pop(rng.randrange(len(lines)))
    for _ in range(rng.randint(0, 2)):
        lines.insert(rng.randint(0, len(lines)), line)
    return b"".join(lines)


def _encoded(data: bytes, rng: random.Random) -> bytes:
    """Write the text in another encoding."""
    text = data.decode("utf-8", "replace")
    return text.encode(rng.choice(("utf-16", "utf-16-le", "utf-8-sig", "utf-32")), "replace")


def _value(data: bytes, rng: random.Random) -> bytes:
    """Replace, delete, rename or repeat a value of a JSON document at any depth."""
    try:
        document = json.loads(data)
    except (ValueError, RecursionError):
        return _word(data, rng)
    place, key = _place(document, rng)
    if place is None:
        document = rng.choice(HOSTILE_VALUES)
    elif isinstance(place, dict):
        action = rng.random()
        value = place.pop(key)
        if action < 0.6:
            place[key] = rng.choice(HOSTILE_VALUES)
        elif action < 0.7:
            place[rng.choice(("", "a", "0", key + "x"))] = value
        elif action < 0.8:
            other = rng.choice(list(place) or [key])
            place[key], place[other] = place.get(other), value
    else:
        action = rng.random()
        if action < 0.6:
            place[key] = rng.choice(HOSTILE_VALUES)
        elif action < 0.8:
            del place[key]
        else:
            place.insert(rng.randint(0, len(place)), place[key])
    return json.dumps(document).encode()


def _place(document: Any, rng: random.Random) -> tuple[Any, Any]:
    """Choose a container of a document and a key of it; (None, None) = the whole document."""
    found: tuple[Any, Any] = (None, None)
    here = document
    while isinstance(here, dict | list) and here and rng.random() < 0.85:
        key = rng.choice(list(here)) if isinstance(here, dict) else rng.randrange(len(here))
        found, here = (here, key), here[key]
    return found


BYTES: tuple[Mutation, ...] = (_flip, _flip_early, _flip_early, _cut, _splice, _delete, _blank)
TEXT: tuple[Mutation, ...] = (
    _flip,
    _cut,
    _splice,
    _delete,
    _blank,
    _word,
    _word,
    _word,
    _swap,
    _lines,
    _encoded,
    _value,
    _value,
    _value,
    _value,
)
