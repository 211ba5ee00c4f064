// Acoustic packets: slots, transmissions and receptions.

// The slot that a time falls in.
export function slotAt(tdma, t) {
  const index = Math.floor((t - tdma.epoch_s) / tdma.slot_s), count = tdma.order.length;
  const start = tdma.epoch_s + index * tdma.slot_s;
  return { owner: tdma.order[((index % count) + count) % count], start, end: start + tdma.slot_s };
}

// Whether each other vehicle has received a packet by time t: "flying" (on its way), "heard", "lost", or "unknown"
// without data of that vehicle, as in the recording of another one.
export function receptionsOf(store, packet, t) {
  const { send_s, sound_mps, slot_s } = store.facts.tdma, from = store.pose(packet.vehicle, packet.t);
  return store.facts.vehicles.filter((v) => v.number !== packet.vehicle).map(({ number: vehicle }) => {
    const to = store.pose(vehicle, packet.t);
    const away = from && to ? Math.hypot(to.north - from.north, to.east - from.east) : 0;
    const heard = store.between("received", vehicle, packet.t, packet.t + slot_s).find((r) => r.source === packet.vehicle);
    const due = heard ? heard.t : packet.t + send_s + away / sound_mps;
    const state = t < due ? "flying" : heard ? "heard" : t < due + 1 ? "flying" : to ? "lost" : "unknown";
    return { vehicle, due, heard, state };
  });
}

// Packets sent in the last `window` seconds, each with its receptions.
export function packetsAt(store, t, window) {
  const { send_s, slot_s } = store.facts.tdma;
  return store.facts.vehicles.flatMap(({ number: vehicle }) =>
    store.between("sent", vehicle, t - window, t).map((packet) => ({
      ...packet,
      receptions: receptionsOf(store, packet, t),
      sending: t < packet.t + send_s,
      fade: Math.max(0, Math.min(1, 2 * (1 - (t - packet.t) / slot_s))),
    })));
}
