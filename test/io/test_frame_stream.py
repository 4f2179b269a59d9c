"""Streams of frames are whole up to their last sync, whatever cuts them."""

import gzip
import json
import os
import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.errors import DataError
from panoptic_ros.io.frame_stream import CutFileWarning, FrameStream, read_frames, whole_frames
from panoptic_ros.io.plain_formats import read_skeletons

HEAD = {"format": "panoptic-skeletons-1", "joint_names": ["a", "b"]}


def frame(k):
    return {"index": k, "stamp_ns": 10 * k, "skeletons": [{"id": k, "joints": [[k * 0.1, 1.0, 2.0], None]}]}


def stream(path, count, synced=()):
    frames = FrameStream(path, HEAD)
    for k in range(count):
        frames.add(frame(k))
        if k in synced:
            frames.sync()
    return frames


def test_content_does_not_depend_on_syncs(tmp_path):
    for name, synced in (("a", ()), ("b", (0, 3, 7))):
        stream(tmp_path / name, 9, synced).close()
    documents = [json.loads(gzip.decompress((tmp_path / name).read_bytes())) for name in "ab"]
    assert documents[0] == documents[1] == {**HEAD, "frames": [frame(k) for k in range(9)]}


def test_frames_up_to_the_last_sync_survive_a_power_cut(tmp_path, monkeypatch):
    lengths = []
    fsync = os.fsync
    monkeypatch.setattr(os, "fsync", lambda fd: (lengths.append(os.fstat(fd).st_size), fsync(fd))[1])
    path = tmp_path / "skeletons.json.gz"
    stream(path, 40, (20, 30)).close()
    data = path.read_bytes()
    for kept, whole in zip(lengths[:2], (21, 31), strict=True):
        path.write_bytes(data[:kept] + bytes(100))  # blocks that were given to the file and not written
        with pytest.warns(CutFileWarning, match=f"its {whole} whole frames were read"):
            found = read_skeletons(path)
        assert [f.stamp_ns for f in found.frames] == [10 * k for k in range(whole)]


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 12), st.floats(0.0, 1.0))
def test_any_cut_gives_a_prefix_of_the_frames(tmp_path_factory, count, share):
    path = tmp_path_factory.mktemp("cut") / "frames.json.gz"
    stream(path, count, range(0, 12, 2)).close()
    whole = path.read_bytes()
    found = whole_frames(whole[: int(share * (len(whole) - 1))])
    if found is not None:
        document, lost = found
        assert document == {**HEAD, "frames": [frame(k) for k in range(len(document["frames"]))]}
        assert lost >= 0


def test_other_damage_is_refused(tmp_path):
    path = tmp_path / "frames.json.gz"
    stream(path, 30).close()
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0x55
    path.write_bytes(data)
    with pytest.raises(DataError, match="frames.json.gz"):
        read_frames(path)
    path.write_bytes(gzip.compress(b'{"frames": [1, 2'))  # whole as a file, and no JSON
    with pytest.raises(DataError, match="frames.json.gz"):
        read_frames(path)
    packer = zlib.compressobj(9, zlib.DEFLATED, 31)  # a cut file that unpacks to far more than a stream does
    bomb = packer.compress(b'{"frames": [' + bytes(30_000_000)) + packer.flush(zlib.Z_SYNC_FLUSH)
    assert len(bomb) < 40_000
    document, _ = whole_frames(bomb)
    assert document["frames"] == []
