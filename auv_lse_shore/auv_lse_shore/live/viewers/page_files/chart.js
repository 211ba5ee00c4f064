// Curves over mission time, with axes, and a mark at the selected time.

import { Pen, prepare } from "./canvas.js";
import { themeColors } from "./colors.js";
import { number, tickDigits, ticks, tickStep } from "./format.js";
import { indexAfter } from "./store.js";

const AXES = { left: 52, right: 12, top: 8, bottom: 34 };

export class Chart {
  // `curves(t)` gives [{name, color, dash, steps, points: [{t, value}]}]; onSeek(t) is called when the chart is clicked.
  constructor(canvas, store, curves, onSeek) {
    this.canvas = canvas;
    this.store = store;
    this.curves = curves;
    canvas.addEventListener("pointerdown", (e) => {
      const at = this.time?.(e.offsetX);
      if (at !== undefined) onSeek(at);
    });
  }

  draw(t, endS) {
    const { canvas, store } = this, width = canvas.clientWidth, height = canvas.clientHeight;
    const c = prepare(canvas, width, height), theme = themeColors();
    c.clearRect(0, 0, width, height);
    if (!store.facts || width < 100) return [];
    if (this.made !== store.changes || this.ink !== theme.ink) {
      [this.made, this.ink, this.kept] = [store.changes, theme.ink, this.curves()];
      this.range = rangeOf(this.kept);
    }
    const curves = this.kept, start = store.startS, { low, high } = this.range, span = Math.max(60, endS - start);
    const right = width - AXES.right, bottom = height - AXES.bottom;
    const x = (s) => AXES.left + ((s - start) / span) * (right - AXES.left), y = (v) => bottom - ((v - low) / (high - low)) * (bottom - AXES.top);
    this.time = (px) => start + ((px - AXES.left) / (right - AXES.left)) * span;
    c.font = "12px system-ui, sans-serif";
    c.lineWidth = 1;
    const step = tickStep(high - low, (bottom - AXES.top) / 30), minutes = tickStep(span / 60, (right - AXES.left) / 60);
    c.textAlign = "right";
    c.textBaseline = "middle";
    for (const value of ticks(low, high, step)) {
      c.fillStyle = theme.grid;
      c.fillRect(AXES.left, Math.round(y(value)), right - AXES.left, 1);
      c.fillStyle = theme.soft;
      c.fillText(number(value, tickDigits(step)), AXES.left - 6, y(value));
    }
    c.textAlign = "center";
    c.textBaseline = "top";
    for (const minute of ticks(0, span / 60, minutes)) {
      c.fillRect(x(start + 60 * minute), bottom, 1, 4);
      c.fillText(number(minute, tickDigits(minutes)), x(start + 60 * minute), bottom + 5);
    }
    c.fillText("mission time (min)", (AXES.left + right) / 2, bottom + 19);
    c.lineJoin = "round";
    for (const { color, dash, steps, points } of curves) this.line(c, x, y, t, points, steps, color, dash ?? []);
    c.fillStyle = theme.accent;
    c.fillRect(x(t) - 1, AXES.top, 2, bottom - AXES.top);
    return curves.map(({ name, points }) => ({ name, value: points[indexAfter(points, t) - 1]?.value ?? null }));
  }

  // Draws a curve in full color up to time t, and pale after it.
  line(c, x, y, t, points, steps, color, dash) {
    const past = indexAfter(points, t);
    for (const [alpha, list] of [[0.3, points.slice(Math.max(0, past - 1))], [1, points.slice(0, past)]]) {
      const pen = new Pen(c);
      c.beginPath();
      list.forEach((q, i) => {
        if (steps && i) pen.to(x(q.t), y(list[i - 1].value));
        pen.to(x(q.t), y(q.value));
      });
      pen.end();
      c.globalAlpha = alpha;
      c.setLineDash(dash);
      c.strokeStyle = color;
      c.lineWidth = 2.2;
      c.stroke();
      c.setLineDash([]);
      c.globalAlpha = 1;
    }
  }
}

// The values that the vertical axis spans.
function rangeOf(curves) {
  let low = 0, high = 1e-6;
  for (const { points } of curves) for (const { value } of points) [low, high] = [Math.min(low, value), Math.max(high, value)];
  return { low, high: curves.some(({ points }) => points.length) ? 1.05 * high : 1 };
}

// Sums a value of the vehicles' decisions over the team: one point per decision, once every vehicle has decided.
export function teamSum(store, value) {
  const lists = store.facts.vehicles.map((v) => store.list("bound", v.number).filter((b) => value(b) !== null));
  if (lists.some((list) => !list.length)) return [];
  const all = lists.flatMap((list, i) => list.map((b) => ({ t: b.t, vehicle: i, value: value(b) }))).sort((a, b) => a.t - b.t);
  const now = new Array(lists.length).fill(null), points = [];
  for (const { t, vehicle, value: v } of all) {
    now[vehicle] = v;
    if (now.includes(null)) continue;
    const total = now.reduce((sum, each) => sum + each, 0);
    if (points.length && points[points.length - 1].t === t) points[points.length - 1].value = total;
    else points.push({ t, value: total });
  }
  return points;
}
