"""Clocks from motion while a bag is run."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from recordings import write_bag

from panoptic_ros.cli.main import main
from panoptic_ros.io.files import read_json
from panoptic_ros.io.plain_formats import write_detections
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.simulation import simulate
from panoptic_ros.simulation.scenes import scene
from panoptic_ros.simulation.skeleton import JOINTS, SKELETON

LATE_S = 0.04  # of the second camera


def take():
    """Walkers and runners for 1.5 s; the second camera's stamps are early."""
    simulation = simulate(scene("unsync-5v"), 3, 45)
    name = simulation.rig.names[1]
    sets = [
        replace(
            item,
            views=tuple(
                replace(v, stamp_ns=v.stamp_ns - round(1e9 * LATE_S)) if v.camera == name else v
                for v in item.views
            ),
        )
        for item in simulation.detection_sets()
    ]
    return simulation.rig, sets


def test_run_finds_offsets_beside_the_chain_and_the_next_one_takes_them(tmp_path, capsys):
    rig, sets = take()
    views = sorted((v for item in sets for v in item.views), key=lambda v: v.stamp_ns)
    bag = write_bag(tmp_path / "bag", views, rig, SKELETON)
    arguments = ["run", "--bag", str(bag), "--out", str(tmp_path / "out"), "--in-process"]
    settings = ["--set", "offsets.active=true", "--set", "offsets.block_s=0.7"]
    assert main([*arguments, *settings]) == 0
    assert read_json(tmp_path / "out" / "skeletons.json.gz")["frames"]
    saved = tmp_path / "saved.json"
    (tmp_path / "out" / "offsets.json").rename(saved)
    found = read_json(saved)
    assert found["format"] == "panoptic-clocks-1"
    assert found["cameras"][rig.names[1]]["offset_s"] == pytest.approx(LATE_S, abs=4e-3)
    assert any(f"from motion: {rig.names[1]} +" in text for text in told(tmp_path / "out"))

    assert main([*arguments, "--offsets", str(saved)]) == 0  # from the first frame on
    assert not (tmp_path / "out" / "offsets.json").exists()
    assert any(text.startswith(f"{rig.names[1]}  ") and "+-" in text for text in told(tmp_path / "out"))
    assert read_json(tmp_path / "out" / "skeletons.json.gz")["frames"][0]["skeletons"]

    assert main([*arguments, "--offsets", str(saved), "--set", "sync.delays_ms=a=1"]) == 2
    assert "--offsets" in capsys.readouterr().err


def told(out):
    return [notice["text"] for notice in read_json(out / "report.json")["notices"]]


def test_solve_prints_and_writes_the_offsets(tmp_path, capsys):
    rig, sets = take()
    write_rig(tmp_path / "rig.json", rig)
    write_detections(tmp_path / "detections.json.gz", JOINTS, sets)
    files = ["--rig", str(tmp_path / "rig.json"), "--detections", str(tmp_path / "detections.json.gz")]
    out = ["--out", str(tmp_path / "s.json.gz"), "--offsets-out", str(tmp_path / "offsets.json")]
    assert main(["solve", *files, *out]) == 2
    assert "--offsets-from-motion" in capsys.readouterr().err
    assert main(["solve", *files, *out, "--offsets-from-motion"]) == 0
    assert "clocks from motion" in capsys.readouterr().out
    saved = read_json(tmp_path / "offsets.json")
    assert saved["format"] == "panoptic-clocks-1"
    assert saved["reference_ns"] == min(view.stamp_ns for item in sets for view in item.views)
    found = [saved["cameras"][name]["offset_s"] for name in rig.names]
    assert abs(found[1] - LATE_S) < 2e-3 and saved["cameras"][rig.names[1]]["observable"]
    assert max(abs(offset) for i, offset in enumerate(found) if i != 1) < 2e-3

    corrected = read_json(tmp_path / "s.json.gz")
    assert main(["solve", *files, *out[:2], "--offsets", str(tmp_path / "offsets.json")]) == 0
    assert f"{rig.names[1]}    +" in capsys.readouterr().out
    again = read_json(tmp_path / "s.json.gz")
    joints = [np.array(d["frames"][20]["skeletons"][0]["joints"], float) for d in (corrected, again)]
    np.testing.assert_allclose(*joints, atol=1e-3)  # offsets within chance are applied, too


INTERRUPTED = """
import os, signal
from panoptic_ros.cli.main import program
from panoptic_ros.view.progress import PassBar

PassBar.show = lambda bar, share, doing: share > 0.1 and os.kill(os.getpid(), signal.SIGINT)
program()
"""


def test_a_signal_while_clocks_are_sought_leaves_no_file(tmp_path):
    rig, sets = take()
    write_rig(tmp_path / "rig.json", rig)
    write_detections(tmp_path / "detections.json.gz", JOINTS, sets)
    before = sorted(tmp_path.iterdir())
    files = ["--rig", str(tmp_path / "rig.json"), "--detections", str(tmp_path / "detections.json.gz")]
    out = ["--out", str(tmp_path / "s.json.gz"), "--offsets-out", str(tmp_path / "offsets.json")]
    command = [sys.executable, "-c", INTERRUPTED, "solve", *files, *out, "--offsets-from-motion"]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (ended.returncode, ended.stdout, ended.stderr) == (2, "", "panoptic solve: interrupted\n")
    assert sorted(tmp_path.iterdir()) == before


def test_offsets_that_cannot_be_meant_are_told(tmp_path, capsys):
    rig, sets = take()
    write_rig(tmp_path / "rig.json", rig)
    write_detections(tmp_path / "detections.json.gz", JOINTS, sets[:2])
    (tmp_path / "o.json").write_text('{"format": "panoptic-offsets-1", "cameras": []}')
    files = ["--rig", str(tmp_path / "rig.json"), "--detections", str(tmp_path / "detections.json.gz")]
    saved = ["--out", str(tmp_path / "s.json.gz"), "--offsets", str(tmp_path / "o.json")]
    assert main(["solve", *files, *saved]) == 2
    assert "corrects none of the cameras" in capsys.readouterr().err
    assert main(["solve", *files, *saved, "--offsets-from-motion"]) == 2
    assert "not both" in capsys.readouterr().err
