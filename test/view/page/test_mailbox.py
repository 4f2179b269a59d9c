"""A client gets the newest, and never more than it has drawn."""

from panoptic_ros.view.page.mailbox import CREDITS, Mailbox, PageInstant
from panoptic_ros.view.page.packets import PageMessage


def instant(number, *cameras):
    views = {name: (PageMessage(10, f"{name} {number}".encode()),) for name in cameras}
    return PageInstant(PageMessage(0, str(number).encode()), views)


def texts(messages):
    return [message.data.decode() for message in messages]


def test_a_client_that_draws_gets_everything():
    box = Mailbox()
    for number in range(20):
        box.offer(instant(number, "a"))
        assert texts(box.take()) == [str(number), f"a {number}"]
        assert box.take() is None
        box.drawn()
    assert box.dropped == 0


def test_a_client_that_does_not_draw_gets_no_more_and_then_the_newest():
    box, sent = Mailbox(), []
    for number in range(20):
        box.offer(instant(number))
        sent += box.take() or []
    assert texts(sent) == ["0", "1"] and len(sent) == CREDITS
    box.drawn()
    assert texts(box.take()) == ["19"]
    assert box.dropped == 17 and box.take() is None


def test_the_newest_images_come_with_the_skeletons_of_their_own_instant():
    box = Mailbox()
    for number in range(5):
        box.offer(instant(number, *(["a", "b"] if number == 1 else ["a"] if number == 3 else [])))
    assert sorted(texts(box.take())) == ["1", "3", "4", "a 3", "b 1"]


def test_acknowledging_too_often_gives_no_more_credit():
    box = Mailbox()
    for _ in range(10):
        box.drawn()
    sent = 0
    for number in range(10):
        box.offer(instant(number))
        sent += box.take() is not None
    assert sent == CREDITS


def test_other_topics_do_not_push_skeletons_out():
    box = Mailbox()
    box.offer(instant(1))
    box.offer(PageInstant(None, {}, (PageMessage(5, b"nodes 1"),)))
    box.offer(PageInstant(None, {}, (PageMessage(5, b"nodes 2"),)))
    assert texts(box.take()) == ["1", "nodes 2"]
    assert box.dropped == 0
