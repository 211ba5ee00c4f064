// Connects the parts of the page: receives events, and draws the mission at the selected time.

import { Alarms } from "./alarms.js";
import { Pen } from "./canvas.js";
import { Chart, teamSum } from "./chart.js";
import { LAYERS, themeColors, vehicleColor } from "./colors.js";
import { Commands } from "./commands.js";
import { clock, element, fromGeodetic, number, setText } from "./format.js";
import { Link } from "./link.js";
import { MapView } from "./map.js";
import { Measure } from "./measure.js";
import { Player } from "./player.js";
import { SlotView } from "./slots.js";
import { Store } from "./store.js";
import { TeamView } from "./team.js";
import { VehicleCards } from "./vehicles.js";

const $ = (id) => document.getElementById(id);
const store = new Store(), player = new Player(store);
const map = new MapView($("map"), $("readout"), store, new Measure($("measured"), $("measure")));
const slots = new SlotView($("slots"), $("slots-words"), store);
const cards = new VehicleCards($("vehicles"), store, (vehicle) => choose(vehicle));
const reward = new Chart($("reward"), store, rewardCurves, (t) => player.seek(t));
const risk = new Chart($("risk"), store, riskCurves, (t) => player.seek(t));
const alarms = new Alarms($("alarms"), store, (t) => player.seek(t));
const team = new TeamView($("team"), $("sound"));
const commands = new Commands($("commands"), $("confirm"), store, () => link?.name);
let link = null, source = { connection: "connecting" }, begun = null, drawn = "", drawnChanges = 0, drawnAt = 0, lastFrame = performance.now();
const LOADING_MS = 500; // time between two drawings while many events arrive: drawing each time would hold them up

// ---------------------------------------------------------------------- what is drawn

function rewardCurves() {
  const share = store.facts.reward_of !== "path" ? 1 / store.facts.vehicles.length : 1; // the map's risk belongs to the whole team
  const of = (value) => teamSum(store, value).map(({ t, value: sum }) => ({ t, value: sum * share }));
  const ofMap = store.facts.reward_of !== "path", { ink, accent } = themeColors(), soFar = of((b) => b.reward);
  // the lower bound of the map's reward needs the soundings of all vehicles: only the report has it
  const ahead = of((b) => (ofMap ? b.reward !== null && b.jbar !== null ? b.reward + b.jbar : null : b.bound_max));
  const isKnown = ahead.some((q, i) => soFar[i] && q.value > soFar[i].value + 1e-6); // only some methods know it
  const curves = [{ name: "so far", color: ink, steps: true, points: soFar }];
  if (isKnown) curves.push({ name: ofMap ? "expected" : "bound", color: accent, dash: [6, 4], steps: true, points: ahead });
  return curves;
}

function riskCurves() {
  return store.facts.vehicles.map(({ number: vehicle }) => ({
    name: `auv${vehicle}`,
    color: vehicleColor(vehicle),
    points: store.list("map", vehicle).map((m) => ({ t: m.t, value: m.expected_loss })),
  }));
}

function expectedEnd() {
  const { facts } = store, known = facts.vehicles.some((v) => store.list("bound", v.number).length);
  const done = source.growing ? 0 : store.lastS;
  return done || Math.max(store.lastS, known ? store.startS + facts.steps * facts.leg_s : store.lastS);
}

function draw() {
  const t = player.t, end = expectedEnd();
  map.draw(t);
  slots.draw(t);
  const kinds = reward.draw(t, end), risks = risk.draw(t, end);
  const words = (values, digits) => values.map(({ name, value }) => `${name} ${number(value, digits)}`).join(", ");
  const [name, counted] = {
    map: ["Map reward", "Drop of the map’s total risk, averaged over the vehicles"],
    line: ["Line reward", "Metres of isobath located, averaged over the vehicles"],
  }[store.facts.reward_of] ?? ["Path reward", "Sum over the vehicles"];
  setText($("reward-name"), name);
  setText($("reward-words"), `Now: ${words(kinds, 0)}${kinds.length > 1 ? " (dashed)" : ""}. ${counted}.`);
  setText($("risk-words"), `Now: ${risks.length > 8 ? range(risks) : words(risks, 2)}. Lower is better.`);
  cards.update(t, map.vehicle);
  alarms.update(t);
  describeMap(t);
}

// Lowest and highest of many values, as a text.
function range(values) {
  const known = values.filter(({ value }) => Number.isFinite(value)).sort((a, b) => a.value - b.value);
  const text = ({ name, value }) => `${number(value, 2)} (${name})`;
  return known.length ? `${text(known[0])} to ${text(known[known.length - 1])}` : "–";
}

function describeMap(t) {
  const { facts } = store, level = number(facts.level_m, facts.level_m % 1 ? 1 : 0);
  const shown = store.at("map", map.vehicle, t), plan = store.at("plan", map.vehicle, t);
  setText($("map-title"), `Map of auv${map.vehicle}, ${level} m isobath`);
  const age = shown ? `Updated at ${clock(shown.t - store.startS)}` : "No map yet";
  const continuation = plan?.continued ? `; the plan continues as ${plan.continued}` : "";
  setText($("map-words"), `${age}${continuation}.`);
  map.canvas.setAttribute("aria-label", `Map of the area, colored by ${facts.names.layers[map.layer]}, with the vehicles’ tracks and plans`);
}

function describeState() {
  const pill = $("state"), status = store.at("status", "", player.t);
  const final = store.at("status", "", Infinity), complete = source.source === "mission" && final?.state === "finished";
  let [text, level] = ["", ""];
  if (complete && (source.connection === "lost" || !source.growing)) [text, level] = ["mission complete", "ok"];
  else if (source.connection === "lost") [text, level] = ["connection lost, reconnecting", "error"];
  else if (!store.facts) [text, level] = [source.waiting || "waiting for a mission", ""];
  else if (source.loading) text = "loading";
  else if (!player.following && source.growing) [text, level] = ["paused in the past", "warning"];
  else if (status && source.growing) [text, level] = [status.state, status.state === "failed" ? "error" : "ok"];
  else if (source.growing) [text, level] = ["running", "ok"];
  else if (source.source === "mission") [text, level] = [status?.state === "failed" ? "failed" : "mission ended", ""];
  else [text, level] = [status?.state === "failed" ? "failed" : "recording", status?.state === "failed" ? "error" : ""];
  setText(pill, text);
  pill.dataset.level = level;
  $("waiting").hidden = Boolean(store.facts) || source.connection !== "open" || source.loading || Boolean(source.problem);
  const problem = source.problem || (status?.state === "failed" ? status.text : "");
  const left = complete && source.connection === "lost" && source.run;
  const early = complete && final.text?.startsWith("the quality asked for") ? `Mission complete: ${final.text}.` : "";
  $("ending").hidden = !(early || left);
  const results = left ? `The live view has ended. The results are in ${source.run}; auv_lse live ${source.run} shows the mission again.` : "";
  setText($("ending"), [early, results].filter(Boolean).join(" "));
  $("problem").hidden = !problem;
  setText($("problem"), problem);
  $("live").hidden = !source.growing;
  $("live").setAttribute("aria-pressed", String(player.following));
}

function describeMission() {
  const { facts } = store, n = facts.vehicles.length;
  setText($("title"), facts.name);
  document.title = `${facts.name} · live view`;
  for (const button of $("layers").children) setText(button, facts.names.layers[button.dataset.layer]);
  setText($("risk-name"), facts.names.expected_loss);
  setText($("risk-unit"), facts.names.cost_per_position);
  const status = store.at("status", "", player.t);
  const speed = status && source.growing ? ` · ${number(status.speed, status.speed < 10 ? 1 : 0)} × real time` : "";
  setText($("facts"), `${n} vehicle${n > 1 ? "s" : ""} · method ${facts.method} · seed ${facts.seed}${speed}`);
}

function describeTime() {
  const slider = $("time"), start = store.startS, last = Math.max(store.lastS - start, 1), now = player.t - start;
  if (slider.max !== String(Math.ceil(last))) slider.max = String(Math.ceil(last));
  const value = String(Math.round(now));
  if (slider.value !== value) slider.value = value;
  const valueText = `${clock(now)} of ${clock(last)}`;
  if (slider.getAttribute("aria-valuetext") !== valueText) slider.setAttribute("aria-valuetext", valueText);
  setText($("clock"), `${clock(now)} / ${clock(last)}`);
  const moving = player.playing || (player.following && source.growing);
  setText($("play"), moving ? "❚❚" : "▶");
  $("play").setAttribute("aria-label", moving ? "Pause" : "Play");
}

// ---------------------------------------------------------------------- legend and choices

function choose(vehicle) {
  if (!store.facts?.vehicles.some((v) => v.number === vehicle)) return;
  map.vehicle = vehicle;
  drawn = "";
}

function chooseLayer(name) {
  map.layer = name;
  for (const button of $("layers").children) {
    const chosen = button.dataset.layer === name;
    button.setAttribute("aria-checked", String(chosen));
    button.tabIndex = chosen ? 0 : -1;
  }
  drawLegend();
  drawn = "";
}

function makeLayers() {
  for (const { name, key, title } of LAYERS) {
    const button = element("button", { type: "button", role: "radio", title: `${title} (${key})`, "data-layer": name });
    button.addEventListener("click", () => chooseLayer(name));
    $("layers").append(button);
  }
  $("layers").addEventListener("keydown", (e) => {
    const by = { ArrowRight: 1, ArrowLeft: -1 }[e.key], all = [...$("layers").children];
    if (!by) return;
    e.stopPropagation();
    const next = all[(all.findIndex((b) => b.dataset.layer === map.layer) + by + all.length) % all.length];
    chooseLayer(next.dataset.layer);
    next.focus();
  });
}

function drawLegend() {
  const root = $("legend"), { facts } = store, layer = LAYERS.find((l) => l.name === map.layer);
  root.replaceChildren();
  if (!facts) return;
  const bar = element("canvas", { width: "110", height: "12", "aria-hidden": "true" }), c = bar.getContext("2d");
  for (let i = 0; i < 110; i++) {
    const at = 3 * Math.round((i / 109) * 254);
    c.fillStyle = `rgb(${layer.colors[at]} ${layer.colors[at + 1]} ${layer.colors[at + 2]})`;
    c.fillRect(i, 0, 1, 12);
  }
  const scale = facts.layers.find((l) => l.name === layer.name);
  const ends = { risk: ["0", `${number(facts.largest_risk, 1)} (${facts.names.cost_per_position})`], p_safe: ["0", "1"], std: ["0", "largest here (m)"],
    depth: [`${number(scale.low)} m`, `${number(scale.low + 254 * scale.step)} m`] }[layer.name];
  const words = (text) => element("span", {}, text);
  root.append(element("span", { title: layer.title }, words(facts.names.layers[layer.name]), words(ends[0]), bar, words(ends[1])));
  const toggles = { band: "95 % band", plans: "Plans", samples: "Received samples" };
  if (facts.origin_deg) toggles.graticule = "Latitude and longitude";
  if (facts.true_isobath.length) toggles.true_isobath = "True isobath (dashed)";
  if (facts.simulated) toggles.truth = "True tracks (dotted)";
  for (const [name, text] of Object.entries(toggles)) {
    const box = element("input", { type: "checkbox" });
    box.checked = map.shown[name];
    box.addEventListener("change", () => {
      map.shown[name] = box.checked;
      drawn = "";
    });
    root.append(element("label", {}, box, text));
  }
}

function chooseTheme(name) {
  const dark = name === "dark" || (name === "auto" && matchMedia("(prefers-color-scheme: dark)").matches);
  document.documentElement.toggleAttribute("data-dark", dark);
  setText($("theme"), `Theme: ${name}`);
  $("theme").dataset.name = name;
  drawn = "";
}

function nextTheme() {
  chooseTheme({ auto: "light", light: "dark", dark: "auto" }[$("theme").dataset.name]);
}

// ---------------------------------------------------------------------- keys

const KEYS = {
  " ": () => player.toggle(),
  l: () => player.follow(),
  Home: () => player.seek(store.startS),
  End: () => (source.growing ? player.follow() : player.seek(store.lastS)),
  t: nextTheme,
  "?": () => $("help").showModal(),
  ...Object.fromEntries(LAYERS.map(({ key, name }) => [key, () => chooseLayer(name)])),
};

document.addEventListener("keydown", (e) => {
  if (e.ctrlKey || e.metaKey || e.altKey || document.querySelector("dialog[open]") || ["SELECT"].includes(e.target.tagName)) return;
  if (e.target === $("time") && /^(Arrow|Home|End|Page)/.test(e.key)) return; // the slider handles these keys
  if (e.key === " " && ["BUTTON", "INPUT"].includes(e.target.tagName) && e.target !== $("time")) return;
  const arrows = { ArrowLeft: -10, ArrowRight: 10 };
  let handled = true;
  if (store.facts && map.key(e)) drawn = "";
  else if (arrows[e.key] && e.target !== $("map")) player.seek(player.t + arrows[e.key] * (e.shiftKey ? 6 : 1));
  else if (KEYS[e.key]) KEYS[e.key]();
  else if (/^[1-9]$/.test(e.key)) choose(Number(e.key));
  else handled = false;
  if (handled) e.preventDefault();
});

// ---------------------------------------------------------------------- start

function frame(now) {
  player.growing = Boolean(source.growing);
  player.advance(Math.min(0.25, (now - lastFrame) / 1000));
  lastFrame = now;
  if (begun !== store.facts) {
    begun = store.facts;
    document.documentElement.toggleAttribute("data-waiting", !begun);
    player.begin();
    map.begin();
    cards.begin();
    drawLegend();
  }
  const { clientWidth, clientHeight } = $("map");
  const probe = map.probe ? `${map.probe.x} ${map.probe.y}` : "";
  const focus = document.activeElement === $("map");
  const loading = source.loading || store.packed > store.facts?.vehicles.length;
  const state = [loading && player.following ? "" : player.t, clientWidth, clientHeight, innerWidth, devicePixelRatio, probe, focus, JSON.stringify(map.view), map.measure.active, map.measure.points.length, map.vehicle, JSON.stringify(source)].join(" ");
  if (state !== drawn || (store.changes !== drawnChanges && !(loading && now - drawnAt < LOADING_MS))) {
    [drawn, drawnChanges, drawnAt] = [state, store.changes, now];
    describeState();
    commands.update(source, map.vehicle);
    store.team = source.team ?? null;
    team.update(source.team, source.connection === "lost");
    if (store.facts) {
      describeMission();
      describeTime();
      draw();
    }
  }
  requestAnimationFrame(frame);
}

makeLayers();
chooseLayer("risk");
chooseTheme("auto");
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => chooseTheme($("theme").dataset.name));
$("theme").addEventListener("click", nextTheme);
$("play").addEventListener("click", () => player.toggle());
$("live").addEventListener("click", () => player.follow());
$("measure").addEventListener("click", () => map.toggleMeasure());
$("fit").addEventListener("click", () => map.fit());
$("time").addEventListener("input", () => player.seek(Number($("time").value) + store.startS));
$("rate").addEventListener("change", () => (player.rate = Number($("rate").value)));
$("help-button").addEventListener("click", () => $("help").showModal());
const kept = $("kept").textContent;
if (kept) {
  source = { connection: "open", growing: false };
  for (const event of JSON.parse(kept)) store.add(event);
} else {
  link = new Link(store, (state) => (source = state.connection === "open" ? state : { ...source, ...state }));
}
window.liveView = { store, player, map, Pen, fromGeodetic, vehicleColor }; // for tests and debugging
requestAnimationFrame(frame);
