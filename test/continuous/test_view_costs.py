"""2D people that a view cannot tell apart."""

import captures
import numpy as np
from free_cameras import FreeCapture

from panoptic_ros.continuous.follow import ViewTrack, ViewTracker
from panoptic_ros.continuous.motion import JointFilters
from panoptic_ros.continuous.view_costs import ambiguous
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.solving.frames import camera_frames


def test_people_who_could_exchange_their_2d_people_are_ambiguous():
    pairs = [(0, 0), (1, 1), (2, 2)]
    costs = np.array([[1.0, 1.5, 9.0], [1.2, 1.4, 9.0], [9.0, 9.0, 1.0]])
    assert ambiguous(costs, pairs) == {0, 1}
    costs[1, 0] = 4.0  # one of both fits worse now
    assert ambiguous(costs, pairs) == set()


def test_a_person_without_a_2d_person_may_be_the_one_who_is_seen():
    assert ambiguous(np.array([[1.0], [2.4]]), [(0, 0)]) == {0}
    assert ambiguous(np.array([[1.0], [np.inf]]), [(0, 0)]) == set()


def test_an_ambiguous_view_moves_a_track_little():
    capture = FreeCapture()
    arrays = RigArrays.of(capture.rig)
    frame = camera_frames(capture.sets, arrays, captures.SKELETON)[0]
    tracker = ViewTracker(arrays, np.array(captures.SKELETON.mirror))
    moved = []
    for unsure in (False, True):
        filters = JointFilters.unknown(19)
        filters.states[:] = 0.0
        filters.states[:, 0] = capture.joints(0.0)[0] + 0.05
        filters.covariances[:] = np.diag(np.repeat([0.02**2, 1.0, 100.0], 3))
        before = filters.states.copy()
        track = ViewTrack(filters, 0.0, 0, 0.0)
        track.move(0.01)
        track.take(0, 0, tracker.views[frame.camera], frame, unsure=unsure)
        moved.append(np.linalg.norm(filters.states[:, 0] - before[:, 0], axis=1).max())
        assert len(track.entries) == 1 and track.last == 0.01
    assert 0.0 < moved[1] < 0.5 * moved[0]
