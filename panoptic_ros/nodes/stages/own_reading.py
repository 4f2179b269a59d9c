"""What a node of stages does about the cameras that it reads itself."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import Any

from rclpy.node import Node

from panoptic_ros.capture import Note
from panoptic_ros.domain import Rig, ViewFrame
from panoptic_ros.errors import PanopticError
from panoptic_ros.graph.build import make_stage, rows_in_use
from panoptic_ros.graph.flow import Flow
from panoptic_ros.graph.host import Host, Key
from panoptic_ros.graph.nodes import NODES
from panoptic_ros.graph.side_by_side import TABLE, SideBySide
from panoptic_ros.graph.topics import TOPICS
from panoptic_ros.graph.wiring import Table, Wiring
from panoptic_ros.nodes.flow.credit import Credit
from panoptic_ros.nodes.stages.live_cameras import LiveCameras
from panoptic_ros.nodes.stages.own_cameras import ImagesSent, OwnCameras, OwnInput, own_input
from panoptic_ros.nodes.stages.recordings_read import RecordingsRead
from panoptic_ros.params import Config
from panoptic_ros.stage import StageContext

NONE = OwnCameras({})


class OwnReading:
    """Cameras of a node: recordings, or live.

    Args:
        put: takes (topic and camera, record) when the stages want it (replay), on the node's worker.
        end: told of the topics and cameras of which no more comes.
        note: takes what is known after the last frame of a recording.
    """

    def __init__(
        self,
        node: Node,
        flow: Flow,
        own: OwnCameras | None,
        put: Callable[[OwnInput, Any], None],
        end: Callable[[Key], None],
        note: Note,
    ):
        self._node, self._flow, self._own = node, flow, own or NONE
        self._put, self._end, self._note = put, end, note
        self._inputs: dict[Key, OwnInput] = {}
        self._recordings: RecordingsRead | None = None
        self._live: LiveCameras | None = None
        threads = self._own.threads
        live = flow.name == "live"
        self.pool: Executor | None = ThreadPoolExecutor(threads) if live and threads > 1 else None

    @property
    def table(self) -> Table:
        """The rows of stages, with what was looked at ahead in the place of detection."""
        return NODES if self.looks is None else TABLE

    @property
    def looks(self) -> SideBySide | None:
        """What looks ahead at images (replay), if they do not influence each other."""
        return None if self._recordings is None else self._recordings.looks

    def open(
        self,
        rig: Rig,
        configs: Mapping[str, Config],
        context: StageContext,
        used: Collection[str],
        shifts: Mapping[str, int],
    ) -> None:
        """Open recordings (replay).

        Args:
            configs: of the node's stages. used: ports that a parameter switches on. shifts: by camera, ns.

        Raises:
            UserError: as the opening of sources.
        """
        if not self._own.sources or self._flow.name == "live":
            return
        ahead = credit = None
        wiring = Wiring(list(configs), table=rows_in_use(used))
        looker = wiring.specs[wiring.readers["image"][0].stage]
        if looker.apart:
            ahead = make_stage(looker.name, configs[looker.name], context)
        if all(spec.apart for spec in wiring.specs):
            out = TOPICS["skeletons"]
            credit = Credit(self._node, self._flow, out.name, out.message, self._flow.window)
        self._recordings = RecordingsRead(self._own, rig, self._sent(rig), ahead, credit, shifts, self._note)

    def owners(self, owners: Mapping[str, list[str]]) -> dict[str, list[str]]:
        """Who gives each topic to the stages: of cameras that are read here, what their recordings hold."""
        if self._recordings is None:
            return dict(owners)
        keys = self._recordings.keys
        return {
            topic: [owner for owner in found if not self.reads(topic, owner) or (topic, owner) in keys]
            for topic, found in owners.items()
        }

    def reads(self, topic: str, owner: str) -> bool:
        """Whether what a camera gives on a topic is read here; a device of its name may hear or move."""
        return TOPICS[topic].scope == "camera" and owner in self._own.sources

    def inputs(self, present: Sequence[Key]) -> list[OwnInput]:
        """The inputs of those of the topics and owners that are read here."""
        self._inputs = {key: own_input(self._node, *key) for key in present if self.reads(*key)}
        return list(self._inputs.values())

    def start(
        self, rig: Rig, take: Callable[[OwnInput, ViewFrame], None], failed: Callable[[PanopticError], None]
    ) -> None:
        """Begin to read live cameras; see `LiveCameras`."""
        if self._own.sources and self._flow.name == "live":
            inputs = {camera: self._inputs["image", camera] for camera in self._own.sources}
            self._live = LiveCameras(self._own, rig, inputs, self._sent(rig), take, failed)

    def fetch(self, host: Host | None) -> bool:
        """Hand over what the stages want next of a recording; whether there is more to do."""
        if self._recordings is None or host is None:
            return False
        return self._recordings.fetch(host, self._came, self._end)

    def duration_ns(self, stage: str, step_ns: int) -> int:
        """Of a step of a stage: where images were looked at ahead, of that look."""
        ahead = self.looks is not None and self.table[stage] is not NODES[stage]
        return self.looks.duration_ns if self.looks is not None and ahead else step_ns

    def close(self) -> None:
        """End all threads; close files and devices."""
        for cameras in (self._recordings, self._live):
            if cameras is not None:
                cameras.close()
        if self.pool is not None:
            self.pool.shutdown(wait=False, cancel_futures=True)

    def _sent(self, rig: Rig) -> Callable[[Any], None]:
        return ImagesSent(self._node, self._flow, rig, self._own).send

    def _came(self, key: Key, record: Any) -> None:
        entry = self._inputs[key]
        if isinstance(record, ViewFrame):
            entry.came(record, None)
        self._put(entry, record)
