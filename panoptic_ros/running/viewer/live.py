"""Shows the running graph in a web page, for `panoptic view --live`."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable

from rclpy.utilities import try_shutdown

from panoptic_ros.io.interruption import first_request_told
from panoptic_ros.nodes.listeners.viewer_node import ViewerNode
from panoptic_ros.nodes.middleware.runtime import make_executor, start_ros
from panoptic_ros.running.processes.children import LISTENER, prepare_environment
from panoptic_ros.view.page.live import LiveScene
from panoptic_ros.view.page.live_talk import LiveTalk
from panoptic_ros.view.page.server import PageServer

LOOK_S = 0.2
Ready = Callable[[str], None]  # called with the address of the page


def view_live(host: str, port: int, ready: Ready, namespace: str = "") -> None:
    """Serve the live graph until a request to end.

    Args:
        namespace: namespace of the graph.

    Raises:
        EnvironmentProblem: if the address cannot be opened for listening, or ROS does not start.
    """
    prepare_environment(LISTENER)
    scene = LiveScene(f"live graph{f' /{namespace}' if namespace else ''}")
    start_ros([])
    node, executor, over = ViewerNode(scene, namespace), make_executor(), threading.Event()
    executor.add_node(node)

    def spin() -> None:
        while not over.is_set():
            executor.spin_once(timeout_sec=LOOK_S)

    spinning = threading.Thread(target=spin, daemon=True)
    try:
        with first_request_told(True) as asked:
            spinning.start()
            asyncio.run(_serve(scene, host, port, ready, asked))
    finally:
        over.set()
        spinning.join(5.0)
        executor.shutdown()
        node.destroy_node()
        try_shutdown()


async def _serve(scene: LiveScene, host: str, port: int, ready: Ready, asked: Callable[[], bool]) -> None:
    async with PageServer(LiveTalk(scene), host, port).listening() as address:
        ready(address)
        while not asked():
            await asyncio.sleep(LOOK_S)
