// The events received, by kind and vehicle, in order of time. Every past time can be looked up.

export const OUTSIDE = 255;

export class Store {
  constructor() {
    this.team = null; // what auv_lse fleet watch knows of the vehicles, else null
    this.begin(null);
  }

  begin(facts) {
    this.facts = facts;
    this.lists = new Map();
    this.firstS = Infinity;
    this.lastS = 0;
    this.changes = 0;
    this.maps = new Map(); // vehicle -> {cells, queue}: maps are decoded one at a time
    this.packed = 0; // maps that wait for it
  }

  get startS() {
    return this.facts?.simulated || !Number.isFinite(this.firstS) ? 0 : this.firstS;
  }

  add(event) {
    this.changes++;
    if (event.kind === "mission") return this.begin(event);
    this.firstS = Math.min(this.firstS, event.t);
    this.lastS = Math.max(this.lastS, event.t);
    return event.kind === "map" ? this.addMap(event) : this.insert(event);
  }

  insert(event) {
    const key = `${event.kind} ${event.vehicle ?? ""}`;
    let list = this.lists.get(key);
    if (!list) this.lists.set(key, (list = []));
    if (!list.length || list[list.length - 1].t <= event.t) list.push(event);
    else list.splice(indexAfter(list, event.t), 0, event);
    this.changes++;
  }

  addMap(event) {
    const facts = this.facts;
    const state = this.maps.get(event.vehicle) ?? { cells: null, queue: Promise.resolve() };
    this.maps.set(event.vehicle, state);
    this.packed++;
    state.queue = state.queue.then(async () => {
      const change = await inflate(event.layers);
      if (facts !== this.facts) return; // a new mission has begun
      this.packed--;
      if (state.cells?.length === change.length) for (let i = 0; i < change.length; i++) change[i] += state.cells[i];
      state.cells = change;
      const size = event.rows * event.columns;
      const layers = Object.fromEntries(facts.layers.map((l, i) => [l.name, change.subarray(i * size, (i + 1) * size)]));
      this.insert({ ...event, layers });
    });
  }

  list(kind, vehicle = "") {
    return this.lists.get(`${kind} ${vehicle}`) ?? [];
  }

  // The last event of a kind at or before a time; undefined if there is none.
  at(kind, vehicle, t) {
    return this.list(kind, vehicle)[this.count(kind, vehicle, t) - 1];
  }

  // Number of events of a kind up to a time.
  count(kind, vehicle, t) {
    return indexAfter(this.list(kind, vehicle), t);
  }

  // The events in [from, to].
  between(kind, vehicle, from, to) {
    const list = this.list(kind, vehicle);
    return list.slice(indexAfter(list, from - 1e-9), indexAfter(list, to));
  }

  // A vehicle's pose at a time, interpolated along its track.
  pose(vehicle, t) {
    const list = this.list("pose", vehicle), i = indexAfter(list, t);
    const before = list[i - 1], after = list[i];
    if (!before || !after) return before;
    const part = (t - before.t) / (after.t - before.t || 1), mix = (name) => before[name] + part * (after[name] - before[name]);
    const turn = ((after.heading - before.heading + 3 * Math.PI) % (2 * Math.PI)) - Math.PI;
    return { ...before, north: mix("north"), east: mix("east"), heading: before.heading + part * turn };
  }

  // Where a vehicle of a watched team is expected while it is away: north, east; null if it is not away.
  expected(vehicle) {
    return this.team?.vehicles.find((v) => v.number === vehicle)?.expected ?? null;
  }

  value(layer, byte) {
    const scale = this.facts.layers.find((l) => l.name === layer);
    return byte === OUTSIDE ? null : scale.low + byte * scale.step;
  }
}

export function indexAfter(list, t) {
  let low = 0, high = list.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (list[middle].t <= t) low = middle + 1;
    else high = middle;
  }
  return low;
}

async function inflate(text) {
  const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}
