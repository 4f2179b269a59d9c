"""Refinement of a whole recording against exact motion."""

from dataclasses import replace
from functools import cache

import captures
import patch_scene
import pytest

from panoptic_ros.domain import PatchTracks
from panoptic_ros.errors import UsageError
from panoptic_ros.graph.build import configure
from panoptic_ros.graph.offline_refinement import OfflineRefinement

WRIST = list(captures.SKELETON.joint_names).index("lWrist")
COUNT, GAP = 14, range(3, 12)  # longer than `refinement.max_gap`


@cache
def scene():
    """Somebody who turns and goes with a wrist that is missing for long; and his true joints."""
    return patch_scene.recording_with_gap(COUNT, GAP, WRIST)


@cache
def refined_scene():
    return refined(scene()[0])


def refined(items, active=True):
    configs = configure({"patches": {"active": active}})
    refinement = OfflineRefinement(configs, captures.CONTEXT)
    found = [output for item in items for output in refinement.take(item)]
    return [*found, *refinement.flush()]


def test_a_long_gap_is_filled_where_the_surface_says():
    found, truth = refined_scene(), scene()[1]
    assert [output.index for output in found] == list(range(COUNT))
    for output in found:
        assert output.positions[0][WRIST] == pytest.approx(truth[output.index][WRIST], abs=0.01)


def test_without_patches_it_smooths():
    items, truth = scene()
    found = refined([item for item in items if not isinstance(item, PatchTracks)], active=False)
    assert [output.index for output in found] == list(range(COUNT))
    assert found[2].positions[0] == pytest.approx(truth[2], abs=0.02)


def test_sets_that_come_late_are_left_out():
    items = [item for item in scene()[0] if not isinstance(item, PatchTracks)]
    found = refined([*items, replace(items[0], index=99)], active=False)
    assert [output.index for output in found] == list(range(COUNT))


def test_bodies_are_refused():
    with pytest.raises(UsageError, match=r"refinement\.bodies"):
        OfflineRefinement(configure({"refinement": {"bodies": True}}), captures.CONTEXT)
