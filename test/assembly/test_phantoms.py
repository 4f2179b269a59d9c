"""Two views that a third one contradicts must agree on most joints, unless three agreed before."""
from types import SimpleNamespace

import numpy as np
import pytest

import panoptic_ros.assembly.phantoms as phantoms
from panoptic_ros.assembly.phantoms import DOUBTED_SHARE, agreed_shares


@pytest.mark.parametrize("seeing, doubted", [(2, False), (3, True)])
def test_who_is_doubted(monkeypatch, seeing, doubted):
    def seen(evidence, positions):
        return np.arange(5)[None].repeat(len(positions), 0) < seeing

    monkeypatch.setattr(phantoms, "seeing_views", seen)
    member = np.full((4, 5), -1)
    member[:3, :2] = 0  # two views
    member[3, :3] = 0  # three
    found = SimpleNamespace(grouping=SimpleNamespace(member=member), who=np.array([0, 1, -1, -1]))
    prediction = SimpleNamespace(established=np.array([True, False]))
    scene = SimpleNamespace(evidence=None)
    shares = agreed_shares(scene, found, prediction, np.zeros((4, 3, 3)), 0.5)
    assert (shares == [0.5, *(2 * [DOUBTED_SHARE if doubted else 0.5]), 0.5]).all()
    assert agreed_shares(scene, found, prediction, np.zeros((4, 3, 3)), 0.9).tolist() == 4 * [0.9]
