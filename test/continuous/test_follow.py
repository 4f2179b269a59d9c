"""Association view by view."""

from dataclasses import replace

import captures
import numpy as np
from free_cameras import FreeCapture

from panoptic_ros.continuous.follow import follow
from panoptic_ros.domain.rig_arrays import RigArrays
from panoptic_ros.solving.frames import camera_frames

MIRROR = np.array(captures.SKELETON.mirror)


def followed(capture):
    arrays = RigArrays.of(capture.rig)
    frames = camera_frames(capture.sets, arrays, captures.SKELETON)
    times = np.array([1e-9 * (frame.stamp_ns - 1_000_000_000_000) for frame in frames])
    return frames, times, arrays, follow(frames, times, arrays, MIRROR)


def owners(capture, frames, times, arrays, track):
    """True person of every 2D person of a track."""
    found = []
    for entry in track.entries:
        frame = frames[entry.frame]
        local = capture.joints(times[entry.frame]) @ arrays.rotations[frame.camera].T
        local = local + arrays.translations[frame.camera]
        plane = local[..., :2] / local[..., 2:]
        gaps = np.nanmedian(np.linalg.norm(frame.plane[entry.person] - plane, axis=-1), axis=1)
        found.append(int(gaps.argmin()))
    return found


def test_every_view_of_two_people_who_pass_belongs_to_its_person():
    capture = FreeCapture(cameras=4, rate=8.0, speed=1.5)
    frames, times, arrays, tracks = followed(capture)
    people = [owners(capture, frames, times, arrays, track) for track in tracks]
    assert sorted({one for one in found}.pop() for found in people) == [0, 1]
    assert all(len(set(found)) == 1 for found in people)
    assert sum(map(len, people)) >= 0.99 * sum(len(frame.plane) for frame in frames)


def test_ghosts_of_single_views_start_nobody():
    rng = np.random.default_rng(4)

    def spoil(pixels, _, camera):
        if rng.random() < 0.3:
            pixels[1] += rng.normal(0.0, 200.0, 2)  # the second person is somewhere else in this view

    capture = FreeCapture(there=lambda person, time: True, spoil=spoil)
    _, _, _, tracks = followed(capture)
    assert len(tracks) == 2


def test_a_person_who_left_is_not_followed_on_other_peoples_views():
    capture = FreeCapture(there=lambda person, time: person == 0 or time < 2.0)
    _, times, _, tracks = followed(capture)
    ends = sorted(times[track.entries[-1].frame] for track in tracks)
    assert len(tracks) == 2 and ends[0] < 2.0 and ends[1] > 3.9


def test_a_person_begins_with_the_views_that_show_it_often():
    capture = FreeCapture(there=lambda person, time: person == 0 or time > 2.0 or int(1e3 * time) % 9 == 0)
    _, times, _, tracks = followed(capture)
    begins = sorted(times[track.entries[0].frame] for track in tracks)
    assert len(tracks) == 2 and begins[0] < 0.1 and 1.8 < begins[1] < 2.1


def test_people_whom_a_detector_reports_twice_are_one_person():
    rng = np.random.default_rng(2)
    capture = FreeCapture()
    for k, item in enumerate(capture.sets):
        view = item.views[0]
        if rng.random() < 0.4:
            again = view.points[:1] + rng.normal(0.0, 4.0, view.points[:1].shape)
            again[:, rng.random(19) < 0.4] = np.nan
            known = np.isfinite(again[..., 0])
            view = replace(
                view,
                points=np.concatenate([view.points, again]),
                scores=np.concatenate([view.scores, 0.5 * known]),
                person_scores=np.concatenate([view.person_scores, [0.5]]),
            )
        capture.sets[k] = replace(item, views=(view,))
    assert len(followed(capture)[3]) == 2
