// One card per vehicle: health, progress, position and packets. Clicking a card shows that vehicle's map.

import { missionEndS, ownText, PLANNER, SILENT_S } from "./alarms.js";
import { vehicleColor } from "./colors.js";
import { element, geodetic, number, setText } from "./format.js";

const WORST = ["ok", "warning", "error", "stale"];
const SIGNS = { ok: "✓ ok", warning: "⚠ warning", error: "✖ error", stale: "✖ stale", silent: "✖ silent", unknown: "… no data" };
const FIELDS = ["mission", "step", "N, E", "position ±", "depth", "speed", "battery", "decision", "packets"];
const SHORT = ["mission", "step", "packets"]; // rows shown on the cards of a large team, except on the selected card
const TITLES = { "N, E": "north, east of the origin", "position ±": "standard deviation of the estimated position", packets: "sent / received",
  battery: "legs that the battery lasts before the way to the recovery position / legs planned" };
const LARGE_TEAM = 4, HUGE_TEAM = 8;
const RECENT_S = 120; // as in auv_lse_common.vocabulary.health

export class VehicleCards {
  constructor(root, store, onChoose) {
    this.root = root;
    this.store = store;
    this.onChoose = onChoose;
    this.cards = new Map();
  }

  begin() {
    this.cards.clear();
    this.root.replaceChildren();
    const size = this.store.facts?.vehicles.length ?? 0;
    this.root.toggleAttribute("data-large", size > LARGE_TEAM);
    document.documentElement.toggleAttribute("data-huge", size > HUGE_TEAM);
    for (const { number: vehicle, depth_m } of this.store.facts?.vehicles ?? []) {
      const card = element("button", { type: "button", class: "vehicle", "aria-pressed": "false" });
      const swatch = element("span", { class: "swatch", style: `background: ${vehicleColor(vehicle)}` });
      const health = element("span", { class: "health" }), note = element("p", { class: "note" }), list = element("dl");
      const meter = element("i", { style: `background: ${vehicleColor(vehicle)}` });
      const fields = Object.fromEntries(FIELDS.map((name) => {
        const kind = { class: SHORT.includes(name) ? "" : "more" }, value = element("dd", kind);
        list.append(element("dt", TITLES[name] ? { ...kind, title: TITLES[name] } : kind, name), value);
        return [name, value];
      }));
      card.append(
        element("span", { class: "name" }, swatch, `auv${vehicle}`, health),
        element("div", { class: "meter", "aria-hidden": "true" }, meter), list, note);
      card.addEventListener("click", () => this.onChoose(vehicle));
      this.root.append(card);
      this.cards.set(vehicle, { card, health, note, meter, fields, depth_m });
    }
  }

  update(t, chosen) {
    for (const [vehicle, parts] of this.cards) this.updateCard(vehicle, parts, t, vehicle === chosen);
  }

  updateCard(vehicle, { card, health, note, meter, fields }, t, chosen) {
    const { store } = this, at = (kind) => store.at(kind, vehicle, t);
    const pose = at("pose"), bound = at("bound"), facts = store.facts;
    const { level, notes, legs } = this.health(vehicle, t, pose);
    for (const limit of at("run")?.limits ?? []) notes.push(`limit tripped: ${limit}`);
    const missed = (at("slots")?.missed ?? 0) - (store.at("slots", vehicle, t - RECENT_S)?.missed ?? 0);
    if (missed > 0) notes.push(`${missed} slot${missed > 1 ? "s" : ""} missed in the last ${RECENT_S / 60} min`);
    const steps = store.at("status", "", t)?.steps?.[vehicle - 1] ?? bound?.step ?? 0;
    if (health.dataset.level !== level) health.dataset.level = level;
    setText(health, SIGNS[level]);
    setText(note, notes.join("; "));
    note.title = note.textContent;
    note.hidden = !notes.length;
    const width = `${(100 * Math.min(1, steps / facts.steps)).toFixed(1)}%`;
    if (meter.style.width !== width) meter.style.width = width;
    const run = at("run");
    setText(fields.mission, run ? run.state + (run.state !== "running" && run.reason ? `: ${run.reason}` : "") : "–");
    setText(fields.step, `${steps} of ${facts.steps}`);
    setText(fields["N, E"], pose ? `${number(pose.north)}, ${number(pose.east)}\u00a0m` : "–");
    fields["N, E"].title = pose && facts.origin_deg ? geodetic(pose.north, pose.east, facts.origin_deg) : "";
    setText(fields["position ±"], pose && pose.std !== null ? `${number(pose.std, 1)} m` : "–");
    setText(fields.depth, pose ? `${number(pose.depth, 1)} m` : "–");
    setText(fields.speed, pose ? `${number(pose.speed, 1)} m/s` : "–");
    for (const part of [fields.battery.previousSibling, fields.battery]) part.hidden = legs === undefined;
    if (legs !== undefined) setText(fields.battery, `${legs} legs / ${Math.max(0, facts.steps - steps)} planned`);
    setText(fields.decision, bound ? `${number(1000 * bound.planning_s)} ms${bound.late ? ", deadline" : ""}` : "–");
    setText(fields.packets, `${store.count("sent", vehicle, t)} / ${store.count("received", vehicle, t)}`);
    card.setAttribute("aria-pressed", String(chosen));
    card.title = chosen ? "This vehicle’s map is shown" : "Show this vehicle’s map";
  }

  // The worst health level of the vehicle's nodes, and the messages of those that are not "ok".
  health(vehicle, t, pose) {
    if (!pose) return { level: "unknown", notes: [] };
    const finished = this.store.at("status", "", t)?.state === "finished";
    if (!finished && !this.store.team && t - pose.t > SILENT_S) return { level: "silent", notes: [`silent for ${number(t - pose.t)} s`] };
    const nodes = new Map();
    for (const event of this.store.between("health", vehicle, -Infinity, t)) nodes.set(event.node, event);
    if (t >= missionEndS(this.store)) nodes.delete(PLANNER);
    const legs = nodes.get("safety_node")?.values?.["legs left by battery"];
    let level = "ok";
    const notes = [];
    for (const { t: at, node, level: own, text } of nodes.values()) {
      if (WORST.indexOf(own) > WORST.indexOf(level)) level = own;
      const rest = ownText(this.store.at("run", vehicle, at), text);
      if (own !== "ok" && (rest || !text)) notes.push(`${node}: ${rest}`);
    }
    return { level, notes, legs };
  }
}
