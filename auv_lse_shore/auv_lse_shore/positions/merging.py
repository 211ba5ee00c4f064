"""Recordings of the vehicles of one dive as one run, on one clock.

Each vehicle records its own soundings and what it hears. A packet that one recording holds as sent and another as
received shows how far their clocks are apart: the delay one way, minus the delay the other way, is twice the offset.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from auv_lse_record.run_data import PacketReceived, RunData, VehicleRun

#: Clocks that are less apart (s) are not shifted: the estimate of positions has offsets of its own.
MIN_OFFSET_S = 0.5


def clock_offsets(runs: Sequence[RunData]) -> list[float]:
    """Seconds by which each run's clock is ahead of the first one's; 0 where packets do not show it.

    An offset needs packets both ways, directly or through other runs.
    """
    offsets: dict[int, float] = {0: 0.0}
    ahead = [0]
    while ahead:
        known = ahead.pop(0)
        for other in range(len(runs)):
            if other in offsets:
                continue
            there, back = _delays(runs[known], runs[other]), _delays(runs[other], runs[known])
            if there and back:
                offsets[other] = offsets[known] + 0.5 * float(np.median(there) - np.median(back))
                ahead.append(other)
    return [offsets.get(number, 0.0) for number in range(len(runs))]


def _delays(sender: RunData, receiver: RunData) -> list[float]:
    """Delay (s) of each packet that one run sent and another received, by their clocks."""
    sent = {(p.source, p.payload): p.stamp_s for p in sender.sent if p.payload}
    own = {v.vehicle for v in sender.vehicles} & {source for source, _ in sent}
    heard = [(p.stamp_s, (p.source, p.payload)) for p in receiver.received if p.source in own]
    return [stamp - sent[key] for stamp, key in heard if key in sent]


def on_one_clock(runs: Sequence[RunData]) -> tuple[list[RunData], list[float]]:
    """The runs with the first one's clock, and the offsets (s) that were removed; 0 where clocks agree."""
    offsets = [offset if abs(offset) >= MIN_OFFSET_S else 0.0 for offset in clock_offsets(runs)]
    of_vehicle = {v.vehicle: offset for run, offset in zip(runs, offsets, strict=True) for v in run.vehicles}
    if not any(offsets):
        return list(runs), offsets
    return [_shifted(run, offset, of_vehicle) for run, offset in zip(runs, offsets, strict=True)], offsets


def _shifted(run: RunData, offset: float, of_vehicle: Mapping[int, float]) -> RunData:
    """A run whose clock is `offset` seconds ahead, without that; `of_vehicle`: the offset of each sender's clock."""
    received = []
    for packet in run.received:
        senders = of_vehicle.get(packet.source, 0.0)
        received.append(_shifted_packet(packet, offset, senders))
    return dataclasses.replace(
        run,
        vehicles=[_shifted_vehicle(v, offset, of_vehicle) for v in run.vehicles],
        sent=[dataclasses.replace(p, stamp_s=p.stamp_s - offset) for p in run.sent],
        received=received,
        end_s=run.end_s - offset,
    )


def _shifted_packet(packet: PacketReceived, offset: float, senders: float) -> PacketReceived:
    return dataclasses.replace(
        packet,
        stamp_s=packet.stamp_s - offset,
        arrival_s=packet.arrival_s - offset,
        sent_s=packet.sent_s - senders,
        travel_s=packet.travel_s - offset + senders,
    )


def _shifted_vehicle(vehicle: VehicleRun, offset: float, of_vehicle: Mapping[int, float]) -> VehicleRun:
    tracks = {name: getattr(vehicle, name).copy() for name in ("truth", "odometry", "dead_reckoning")}
    for track in tracks.values():
        track[:, 0] -= offset
    mates = []
    for mate in vehicle.mates:
        senders = of_vehicle.get(mate.source, 0.0)
        # A ping's travel time is by the receiver's clock alone.
        travel_s = mate.travel_s - offset + senders if np.isfinite(mate.sent_s) else mate.travel_s
        mate = dataclasses.replace(mate, stamp_s=mate.stamp_s - offset, sent_s=mate.sent_s - senders, travel_s=travel_s)
        mates.append(mate)
    return dataclasses.replace(
        vehicle,
        **tracks,
        soundings=dataclasses.replace(vehicle.soundings, stamp_s=vehicle.soundings.stamp_s - offset),
        received=dataclasses.replace(vehicle.received, stamp_s=vehicle.received.stamp_s - offset),
        decisions=[dataclasses.replace(d, now_s=d.now_s - offset) for d in vehicle.decisions],
        fixes=[dataclasses.replace(fix, stamp_s=fix.stamp_s - offset) for fix in vehicle.fixes],
        mates=mates,
    )


def merged(runs: Sequence[RunData]) -> RunData:
    """All vehicles, packets and notes of runs in one; mission file, origin and ground are the first one's."""
    first = runs[0]
    if len(runs) == 1:
        return first
    return dataclasses.replace(
        first,
        vehicles=sorted((v for run in runs for v in run.vehicles), key=lambda v: v.vehicle),
        sent=sorted((p for run in runs for p in run.sent), key=lambda p: (p.stamp_s, p.source)),
        received=sorted((p for run in runs for p in run.received), key=lambda p: (p.stamp_s, p.receiver)),
        end_s=max(run.end_s for run in runs),
        notes=list(dict.fromkeys(note for run in runs for note in run.notes)),
    )
