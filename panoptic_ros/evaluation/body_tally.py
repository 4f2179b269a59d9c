"""Statistics of the body states of a run.

They count the instants of every subject by source, and the views and IMUs behind them.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from panoptic_ros.domain import BodySource, BodyStateSet


@dataclass
class BodyTally:
    """Running counts of the body states of a run.

    Args:
        instants: Number of body state sets.
        sources: Number of instants by subject and `BodySource`.
        views, devices: Sum over instants of the views and IMUs used, by subject.
    """

    instants: int = 0
    sources: dict[int, Counter[BodySource]] = field(default_factory=dict)
    views: Counter[int] = field(default_factory=Counter)
    devices: Counter[int] = field(default_factory=Counter)

    def add(self, item: BodyStateSet) -> None:
        """Add one body state set."""
        self.instants += 1
        rows = zip(item.ids.tolist(), item.sources.tolist(), item.views.tolist(), item.devices.tolist())
        for number, source, views, devices in rows:
            self.sources.setdefault(number, Counter())[BodySource(source)] += 1
            self.views[number] += views
            self.devices[number] += devices

    def document(self) -> dict[str, Any]:
        """Return {"instants", "subjects": [{id, instants, sources {name: count}, views, devices: means}]}."""
        subjects = []
        for number, own in sorted(self.sources.items()):
            count = own.total()
            named = {source.name: own[source] for source in BodySource if own[source]}
            subjects.append(
                {
                    "id": number,
                    "instants": count,
                    "sources": named,
                    "views": round(self.views[number] / count, 2),
                    "devices": round(self.devices[number] / count, 2),
                }
            )
        return {"instants": self.instants, "subjects": subjects}
