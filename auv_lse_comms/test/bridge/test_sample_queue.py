"""Selection of the samples of a packet: every n-th."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_lse_comms.bridge.sample_queue import every_nth


@given(st.integers(0, 3000), st.integers(0, 19))
def test_every_nth_fills_the_packet_and_spreads(unsent: int, room: int) -> None:
    chosen = every_nth(unsent, room)
    assert len(chosen) == len(set(chosen.tolist())) == min(unsent, room)
    if len(chosen):
        assert chosen[0] == 0
    if room > 1 and unsent > 1:
        assert chosen[-1] == unsent - 1
        steps = np.diff(chosen)
        assert steps.min() >= 1
        assert steps.max() - steps.min() <= 1  # n is the same all along, but for rounding


def test_every_nth_by_hand() -> None:
    assert every_nth(37, 19).tolist() == list(range(0, 37, 2))
    assert every_nth(55, 19).tolist() == list(range(0, 55, 3))
    assert every_nth(5, 19).tolist() == [0, 1, 2, 3, 4]
    assert every_nth(6, 3).tolist() == [0, 2, 5]


@settings(max_examples=40)
@given(st.integers(1, 150), st.integers(1, 19), st.integers(0, 30))
def test_nothing_starves_and_everything_is_sent_once(backlog: int, room: int, arriving: int) -> None:
    """While `arriving` new ones come per packet, the oldest goes each time: no sample waits longer than the backlog."""
    unsent = list(range(backlog))
    sent: list[int] = []
    born = backlog
    for packet in range(backlog):
        chosen = every_nth(len(unsent), room).tolist()
        sent += [unsent[i] for i in chosen]
        unsent = [s for i, s in enumerate(unsent) if i not in set(chosen)]
        assert not unsent or unsent[0] > packet
        unsent += range(born, born + arriving)
        born += arriving
    assert len(sent) == len(set(sent))
    assert set(range(backlog)) <= set(sent)
