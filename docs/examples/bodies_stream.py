"""Prints where the hips of everybody are: panoptic run ... --subject FILE --publish stream."""

import json

from websockets.sync.client import connect

with connect("ws://127.0.0.1:8770/") as stream:
    segments = json.loads(stream.recv())["segments"]
    for text in stream:
        for subject in json.loads(text)["subjects"]:
            print(subject["id"], segments[0], subject["root"], subject["rotations"][0])
