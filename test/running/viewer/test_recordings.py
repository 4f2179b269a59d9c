"""`panoptic view` of what is on a disk answers its page."""

import json
import subprocess
import sys

import cv2
import numpy as np
from recorded_scene import make_rig
from websockets.sync.client import connect

from panoptic_ros.io.rigs import write_rig


def test_the_first_second_of_a_folder_comes_when_it_is_asked_for(tmp_path):
    write_rig(tmp_path / "rig.json", make_rig(2))
    for camera in make_rig(2).names:
        (tmp_path / camera).mkdir()
        for k in range(4):
            cv2.imwrite(str(tmp_path / camera / f"{k:04d}.png"), np.full((480, 640, 3), 4 * k, np.uint8))
    words = ["-m", "panoptic_ros.cli.main", "view", str(tmp_path), "--port", "0", "--no-browser"]
    with subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, text=True) as program:
        try:
            assert program.stdout is not None
            address = next(word for word in program.stdout.readline().split() if word.startswith("http"))
            with connect(address.replace("http", "ws").replace("/?", "/data?"), max_size=None) as page:
                page.send(json.dumps({"block": 0, "keys": []}))
                said = [page.recv(timeout=60)]
                while isinstance(said[-1], str):
                    said.append(page.recv(timeout=60))
        finally:
            program.terminate()
    assert len(said[-1]) > 1000 and "facts" in said[0]
