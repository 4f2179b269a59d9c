"""How far two people are apart: python distance.py"""

import numpy as np
import rclpy
from panoptic_msgs.msg import Skeletons


def show(message):
    places = {p.id: np.nanmean(np.reshape(p.positions, (-1, 3)), axis=0) for p in message.skeletons}
    for a in places:
        for b in (b for b in places if b > a):
            print(f"{a} and {b}: {np.linalg.norm(places[a] - places[b]):.2f} m", flush=True)


rclpy.init()
node = rclpy.create_node("distance")
node.create_subscription(Skeletons, "/skeletons", show, 10)
rclpy.spin(node)
