"""Outgoing mailbox of one client: it holds only the newest messages, however slow the client is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from panoptic_ros.view.page.packets import PageMessage

CREDITS = 2  # packets in flight: largest number sent but not yet drawn by the client


@dataclass(frozen=True)
class PageInstant:
    """Skeletons and the camera views of the same instant.

    Args:
        skeletons: Skeletons, None where these views have none yet.
        views: Messages by camera; those of one view belong together.
        others: Messages of independent topics.
    """

    skeletons: PageMessage | None
    views: Mapping[str, tuple[PageMessage, ...]] = field(default_factory=dict)
    others: tuple[PageMessage, ...] = ()


class Mailbox:
    """Newest messages that one client has not received yet.

    A client may have `CREDITS` packets that it has not drawn. A socket buffers megabytes without feedback, so
    the client itself must acknowledge each packet. It does so after drawing, and a hidden page does not draw.
    """

    def __init__(self) -> None:
        self.dropped = 0  # instants replaced by newer ones before they were sent
        self._credits = CREDITS
        self._newest: PageInstant | None = None
        self._views: dict[str, PageInstant] = {}  # by camera, the newest instant with a view of it
        self._others: dict[int, PageMessage] = {}  # by topic

    def offer(self, instant: PageInstant) -> None:
        """Add a new instant, replacing older unsent ones."""
        self._others |= {message.topic: message for message in instant.others}
        if instant.skeletons is not None:
            self.dropped += self._newest is not None
            self._newest = instant
        for camera in instant.views:
            self._views[camera] = instant

    def drawn(self) -> None:
        """Record that the client has drawn a packet."""
        self._credits = min(CREDITS, self._credits + 1)

    def take(self) -> list[PageMessage] | None:
        """Return the messages to send now; None if there are none or the client has no credit left."""
        if not self._credits or not (self._newest or self._views or self._others):
            return None
        self._credits -= 1
        shown = list({id(instant): instant for instant in self._views.values()}.values())
        messages = [each.skeletons for each in shown if each.skeletons is not None]
        for camera, instant in self._views.items():
            messages += instant.views[camera]
        newest = self._newest
        if newest is not None and newest.skeletons is not None and all(newest is not each for each in shown):
            messages.append(newest.skeletons)
        messages += self._others.values()
        self._newest, self._views, self._others = None, {}, {}
        return messages
