"""Stages that compute nothing of use, a table of them, and hosts with a transport that delays as it likes."""

from __future__ import annotations

import json
import random
from collections import deque
from dataclasses import dataclass

from panoptic_ros.domain import EndOfStream
from panoptic_ros.graph import topics
from panoptic_ros.graph.host import Host, lanes_of
from panoptic_ros.graph.nodes import NodeSpec, Port
from panoptic_ros.graph.pipeline import Pipeline
from panoptic_ros.graph.topics import TOPICS, Topic
from panoptic_ros.params import Config
from panoptic_ros.stage import StepResult

OWNERS = ("x", "y", "z")


@dataclass(frozen=True)
class Word:
    """A record: what it was made of, as text."""

    stamp_ns: int
    text: str
    camera: str = ""


class View(Word): ...


class Wide(Word): ...


class Seen(Word): ...


class Group(Word): ...


class Linked(Word): ...


class Solved(Word): ...


class Known(Word): ...


class Hint(Word): ...


class Patch(Word): ...


class Final(Word): ...


TOY_TOPICS = {
    topic.key: topic
    for topic in (
        Topic("view", "{owner}/view", "View", "-", "camera", by_stamp=True),
        Topic("wide", "{owner}/wide", "Wide", "-", "camera", by_stamp=True),
        Topic("seen", "{owner}/seen", "Seen", "-", "camera", by_stamp=True),
        Topic("group", "group", "Group", "-"),
        Topic("linked", "linked", "Linked", "-"),
        Topic("solved", "solved", "Solved", "-"),
        Topic("known", "known", "Known", "-"),
        Topic("hint", "hint", "Hint", "-", latched=True),
        Topic("patch", "patch", "Patch", "-"),
        Topic("final", "final", "Final", "-"),
    )
}


class ToyConfig(Config):
    """No parameters."""


class Toy:
    """Remembers a digest of all that it took, and gives records that depend on it."""

    gives: type[Word] = Word

    def __init__(self, config, context):
        self.log = context.extras["logs"].setdefault(type(self).__name__, [])
        self.reset()

    def reset(self):
        self.memory = 0

    def note(self, item):
        text = (
            f"end of {item.camera}" if isinstance(item, EndOfStream) else f"{type(item).__name__} {item.text}"
        )
        self.log.append(text)
        self.memory = hash_of(f"{self.memory} {text}")

    def word(self, stamp_ns, text, camera="", kind=None):
        return (kind or self.gives)(stamp_ns, f"{text}/{self.memory % 997}", camera)

    def step(self, item):
        self.note(item)
        return StepResult((self.word(item.stamp_ns, item.text, item.camera),))

    def flush(self):
        self.reset()
        return StepResult()

    def forget(self):
        self.reset()

    def state(self):
        return json.dumps({k: v for k, v in vars(self).items() if k != "log"}).encode()

    def begin(self, state):
        vars(self).update(json.loads(state))


def hash_of(text):
    """A number that does not depend on the process."""
    number = 7
    for letter in text:
        number = (number * 31 + ord(letter)) % 1_000_000_007
    return number


class Looker(Toy):
    """Two inputs of one camera: the wide image counts when it comes before the narrow one."""

    gives = Seen

    def reset(self):
        self.memory, self.wide = 0, {}

    def step(self, item):
        if isinstance(item, Wide):
            self.wide[item.camera] = item.text
            return StepResult()
        wide = self.wide.pop(item.camera, "-")  # each camera on its own: no memory over cameras
        self.log.append(f"{item.camera} {item.text} {wide}")
        return StepResult((Seen(item.stamp_ns, f"{item.text}+{wide}", item.camera),))


class Grouper(Toy):
    """Like sync: hints come back, one record in three gives sets, at times two of them; ends release more."""

    gives = Group

    def reset(self):
        self.memory, self.held = 0, []

    def step(self, item):
        self.note(item)
        if isinstance(item, (Hint, EndOfStream)):
            given = self.held[:1] if self.memory % 2 else []
            self.held = self.held[len(given) :]
        else:
            self.held.append((item.stamp_ns, item.text))
            given = self.held[: (0, 0, 1, 2)[self.memory % 4]]
            self.held = self.held[len(given) :]
        return StepResult(tuple(self.word(stamp, text) for stamp, text in given))

    def flush(self):
        given = tuple(self.word(stamp, text) for stamp, text in self.held)
        self.reset()
        return StepResult(given)


class Linker(Toy):
    """Knows who was known an instant before."""

    gives = Linked

    def step(self, item):
        self.note(item)
        return StepResult() if isinstance(item, Known) else super_word(self, item)


def super_word(stage, item):
    return StepResult((stage.word(item.stamp_ns, item.text),))


class Solver(Toy):
    gives = Solved


class Knower(Toy):
    """At times gives nothing, at times the last one once more."""

    gives = Known

    def step(self, item):
        self.note(item)
        return StepResult(
            tuple(self.word(item.stamp_ns, f"{item.text}.{k}") for k in range((1, 0, 2)[self.memory % 3]))
        )


class Patcher(Toy):
    """Images again, after 3D."""

    gives = Patch

    def step(self, item):
        self.note(item)
        return StepResult() if isinstance(item, View) else super_word(self, item)


class Hinter(Toy):
    """Views and what came of them: hints, now and then."""

    gives = Hint

    def step(self, item):
        self.note(item)
        count = (0, 1, 0, 2)[self.memory % 4] if isinstance(item, Known) else 0
        return StepResult(tuple(self.word(item.stamp_ns, f"{item.text}:{k}") for k in range(count)))


class Finisher(Toy):
    """A third input."""

    gives = Final

    def step(self, item):
        self.note(item)
        return super_word(self, item) if isinstance(item, Known) else StepResult()


def row(name, stage, inputs, outputs, **more):
    return NodeSpec(name, f"toy_graph:{stage}", "toy_graph:ToyConfig", inputs, outputs, **more)


WIDE = Port("wide", optional=True, ahead_ns=5)
HINT = Port("hint", optional=True, feedback=True)
TABLE = {
    spec.name: spec
    for spec in (
        row("looker", "Looker", (WIDE, Port("view")), ("seen",), apart=True),
        row("grouper", "Grouper", (HINT, Port("seen", tells_end=True)), ("group",)),
        row("linker", "Linker", (Port("known", feedback=True), Port("group")), ("linked",)),
        row("solver", "Solver", (Port("linked"),), ("solved",)),
        row("knower", "Knower", (Port("solved"),), ("known",)),
        row("patcher", "Patcher", (Port("view"), Port("known")), ("patch",)),
        row("hinter", "Hinter", (Port("seen"), Port("known")), ("hint",)),
        row("finisher", "Finisher", (Port("patch"), Port("known"), Port("hint")), ("final",)),
    )
}
CONFIGS = {name: ToyConfig() for name in TABLE}


class Transport:
    """Hosts, and what is under way between them: in order on each topic, otherwise as chance has it."""

    def __init__(self, parts, context_of, seed):
        self.random = random.Random(seed)
        self.under_way: dict[tuple[int, str, str, str], deque] = {}
        self.logs: dict[str, list[str]] = {}
        self.results: list[str] = []
        self.names = [name for part in parts for name in part]
        self.size = len(parts)
        self.hosts = [self._make(part, context_of) for part in parts]

    def _make(self, part, context_of):
        sent: dict[tuple[str, str], int] = {}

        def gave(topic, record):
            if topic == "final":
                self.results.append(record.text)
            if topic in leaving:
                owner = topics.owner_of(topic, record)
                sent[topic, owner] = sent.get((topic, owner), 0) + 1
                self._send(topic, owner, ("record", record))

        def end(topic, owner=""):
            if topic in leaving and TOPICS[topic].by_stamp == bool(owner):
                self._send(topic, owner, ("end", sent.get((topic, owner), 0)))

        pipeline = Pipeline(
            CONFIGS,
            context_of(self.logs),
            part,
            on_record=gave,
            on_end=end,
            everywhere=self.names,
            table=TABLE,
        )
        leaving = pipeline.wiring.leaving
        host = Host(pipeline, lanes_of([p.topic for p in pipeline.wiring.inputs], owners, pipeline), end)
        return host

    def _send(self, topic, owner, what):
        for number in range(self.size):
            self.under_way.setdefault((number, topic, owner, what[0]), deque()).append(what)

    def feed(self, topic, record):
        self._send(topic, record.camera, ("record", record))

    def feed_end(self, topic, owner, count):
        self._send(topic, owner, ("end", count))

    def run(self):
        """Deliver everything, one thing at a time, from a topic that chance chooses."""
        count: dict[tuple[int, str, str], int] = {}
        ends: dict[tuple[int, str, str], int] = {}
        while True:
            ready = [key for key, queue in self.under_way.items() if queue]
            if not ready:
                return
            number, topic, owner, kind = key = self.random.choice(ready)
            host, what, lane = self.hosts[number], self.under_way[key].popleft(), (number, topic, owner)
            if (topic, owner) not in host.keys:
                continue
            if kind == "record":
                count[lane] = count.get(lane, 0) + 1
                host.put(topic, owner, what[1].stamp_ns, what[1])
            else:
                ends[lane] = what[1]
            if lane in ends and count.get(lane, 0) >= ends[lane]:
                host.end(topic, owner)
                del ends[lane]
            host.advance()


def owners(topic):
    return OWNERS if TOPICS[topic].scope == "camera" else ("",)
