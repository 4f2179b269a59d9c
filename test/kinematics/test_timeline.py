"""When instants are due."""

import pytest

from panoptic_ros.kinematics.people.seen_people import NEAR_NS
from panoptic_ros.kinematics.timeline import Timeline

MS = 1_000_000


@pytest.mark.parametrize(("period_ms", "late_ms"), [(16, 30), (16, 5)])
def test_instants_wait_for_views_that_take_a_while(period_ms, late_ms):
    """Views go through association and tracking before they come; samples of IMUs come at once."""
    timeline, newest_view, found = Timeline(60.0), -1, []
    for now in range(1000, 3000):
        if now % 16 == 0:
            assert timeline.came("imu", now * MS) == ""
        if now >= 1000 + late_ms and (now - late_ms) % period_ms == 0:
            newest_view = (now - late_ms) * MS
            assert timeline.came(0, newest_view) == ""
        while (stamp := timeline.due()) is not None:
            found.append((stamp, newest_view))
    settled = [row for row in found if row[0] > 1500 * MS]
    assert len(settled) > 80
    assert all(view >= stamp - NEAR_NS for stamp, view in settled)
