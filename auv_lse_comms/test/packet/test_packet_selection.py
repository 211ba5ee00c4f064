"""Selection of samples: every n-th, and the most useful."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from auv_lse_comms.packet.selection import CONSIDERED, every_nth, most_useful

Array = NDArray[np.float64]


@settings(deadline=None)
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


@settings(max_examples=40, deadline=None)
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


class Peaks:
    """A toy of what receivers know: a place is worth its own worth, less what known neighbours explain."""

    def __init__(self) -> None:
        self.known = np.zeros((0, 3))

    def suppose(self, samples_m: Array) -> None:
        self.known = np.concatenate([self.known, samples_m])

    def receive(self, samples_m: Array, loss: float) -> None:
        raise AssertionError("nothing was heard")

    def send(self, loss: float) -> None:
        raise AssertionError("the bridge sends, not the selection")

    def take_back(self) -> None:
        raise AssertionError("nothing was sent")

    def gains(self, samples_m: Array) -> Array:
        worth = np.asarray(samples_m[:, 2], dtype=float).copy()
        for known in self.known:
            far = np.abs(samples_m[:, 0] - known[0])
            worth = worth * np.minimum(far / 10.0, 1.0)
        return worth


def test_most_useful_takes_turns_with_what_it_chose() -> None:
    # worth by place: two heaps of high worth, at 100 and 200; the oldest, worth little, at 0
    samples = np.array([[0, 0, 1], [100, 0, 9], [101, 0, 8.9], [102, 0, 8.8], [200, 0, 5], [201, 0, 4.9], [300, 0, 2]])
    receivers = Peaks()
    chosen = most_useful(samples.astype(float), 4, receivers, np.full(7, np.inf))
    # the oldest; 9 at 100; not its neighbours but 5 at 200; then 8.8 x 0.2 at 102 is less than 2 at 300
    assert chosen.tolist() == [0, 1, 4, 6]
    assert sorted(receivers.known[:, 0].tolist()) == [0, 100, 200, 300]


@settings(deadline=None)
@given(st.integers(0, 40), st.integers(0, 19), st.integers(0, 2**32 - 1))
def test_most_useful_never_starves_the_oldest(n: int, room: int, seed: int) -> None:
    samples = np.random.default_rng(seed).uniform(0.0, 100.0, (n, 3))
    receivers = Peaks()
    chosen = most_useful(samples, room, receivers, np.full(n, np.inf))
    assert len(chosen) == len(set(chosen.tolist())) == min(n, room)
    if len(chosen):
        assert chosen[0] == 0
    assert (np.diff(chosen) > 0).all()
    assert len(receivers.known) == len(chosen)


def greedy(samples: Array, room: int, receivers: Peaks) -> list[int]:
    """The same choice, everything asked about every time."""
    chosen = [0]
    receivers.suppose(samples[:1])
    while len(chosen) < room:
        gains = receivers.gains(samples)
        gains[chosen] = -1.0
        chosen.append(int(np.argmax(gains)))
        receivers.suppose(samples[chosen[-1] : chosen[-1] + 1])
    return sorted(chosen)


@pytest.mark.parametrize("seed", range(20))
def test_most_useful_computes_few_gains_and_chooses_as_with_all(seed: int) -> None:
    samples = np.random.default_rng(seed).uniform(0.0, 100.0, (150, 3))
    assert most_useful(samples, 19, Peaks(), np.full(150, np.inf)).tolist() == greedy(samples, 19, Peaks())


def test_gains_are_reused_and_a_backlog_is_considered_evenly() -> None:
    samples = np.random.default_rng(3).uniform(0.0, 100.0, (1000, 3))
    worth = np.full(1000, np.inf)
    chosen = most_useful(samples, 19, Peaks(), worth)
    asked = np.flatnonzero(np.isfinite(worth))
    assert len(asked) == CONSIDERED
    assert np.diff(asked).max() <= 6
    assert set(chosen[1:].tolist()) <= set(asked.tolist())
    left = np.delete(np.arange(1000), chosen)
    worth = worth[left]
    most_useful(samples[left], 19, Peaks(), worth)
    assert np.isfinite(worth).sum() == 2 * CONSIDERED - 18


@pytest.mark.parametrize("gains", [lambda s: np.ones((len(s), 1)), lambda s: np.full(len(s), np.nan)])
def test_gains_that_are_not_finite_are_refused(gains: object) -> None:
    receivers = Peaks()
    receivers.gains = gains  # type: ignore[method-assign, assignment]
    with pytest.raises(ValueError, match="one finite number per sample"):
        most_useful(np.zeros((5, 3)), 3, receivers, np.full(5, np.inf))
