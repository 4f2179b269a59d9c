"""133 joints from end to end: 2D people in a file, `solve`, and `evaluate` against the exact truth."""

import json

import numpy as np

from panoptic_ros.cli.main import main
from panoptic_ros.io.files import write_json
from panoptic_ros.io.plain_formats import write_detections
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.io.skeletons import load_skeleton, shared_names
from panoptic_ros.simulation import CLEAN, Ring, SimulatedScene, simulate
from panoptic_ros.simulation.whole_body import named_joints, project_joints

NAME = "wholebody133"
FRAMES = 8


def test_whole_bodies_are_solved_and_scored(tmp_path, capsys):
    skeleton = load_skeleton(NAME)
    take = simulate(
        SimulatedScene("test", ("talk", "reach"), Ring(5), area=1.5, degradation=CLEAN), 0, FRAMES
    )
    ticks = take.schedule.ticks
    joints = np.stack([named_joints(p, ticks, shared_names(NAME)) for p in take.people], axis=1)
    sets = [
        project_joints(take.rig, skeleton, rows, i, tick, 1.0, 0)
        for i, (tick, rows) in enumerate(zip(ticks, joints))
    ]
    write_rig(tmp_path / "rig.json", take.rig)
    write_detections(tmp_path / "detections.json", skeleton.joint_names, sets)
    frames = [
        {
            "index": item.index,
            "stamp_ns": item.stamp_ns,
            "skeletons": [
                {"id": k, "joints": person.tolist(), "scores": [1.0] * len(skeleton)}
                for k, person in enumerate(rows)
            ],
        }
        for item, rows in zip(sets, joints)
    ]
    truth = {"format": "panoptic-skeletons-1", "joint_names": list(skeleton.joint_names), "frames": frames}
    write_json(tmp_path / "truth.json", truth)
    paths = {name: str(tmp_path / f"{name}.json") for name in ("rig", "detections", "truth", "result")}
    solve = ["solve", "--rig", paths["rig"], "--detections", paths["detections"], "--out", paths["result"]]
    assert main([*solve, "--quiet"]) == 0
    capsys.readouterr()
    assert main(["evaluate", paths["truth"], paths["result"], "--json"]) == 0
    scores = json.loads(capsys.readouterr().out)
    assert scores["person_recall"] == scores["person_precision"] == 1.0
    assert scores["joint_recall"] > 0.99 and scores["mpjpe_mm"] < 6.0
    assert set(scores["mpjpe_by_joint_mm"]) == set(skeleton.joint_names)
