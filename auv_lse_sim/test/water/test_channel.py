"""The acoustic channel: physics by hand-worked values, each effect alone, and determinism."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest

from auv_lse_common.mission_file.parameters import ParameterError, from_mapping
from auv_lse_common.mission_file.sections.world import ChannelConfig
from auv_lse_common.support.arrays import Array
from auv_lse_sim.water.channel import (
    RATES,
    Arrival,
    Channel,
    Position,
    frame_error_rate,
    fresh_db_per_km,
    land_between,
    snr_db,
    thorp_db_per_km,
    transmission_loss_db,
)
from benchmarks.navigation.channel_loss import loss_at_range

PAYLOAD = bytes(range(252))
#: Only distance matters: no chance, no errors.
STILL = ChannelConfig(fading_db=0.0, frame_errors=False)


def line(*norths_m: float) -> dict[int, Position]:
    return {i: (north, 0.0, 3.0) for i, north in enumerate(norths_m, 1)}


def channel(config: ChannelConfig = STILL, seed: int = 0) -> Channel:
    return Channel(config, np.random.default_rng(seed))


def read(arrivals: list[Arrival]) -> list[tuple[int, int, str]]:
    return [(a.receiver, a.source, a.why) for a in arrivals]


def test_absorption_by_hand() -> None:
    # f = 25 kHz, f^2 = 625: 0.11 x 625/626 = 0.10982; 44 x 625/4725 = 5.82011; 2.75e-4 x 625 = 0.17188; + 0.003
    assert thorp_db_per_km(25.0) == pytest.approx(6.10481, abs=1e-5)
    assert fresh_db_per_km(25.0) == pytest.approx(0.171875)
    # f = 1: 0.055 + 0.010729 + 0.000275 + 0.003
    assert thorp_db_per_km(1.0) == pytest.approx(0.069004, abs=1e-6)


@pytest.mark.parametrize(
    ("spreading", "absorption", "expected_db"),
    [
        ("spherical", "thorp", 60.0 + 6.10481),
        ("practical", "thorp", 45.0 + 6.10481),
        ("practical", "fresh", 45.0 + 0.171875),
        ("none", "thorp", 6.10481),
        ("spherical", "none", 60.0),
        ("none", "none", 0.0),
    ],
)
def test_transmission_loss_at_1_km(spreading: str, absorption: str, expected_db: float) -> None:
    config = ChannelConfig(spreading=spreading, absorption=absorption)
    assert transmission_loss_db(1000.0, config) == pytest.approx(expected_db, abs=1e-5)
    # 185 - TL - (70 + 10 log10 4000 = 106.0206)
    assert snr_db(1000.0, config) == pytest.approx(78.9794 - expected_db, abs=1e-4)


def test_loss_grows_with_range_and_is_none_at_1_m() -> None:
    config = ChannelConfig(absorption="none")
    loss = transmission_loss_db(np.geomspace(0.01, 1e4, 200), config)
    assert loss[0] == 0.0
    assert (np.diff(loss) >= 0.0).all()


def test_frame_errors_at_the_points_of_whois_simulator() -> None:
    for rate, ratio, expected in (
        (1, -7.96, 1.0), (1, -6.01, 0.0), (3, -2.92, 1.0), (3, 0.0, 0.025), (5, 3.1, 1.0), (5, 6.0, 0.0),
    ):  # fmt: skip
        assert frame_error_rate(ratio, rate) == pytest.approx(expected)
    assert frame_error_rate(-1.46, 3) == pytest.approx((1.0 + 0.025) / 2.0)
    assert frame_error_rate(-100.0, 3) == 1.0
    assert frame_error_rate(100.0, 3) == 0.0


def test_faster_rates_need_more() -> None:
    ratios = np.linspace(-10.0, 10.0, 401)
    errors = [frame_error_rate(ratios, rate) for rate in sorted(RATES)]
    for curve in errors:
        assert (np.diff(curve) <= 0.0).all()
    for slow, fast in itertools.pairwise(errors):
        assert (slow <= fast + 1e-12).all()


def test_interpolated_curves_lie_at_their_bit_rate() -> None:
    def level(rate: int, error: float) -> float:
        ratios = np.linspace(-10.0, 10.0, 20001)
        return float(ratios[np.argmax(frame_error_rate(ratios, rate) <= error)])

    for middle, below, above in ((2, 1, 3), (4, 3, 5)):
        share = math.log(RATES[middle].bit_rate_bps / RATES[below].bit_rate_bps) / math.log(
            RATES[above].bit_rate_bps / RATES[below].bit_rate_bps
        )
        for error in (0.9, 0.5, 0.1):
            between = level(below, error) + share * (level(above, error) - level(below, error))
            assert level(middle, error) == pytest.approx(between, abs=0.05)


def test_delay_and_duration() -> None:
    water = channel()
    end = water.transmit(10.0, 1, PAYLOAD, line(0.0, 1500.0, 300.0))
    assert end == pytest.approx(10.0 + 0.45 + 252 * 8 / 1300)
    near, far = water.arrivals(20.0)
    assert (near.receiver, far.receiver) == (3, 2)
    assert near.start_s == pytest.approx(10.2)
    assert far.start_s == pytest.approx(11.0)
    assert far.arrival_s == pytest.approx(end + 1.0)
    assert (far.range_m, far.source, far.payload, far.sent_s, far.ok, far.why) == (1500.0, 1, PAYLOAD, 10.0, True, "")
    assert far.snr_db == pytest.approx(float(snr_db(1500.0, STILL)))


def test_arrivals_come_when_they_have_ended_and_once() -> None:
    water = channel()
    end = water.transmit(0.0, 1, PAYLOAD, line(0.0, 1500.0))
    assert water.arrivals(end + 0.999) == []
    assert len(water.arrivals(end + 1.0)) == 1
    assert water.arrivals(100.0) == []


def test_range_counts_the_depth() -> None:
    water = channel()
    water.transmit(0.0, 1, PAYLOAD, {1: (0.0, 0.0, 0.0), 2: (300.0, 0.0, 400.0)})
    assert water.arrivals(10.0)[0].range_m == pytest.approx(500.0)


def test_a_sender_is_deaf() -> None:
    def run(config: ChannelConfig, second_at_s: float) -> list[tuple[int, int, str]]:
        water = channel(config)
        water.transmit(0.0, 1, PAYLOAD, line(0.0, 1500.0))
        water.transmit(second_at_s, 2, PAYLOAD, line(0.0, 1500.0))
        return read(water.arrivals(20.0))

    # 2 sends from 0.5 on, while the sound of 1 arrives there from 1.0 to 3.0; and 1 is silent again when 2's comes
    assert run(STILL, 1.9) == [(2, 1, "half_duplex"), (1, 2, "")]
    assert run(STILL, 0.5) == [(2, 1, "half_duplex"), (1, 2, "half_duplex")]
    assert run(STILL, 4.0) == [(2, 1, ""), (1, 2, "")]
    # a transmission that began before the sound came, and ended in it
    assert run(dataclasses.replace(STILL, half_duplex=False), 0.5) == [(2, 1, ""), (1, 2, "")]


def test_overlapping_arrivals_interfere() -> None:
    config = ChannelConfig(fading_db=0.0)
    positions = line(0.0, 200.0, 1000.0)

    def run(config: ChannelConfig, second_at_s: float) -> dict[tuple[int, int], Arrival]:
        water = channel(config)
        water.transmit(0.0, 1, PAYLOAD, positions)
        water.transmit(second_at_s, 2, PAYLOAD, positions)
        return {(a.receiver, a.source): a for a in water.arrivals(20.0)}

    both = run(config, 1.0)
    loud, faint = both[3, 2], both[3, 1]  # at 800 and 1000 m
    # the louder against the fainter: 15 log10(1000/800) + 6.1048 x 0.2 = 1.454 + 1.221 = 2.675 dB, noise adds little
    assert loud.snr_db == pytest.approx(2.675, abs=0.01)
    assert faint.snr_db == pytest.approx(-2.675, abs=0.01)
    assert (faint.ok, faint.why) == (False, "interference")
    assert loud.ok
    apart = run(config, 3.0)
    assert apart[3, 1].ok
    assert apart[3, 1].snr_db == pytest.approx(float(snr_db(1000.0, config)))
    ideal = run(dataclasses.replace(config, interference=False), 1.0)
    assert ideal[3, 1].ok


def test_interference_holds_across_calls_of_arrivals() -> None:
    """A sound that was judged still disturbs one that began before it ended and ends later."""
    config = ChannelConfig(fading_db=0.0)
    positions = line(0.0, 200.0, 1000.0)

    def run(step_s: float) -> list[str]:
        water = channel(config)
        found: list[Arrival] = []
        sends = [(0.0, 1), (1.0, 2)]
        for t in np.arange(0.0, 10.0, step_s).tolist():
            found += water.arrivals(t)
            while sends and sends[0][0] <= t:
                water.transmit(t, sends.pop(0)[1], PAYLOAD, positions)
        return [repr(a) for a in found]  # a NaN differs from itself

    assert run(0.25) == run(0.5) == run(1.0)


def test_blackouts_by_schedule() -> None:
    config = dataclasses.replace(STILL, blackouts=(1, 2, 10, 20, 3, 0, 30, 40))
    for now_s, expected in (
        (9.0, [(2, 1, ""), (3, 1, "")]),
        (10.0, [(2, 1, "blackout"), (3, 1, "")]),
        (20.0, [(2, 1, ""), (3, 1, "")]),
        (30.0, [(2, 1, ""), (3, 1, "blackout")]),
    ):
        water = channel(config)
        water.transmit(now_s, 1, PAYLOAD, line(0.0, 100.0, 200.0))
        arrivals = water.arrivals(100.0)
        assert read(arrivals) == expected
        assert all(math.isinf(a.snr_db) == (not a.ok) for a in arrivals)
    back = channel(config)
    back.transmit(12.0, 2, PAYLOAD, line(0.0, 100.0))
    assert read(back.arrivals(100.0)) == [(1, 2, "blackout")]


def peninsula(north_m: Array, east_m: Array) -> Array:
    """Water 20 m deep but for a wall of land at 40 <= east <= 60 that ends at north = 100; unknown beyond 1000."""
    depth = np.where((east_m >= 40.0) & (east_m <= 60.0) & (north_m <= 100.0), -1.0, 20.0)
    return np.where(north_m > 1000.0, np.nan, depth)


def test_land_between_cuts_a_link() -> None:
    blocked = land_between(peninsula)
    assert blocked((0.0, 0.0, 3.0), (0.0, 100.0, 3.0))
    assert blocked((0.0, 100.0, 3.0), (0.0, 0.0, 3.0))
    assert not blocked((200.0, 0.0, 3.0), (200.0, 100.0, 3.0))
    assert not blocked((0.0, 0.0, 3.0), (500.0, 0.0, 3.0))
    assert blocked((900.0, 0.0, 3.0), (1100.0, 0.0, 3.0))
    positions = {1: (0.0, 0.0, 3.0), 2: (0.0, 100.0, 3.0), 3: (300.0, 0.0, 3.0)}
    for config, expected in (
        (STILL, [(2, 1, "land"), (3, 1, "")]),
        (dataclasses.replace(STILL, land_blocks=False), [(2, 1, ""), (3, 1, "")]),
    ):
        water = Channel(config, np.random.default_rng(0), blocked)
        water.transmit(0.0, 1, PAYLOAD, positions)
        assert read(water.arrivals(10.0)) == expected


def test_a_sound_behind_land_does_not_interfere() -> None:
    positions = {1: (0.0, 0.0, 3.0), 2: (0.0, 100.0, 3.0), 3: (0.0, 300.0, 3.0)}
    water = Channel(ChannelConfig(fading_db=0.0), np.random.default_rng(0), land_between(peninsula))
    water.transmit(0.0, 1, PAYLOAD, positions)
    water.transmit(0.0, 2, PAYLOAD, positions)
    assert read(water.arrivals(10.0)) == [(1, 2, "land"), (2, 1, "land"), (3, 2, ""), (3, 1, "land")]


def share_read(config: ChannelConfig, range_m: float, n: int = 4000, seed: int = 0) -> float:
    water = channel(config, seed)
    read = 0
    for i in range(n):
        water.transmit(10.0 * i, 1, PAYLOAD, line(0.0, range_m))
        read += water.arrivals(10.0 * i + 9.0)[0].ok
    return read / n


@pytest.mark.parametrize("loss", [0.0, 0.3, 1.0])
def test_random_loss(loss: float) -> None:
    got = share_read(dataclasses.replace(STILL, packet_loss=loss), 300.0)
    assert got == pytest.approx(1.0 - loss, abs=4.0 * math.sqrt(loss * (1.0 - loss) / 4000.0))  # 4 sigma


@pytest.mark.parametrize("fading_db", [0.0, 4.0])
@pytest.mark.parametrize("range_m", [3000.0, 3800.0, 4000.0, 4200.0])
def test_share_read_at_a_range_is_the_one_documented(fading_db: float, range_m: float) -> None:
    config = ChannelConfig(fading_db=fading_db)
    expected = 1.0 - float(loss_at_range(range_m, config))
    assert share_read(config, range_m) == pytest.approx(expected, abs=4.0 * math.sqrt(0.25 / 4000.0) + 1e-3)


def test_ideal_water_reads_everything_but_random_loss_and_blackouts() -> None:
    config = ChannelConfig(ideal=True, source_level_db=100.0, blackouts=(1, 2, 100, 200))
    water = Channel(config, np.random.default_rng(0), lambda a, b: True)
    positions = line(0.0, 5e4, 9e4)
    end = water.transmit(0.0, 1, PAYLOAD, positions)
    water.transmit(0.0, 2, PAYLOAD, positions)
    arrivals = water.arrivals(end)
    assert [a.ok for a in arrivals] == [True] * 4
    assert {a.arrival_s for a in arrivals} == {end}
    water.transmit(100.0, 1, PAYLOAD, positions)
    assert read(water.arrivals(200.0)) == [(2, 1, "blackout"), (3, 1, "")]


def chatter(seed: int, step_s: float) -> list[Arrival]:
    """Twenty minutes of a team of four that sends whenever it likes."""
    config = ChannelConfig(packet_loss=0.1, blackouts=(1, 3, 100, 300), noise_level_db=78.0)
    water = channel(config, seed)
    rng = np.random.default_rng(99)
    times = np.cumsum(rng.exponential(3.0, 300)) + 2.5 * np.arange(300) * (rng.random(300) < 0.5)
    times.sort()
    senders = rng.integers(1, 5, 300)
    sends = [(math.ceil(t / 2.0) * 2.0, int(s)) for t, s in zip(times, senders, strict=True)]
    found: list[Arrival] = []
    busy = dict.fromkeys(range(1, 5), -1.0)
    positions = line(0.0, 700.0, 1400.0, 2100.0)
    for t in np.arange(0.0, sends[-1][0] + 20.0, step_s).tolist():
        found += water.arrivals(t)
        while sends and sends[0][0] <= t:
            when, source = sends.pop(0)
            if busy[source] <= when:
                busy[source] = water.transmit(when, source, PAYLOAD, positions)
    return found


def test_repeats_from_its_seed_whatever_the_tick() -> None:
    first = chatter(5, 2.0)
    written = repr(first)  # a NaN differs from itself
    assert written == repr(chatter(5, 2.0)) == repr(chatter(5, 1.0))
    assert written != repr(chatter(6, 2.0))
    whys = {a.why for a in first}
    assert whys == {"", "blackout", "half_duplex", "interference", "noise", "random"}
    assert {a.why for a in first if a.audible} == {"", "interference", "noise", "random"}
    assert [a.arrival_s for a in first] == sorted(a.arrival_s for a in first)


def test_misuse_is_refused() -> None:
    water = channel()
    water.arrivals(10.0)
    with pytest.raises(ValueError, match=r"arrivals until 9.0 s: 10.0 s were given already"):
        water.arrivals(9.0)
    with pytest.raises(ValueError, match=r"transmission at 9.5 s: arrivals until 10.0 s were given already"):
        water.transmit(9.5, 1, PAYLOAD, line(0.0, 1.0))
    with pytest.raises(ValueError, match=r"vehicle 3: its position is not among \[1, 2\]"):
        water.transmit(10.0, 3, PAYLOAD, line(0.0, 1.0))
    water.transmit(10.0, 1, PAYLOAD, line(0.0, 1.0))
    with pytest.raises(ValueError, match=r"vehicle 1 at 11.0 s: it is still sending"):
        water.transmit(11.0, 1, PAYLOAD, line(0.0, 1.0))
    with pytest.raises(ValueError, match=r"2520 bytes do not fit a packet of rate 4, \d+ x \d+"):
        water.transmit(20.0, 1, 10 * PAYLOAD, line(0.0, 1.0))
    with pytest.raises(ParameterError, match=r"sim.channel.rate must be a whole number from 3 to 5, not 1"):
        from_mapping(ChannelConfig, {"rate": 1}, "sim.channel")
    with pytest.raises(ParameterError, match=r"sim.channel.blackouts has 3 numbers; give four for each"):
        from_mapping(ChannelConfig, {"blackouts": [1.0, 2.0, 3.0]}, "sim.channel")
    with pytest.raises(
        ParameterError, match=r"blackouts: \(1.5, 2.0, 3.0, 4.0\) is not a blackout; give two vehicle numbers"
    ):
        from_mapping(ChannelConfig, {"blackouts": [1.5, 2, 3, 4]}, "sim.channel")
    with pytest.raises(ParameterError, match=r"packet_loss must be a number from 0 to 1, not 1.5"):
        from_mapping(ChannelConfig, {"packet_loss": 1.5}, "sim.channel")
