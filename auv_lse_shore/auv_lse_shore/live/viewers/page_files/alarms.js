// The alarm history: warnings, tripped limits, holds and silences of each vehicle, with when they began and were cleared.

import { vehicleColor } from "./colors.js";
import { clock, element, setText } from "./format.js";

export const SILENT_S = 30;
export const PLANNER = "planner_node"; // plans nothing once the mission has ended: its last report is void then
const RANK = { ok: 0, warning: 1, error: 2, stale: 2 };
const SIGN = { warning: "⚠", error: "✖" };

export class Alarms {
  constructor(root, store, onSeek) {
    [this.root, this.store, this.onSeek] = [root, store, onSeek];
    this.title = element("summary");
    this.body = element("tbody");
    const head = element("tr", {}, ...["From", "Vehicle", "What", "Until"].map((text) => element("th", { scope: "col" }, text)));
    this.frame = element("div", { class: "rows", tabindex: "0", role: "region", "aria-label": "Alarm history" },
      element("table", {}, element("thead", {}, head), this.body));
    root.append(this.title, this.frame);
  }

  update(t) {
    const { store } = this;
    if (this.made !== store.changes || this.of !== store.facts) {
      [this.made, this.of, this.kept] = [store.changes, store.facts, alarmsOf(store)];
    }
    const shown = this.kept.filter((a) => a.from <= t), active = shown.filter((a) => isActive(a, t)).length;
    setText(this.title, shown.length ? `Alarm history: ${shown.length}, ${active} active` : "Alarm history: none");
    const key = JSON.stringify([store.startS, shown.map((a) => [a.from, a.vehicle, a.text, a.level, isActive(a, t)])]);
    if (this.key === key) return;
    this.key = key;
    this.body.replaceChildren(...shown.reverse().map((alarm) => this.row(alarm, t)));
  }

  row(alarm, t) {
    const start = this.store.startS, button = element("button", { type: "button", title: "Go to this time" }, clock(alarm.from - start));
    button.addEventListener("click", () => this.onSeek(alarm.from));
    const swatch = element("span", { class: "swatch", style: `background: ${vehicleColor(alarm.vehicle)}` });
    const what = element("td", { "data-level": alarm.level }, `${SIGN[alarm.level]} ${alarm.text}`);
    const until = isActive(alarm, t) ? "active" : clock(alarm.to - start);
    return element("tr", {}, element("td", {}, button), element("td", {}, swatch, ` auv${alarm.vehicle}`), what, element("td", {}, until));
  }
}

function isActive(alarm, t) {
  return alarm.to === null || alarm.to > t;
}

// All alarms in order of their beginning: {vehicle, from, to (null: not cleared), level, text}.
export function alarmsOf(store) {
  const found = (store.facts?.vehicles ?? []).flatMap(({ number: vehicle }) =>
    [...ofHealth(store, vehicle), ...ofRun(store, vehicle), ...ofSilence(store, vehicle)].map((alarm) => ({ vehicle, ...alarm })));
  return found.sort((a, b) => a.from - b.from || a.vehicle - b.vehicle);
}

// Follows conditions that come and go; each has a key, a level and a text. An alarm keeps the text of its worst level.
class Conditions {
  constructor() {
    this.open = new Map();
    this.all = [];
  }

  set(key, t, level, text) {
    const known = this.open.get(key);
    if (!RANK[level]) {
      if (known) known.to = t;
      this.open.delete(key);
    } else if (!known) {
      const alarm = { from: t, to: null, level: RANK[level] > 1 ? "error" : "warning", text };
      this.open.set(key, alarm);
      this.all.push(alarm);
    } else if (RANK[level] > RANK[known.level]) {
      Object.assign(known, { level: "error", text });
    }
  }
}

function ofHealth(store, vehicle) {
  const conditions = new Conditions(), end = missionEndS(store);
  for (const { t, node, level, text } of store.list("health", vehicle)) {
    const own = ownText(store.at("run", vehicle, t), text);
    if (t < end || node !== PLANNER) conditions.set(node, t, own || !text ? level : "ok", `${node}: ${own}`);
  }
  if (end < Infinity) conditions.set(PLANNER, end, "ok", "");
  return conditions.all;
}

// The part of a node's health that does not repeat the state of the vehicle's mission, which has alarms of its own.
export function ownText(run, text) {
  const latched = (run?.limits ?? []).map((limit) => `${limit} (latched until RESET)`);
  const held = `not planning: the mission is ${run?.state.toUpperCase()}: ${run?.reason}`;
  const rest = [held, ...latched, run?.reason].reduce((left, known) => `; ${left}; `.replace(`; ${known}; `, "; ").slice(2, -2), text);
  const parts = rest.split("; ");
  for (const warning of run?.warnings ?? []) { // its numbers change
    const at = parts.findIndex((part) => keyOf(part) === keyOf(warning));
    if (at >= 0) parts.splice(at, warning.split("; ").length);
  }
  return parts.join("; ");
}

const keyOf = (text) => text.split(": ", 1)[0];

// When the last vehicle's mission ended; Infinity while one has not.
export function missionEndS(store) {
  const ends = store.facts.vehicles.map((v) => store.list("run", v.number).find(({ state }) => state === "ended"));
  return Math.max(...ends.map((event) => event?.t ?? Infinity));
}

function ofRun(store, vehicle) {
  const conditions = new Conditions();
  for (const { t, state, reason, limits, warnings } of store.list("run", vehicle)) {
    const now = new Map();
    for (const text of warnings) now.set(nameOf(text), ["warning", `limit exceeded: ${text}`]);
    for (const text of limits) now.set(nameOf(text), ["error", `limit tripped: ${text}`]);
    if (state === "holding") now.set(" holding", ["warning", `holding: ${reason}`]);
    if (state === "aborted") now.set(" aborted", ["error", `aborted: ${reason}`]);
    for (const key of conditions.open.keys()) if (!now.has(key)) conditions.set(key, t, "ok", "");
    for (const [key, [level, text]] of now) conditions.set(key, t, level, text);
  }
  return conditions.all;
}

// A limit's name without its numbers, which change.
function nameOf(text) {
  return text.split(":")[0];
}

function ofSilence(store, vehicle) {
  if (store.team) return []; // a vehicle under water is silent; the team's lines name one that should not be
  const list = store.list("pose", vehicle), found = [], alarm = (from, to) => found.push({ from: from + SILENT_S, to, level: "error", text: "silent" });
  for (let i = 1; i < list.length; i++) if (list[i].t - list[i - 1].t > SILENT_S) alarm(list[i - 1].t, list[i].t);
  const last = list[list.length - 1], finished = store.at("status", "", Infinity)?.state === "finished";
  if (last && !finished && store.lastS - last.t > SILENT_S) alarm(last.t, null);
  return found;
}
