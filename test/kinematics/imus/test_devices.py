"""How devices are looked at while data come."""

import numpy as np
from bodies import BODY

from panoptic_ros.domain.subjects import Device, Subject
from panoptic_ros.kinematics.config import KinematicsConfig
from panoptic_ros.kinematics.imus.devices import WornDevices
from panoptic_ros.kinematics.imus.measured import ImuMeasurements
from panoptic_ros.kinematics.imus.mounting import MountingEstimate


def test_people_are_looked_at_one_after_the_other_five_times_a_second(monkeypatch):
    calls, looks = [], []
    monkeypatch.setattr(MountingEstimate, "look", lambda self, *seen: calls.append(self))
    measured = ImuMeasurements(np.ones(1, bool), np.eye(3)[None], np.zeros((1, 3)))
    for number in range(4):
        subject = Subject(number, BODY, (Device("back", 0, np.zeros(3), np.eye(3)),))
        devices = WornDevices(KinematicsConfig(), subject, BODY.chain, {"back": np.eye(3)}, 0.0)
        for instant in range(60):
            devices.passed(1.0 / 60.0)
            devices.look(measured, None, None, 1, (np.zeros(1, int), None))
            looks += [instant] * (len(calls) - len(looks))
    assert len(looks) == 20 and len(set(looks)) == 20
