"""What guidance expects: motion, forgetting, firm places, exchanged sides."""
import numpy as np

from panoptic_ros.consensus.guidance import FIRM_TIME, Guidance

MIRROR = np.array([0, 2, 1])
GROUPS = np.array([-1, 0, 0])
DT = 1.0 / 30.0


def told(guidance, who, positions, views=None, exchanged=0.0):
    """One instant's skeletons, 5 mm exact."""
    positions = np.asarray(positions, float)
    covariances = np.full((*positions.shape[:2], 3, 3), 25e-6) * np.eye(3)
    covariances[np.isnan(positions[..., 0])] = np.nan
    guidance.update(np.array(who), positions, covariances, np.full((len(positions), 1), exchanged), views)


def body(offset=0.0):
    return np.array([[0.0, 0, 1], [0, 0.2, 1], [0, -0.2, 1]]) + [offset, 0, 0]


def test_a_steady_walk_is_foreseen():
    guidance, dt = Guidance(MIRROR, GROUPS, 0.5, 10.0), DT
    for i in range(30):
        guidance.predict(dt)
        told(guidance, [0 if i else -1], [body(1.5 * dt * i)])
    expected = guidance.predict(dt)
    assert np.abs(expected.positions[0] - body(1.5 * dt * 30)).max() < 2e-3
    assert np.abs(expected.velocities[0] - [1.5, 0, 0]).max() < 0.05


def test_who_is_not_seen_is_forgotten():
    guidance = Guidance(MIRROR, GROUPS, 0.5, 10.0)
    guidance.predict(0.0)
    told(guidance, [-1, -1], [body(), body(2.0)])
    for _ in range(20):
        guidance.predict(DT)
        told(guidance, [0], [body()])
    assert len(guidance.predict(DT).positions) == 1


def test_places_are_firm_for_a_moment_after_three_views_agreed():
    guidance = Guidance(MIRROR, GROUPS, 0.5, 10.0)
    guidance.predict(0.0)
    told(guidance, [-1], [body()], views=np.array([[3, 2, 5]]))
    assert guidance.predict(0.5 * FIRM_TIME).firm.tolist() == [[True, False, True]]
    told(guidance, [0], [body()], views=np.array([[2, 3, 2]]))
    assert guidance.predict(0.6 * FIRM_TIME).firm.tolist() == [[False, True, False]]


def test_nothing_is_firm_without_numbers_of_views():
    guidance = Guidance(MIRROR, GROUPS, 0.5, 10.0)
    guidance.predict(0.0)
    told(guidance, [-1], [body()])
    assert not guidance.predict(DT).firm.any()


def test_sides_that_most_views_see_exchanged_are_exchanged():
    guidance = Guidance(MIRROR, GROUPS, 0.5, 10.0)
    guidance.predict(0.0)
    told(guidance, [-1], [body()], exchanged=2.0)
    assert np.abs(guidance.predict(DT).positions[0] - body()[MIRROR]).max() < 1e-9
