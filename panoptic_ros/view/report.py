"""Report of a run, as a text table and as report.json."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.evaluation.capture_report import CaptureSummary, PersonSummary
from panoptic_ros.io.files import write_json
from panoptic_ros.stage import Notice

FORMAT = "panoptic-report-1"
PEOPLE_HEAD = (
    "person",
    "frames",
    "joints",
    "limbs",
    "measured",
    "reproj. px",
    "p90 px",
    "limb std cm",
    "worst cm",
    "acc. m/s2",
)
SHOWN_PEOPLE = 12  # people rows of the table; report.json has all people


@dataclass(frozen=True)
class Latency:
    """Latency statistics: number of samples, median and 99th percentile in ms."""

    count: int
    p50: float
    p99: float


@dataclass(frozen=True)
class RunReport:
    """Report of a run.

    Args:
        summary: People, joints, reprojection error, bone lengths.
        frames_in: Number of images by camera.
        dropped: Number of dropped frames by cause; empty means none.
        latency_ms: Latency by node, in graph order, from receiving a message to having published its result.
        notices: Notices of stages and sources, in order of arrival.
        facts: Any other facts to report, e.g. {"model": ..., "elapsed_s": ...}.
        bodies: Measurements behind the bodies of designated people, see `BodyTally.document`. Empty without
            bodies.
        files: Files that the run wrote, relative to its folder. The next run replaces only these.
    """

    summary: CaptureSummary
    frames_in: Mapping[str, int] = field(default_factory=dict)
    dropped: Mapping[str, int] = field(default_factory=dict)
    latency_ms: Mapping[str, Latency] = field(default_factory=dict)
    notices: Sequence[Notice] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)
    bodies: Mapping[str, Any] = field(default_factory=dict)
    files: Sequence[str] = ()

    def table(self) -> str:
        """Return the report as text for a terminal."""
        blocks = [
            self._frames(),
            *([] if self._without_cameras else [self._people(), self._reprojection()]),
            self._bodies(),
            self._latency(),
            self._notices(),
        ]
        return "\n\n".join("\n".join(block) for block in blocks if block)

    def document(self) -> dict[str, Any]:
        """Return the content of report.json, with null for undefined values."""
        summary = self.summary
        content: dict[str, Any] = _plain(
            {
                "format": FORMAT,
                **self.facts,
                "frames": {
                    "in": dict(self.frames_in),
                    "out": summary.frames,
                    "with_people": summary.frames_with_people,
                    "dropped": dict(self.dropped),
                },
                "people": [_person_document(person) for person in summary.people],
                "reprojection_px": {
                    "all": asdict(summary.reprojection_px),
                    "cameras": {name: asdict(s) for name, s in summary.reprojection_by_camera.items()},
                },
                **({"bodies": self.bodies} if self.bodies else {}),
                "latency_ms": {name: asdict(latency) for name, latency in self.latency_ms.items()},
                "notices": [
                    {"code": first.code, "severity": first.severity, "count": count, "text": first.text}
                    for first, count in _grouped(self.notices)
                ],
                "files": list(self.files),
            }
        )
        return content

    def write(self, path: Path) -> None:
        """Write report.json."""
        write_json(Path(path), self.document(), indent=1)

    def _frames(self) -> list[str]:
        summary = self.summary
        taken = sum(self.frames_in.values())
        lost = ", ".join(f"{count} {cause}" for cause, count in self.dropped.items() if count) or "none"
        rows = [f"{name:<16}{value}" for name, value in self.facts.items()]
        if self._without_cameras:
            return [*rows, f"{'dropped':<16}{lost}"]
        return [
            *rows,
            f"{'frames in':<16}{taken} images of {len(self.frames_in)} cameras",
            f"{'frames out':<16}{summary.frames}, of which {summary.frames_with_people} with people",
            f"{'dropped':<16}{lost}",
        ]

    @property
    def _without_cameras(self) -> bool:
        return bool(self.bodies) and not self.frames_in

    def _people(self) -> list[str]:
        people = self.summary.people
        if not people:
            return ["no people were found"]
        rows = [_cells(PEOPLE_HEAD)]
        for person in people[:SHOWN_PEOPLE]:
            middle, worst = person.limb_std_cm
            rows.append(
                _cells(
                    (
                        f"id {person.identity}",
                        f"{person.frames}",
                        _percent(person.joints_found),
                        _percent(person.limb_joints_found),
                        _percent(person.measured),
                        _number(person.reprojection_px.median),
                        _number(person.reprojection_px.p90),
                        _number(middle),
                        _number(worst),
                        _number(person.acceleration),
                    )
                )
            )
        if len(people) > SHOWN_PEOPLE:
            rows.append(f"... and {len(people) - SHOWN_PEOPLE} more")
        return rows

    def _reprojection(self) -> list[str]:
        summary = self.summary
        rows = [*summary.reprojection_by_camera.items(), ("all cameras", summary.reprojection_px)]
        return [
            f"{'reprojection':<16}{'median px':>10}{'p90 px':>10}{'joints':>10}",
            *(f"{name:<16}{_number(s.median):>10}{_number(s.p90):>10}{s.count:>10}" for name, s in rows),
        ]

    def _bodies(self) -> list[str]:
        """Return one line per subject, or that none was found; empty if bodies were not requested."""
        if not self.bodies:
            return []
        rows = [f"{'bodies':<16}{self.bodies['instants']} instants"]
        for subject in self.bodies["subjects"]:
            there = ", ".join(f"{source} {count}" for source, count in subject["sources"].items())
            means = f"{subject['views']:.1f} views and {subject['devices']:.1f} IMUs on average"
            name = f"subject {subject['id']}"
            rows.append(f"{name:<16}{there}; {means}")
        return rows if len(rows) > 1 else [*rows, "no designated person was found"]

    def _latency(self) -> list[str]:
        if not self.latency_ms:
            return []
        rows = [f"{'latency':<16}{'p50 ms':>10}{'p99 ms':>10}{'samples':>10}"]
        for name, row in self.latency_ms.items():
            rows.append(f"{name:<16}{_number(row.p50):>10}{_number(row.p99):>10}{row.count:>10}")
        return rows

    def _notices(self) -> list[str]:
        return [
            f"{first.severity}: {first.text}" + (f" ({count} times)" if count > 1 else "")
            for first, count in _grouped(self.notices)
        ]


def _person_document(person: PersonSummary) -> dict[str, Any]:
    document = asdict(person)
    document["id"] = document.pop("identity")
    document["limb_std_cm"] = dict(zip(("median", "max"), person.limb_std_cm))
    return document


def _grouped(notices: Sequence[Notice]) -> list[tuple[Notice, int]]:
    """Return the first notice of each code and the number of notices with that code."""
    groups: dict[str, list[Notice]] = {}
    for notice in notices:
        groups.setdefault(notice.code, []).append(notice)
    return [(group[0], len(group)) for group in groups.values()]


def _cells(texts: Sequence[str]) -> str:
    return f"{texts[0]:<10}" + "".join(f"{text:>12}" for text in texts[1:])


def _percent(share: float) -> str:
    return "-" if math.isnan(share) else f"{100 * share:.1f} %"


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.1f}"


def _plain(value: Any) -> Any:
    """Replace non-finite floats by None and numpy scalars by Python numbers, recursively."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
