"""What waits for one client: never more than the newest, whatever the client can take."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from panoptic_ros.view.page.packets import Message

CREDITS = 2  # packets that a client may have without having drawn them


@dataclass(frozen=True)
class Instant:
    """Skeletons, and what cameras saw at the same instant.

    Args:
        skeletons: None where there is none yet for these views.
        views: by camera; of one view its messages belong together.
        others: of topics that stand by themselves.
    """

    skeletons: Message | None
    views: Mapping[str, tuple[Message, ...]] = field(default_factory=dict)
    others: tuple[Message, ...] = ()


class Mailbox:
    """The newest of what one client has not been sent.

    A client may have `CREDITS` packets that it has not drawn. A socket takes megabytes without a word, so
    only the client can say what it has dealt with: it does so after drawing, and a page that nobody looks
    at does not draw.
    """

    def __init__(self) -> None:
        self.dropped = 0  # instants that were overtaken by newer ones
        self._credits = CREDITS
        self._newest: Instant | None = None
        self._views: dict[str, Instant] = {}  # by camera, the newest instant that shows what it saw
        self._others: dict[int, Message] = {}  # by topic

    def offer(self, instant: Instant) -> None:
        """Something new."""
        self._others |= {message.topic: message for message in instant.others}
        if instant.skeletons is not None:
            self.dropped += self._newest is not None
            self._newest = instant
        for camera in instant.views:
            self._views[camera] = instant

    def drawn(self) -> None:
        """The client has drawn a packet."""
        self._credits = min(CREDITS, self._credits + 1)

    def take(self) -> list[Message] | None:
        """What to send now; None if there is nothing, or the client has enough."""
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
