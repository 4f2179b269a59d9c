"""Skeletons written one by one are the same file as those written at once."""

import gzip

import pytest
from stage_cases import cases

from panoptic_ros.domain import RefinedPoseSet
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.pipeline import records_of
from panoptic_ros.io.plain_formats import SkeletonStream, read_skeletons, write_skeletons


@pytest.fixture(scope="module")
def poses():
    case = cases()["refinement"]
    configs = configure({"refinement": case.values})
    return case.context.skeleton, records_of("skeletons", case.items, configs, case.context, ["refinement"])


@pytest.mark.parametrize("count", [0, 1, None])
def test_the_bytes_are_the_same(poses, count, tmp_path):
    skeleton, found = poses
    found = found[:count]
    assert all(isinstance(item, RefinedPoseSet) for item in found)
    write_skeletons(tmp_path / "at_once.json.gz", skeleton.joint_names, found)
    stream = SkeletonStream(tmp_path / "stream.json.gz", skeleton.joint_names)
    for item in found:
        stream.take(item)
    stream.close()
    at_once, streamed = ((tmp_path / f"{name}.json.gz").read_bytes() for name in ("at_once", "stream"))
    assert streamed == at_once and stream.count == len(found)
    read_skeletons(tmp_path / "stream.json.gz")
    write_skeletons(tmp_path / "plain.json", skeleton.joint_names, found)
    assert (tmp_path / "plain.json").read_bytes() == gzip.decompress(at_once)


def test_an_error_on_the_way_leaves_nothing(poses, tmp_path):
    skeleton, found = poses

    def cut():
        yield found[0]
        raise KeyboardInterrupt

    (tmp_path / "s.json.gz").write_bytes(b"before")
    with pytest.raises(KeyboardInterrupt):
        write_skeletons(tmp_path / "s.json.gz", skeleton.joint_names, cut())
    assert [path.name for path in tmp_path.iterdir()] == ["s.json.gz"]
    assert (tmp_path / "s.json.gz").read_bytes() == b"before"
