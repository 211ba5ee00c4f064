// Acoustic slots over time: one row per vehicle, packets as blocks, receptions as dots, missed ones as crosses.

import { prepare } from "./canvas.js";
import { themeColors, vehicleColor, rgba } from "./colors.js";
import { clock, number, setText, ticks, tickStep } from "./format.js";
import { packetsAt, receptionsOf, slotAt } from "./packets.js";

const STRIP = { left: 52, right: 12, top: 4, bottom: 34 };

export class SlotView {
  constructor(canvas, words, store) {
    this.canvas = canvas;
    this.words = words;
    this.store = store;
  }

  draw(t) {
    const { store, canvas } = this, facts = store.facts;
    if (!facts) return;
    const row = facts.vehicles.length > 12 ? 9 : facts.vehicles.length > 6 ? 14 : 22, high = STRIP.top + STRIP.bottom + row * facts.vehicles.length;
    if (canvas.style.height !== `${high}px`) canvas.style.height = `${high}px`;
    const width = canvas.clientWidth, c = prepare(canvas, width, high), theme = themeColors(), tdma = facts.tdma;
    c.clearRect(0, 0, width, high);
    const cycle = tdma.slot_s * tdma.order.length, span = Math.max(60, Math.min(3 * cycle, (width / 7) * 1.5));
    const from = t - 0.8 * span, to = from + span, x = (s) => STRIP.left + ((s - from) / span) * (width - STRIP.left - STRIP.right);
    const y = (vehicle) => STRIP.top + (facts.vehicles.findIndex((v) => v.number === vehicle) + 0.5) * row;
    const bottom = STRIP.top + row * facts.vehicles.length;
    c.save();
    c.beginPath();
    c.rect(STRIP.left, 0, width - STRIP.left - STRIP.right, high);
    c.clip();
    for (let s = slotAt(tdma, from).start; s < to; s += tdma.slot_s) {
      const { owner } = slotAt(tdma, s + tdma.slot_s / 2);
      c.fillStyle = theme.grid;
      c.fillRect(x(s), STRIP.top, 1, bottom - STRIP.top);
      if (!owner) continue;
      c.fillStyle = rgba(vehicleColor(owner), 0.25);
      c.fillRect(x(s) + 1, y(owner) - row / 2 + 1, x(s + tdma.slot_s) - x(s) - 2, row - 2);
    }
    for (const packet of packetsAt(store, t, span)) this.drawPacket(c, packet, x, y, row, theme);
    c.fillStyle = theme.accent;
    c.fillRect(x(t) - 1, STRIP.top, 2, bottom - STRIP.top + 5);
    c.restore();
    c.fillStyle = theme.ink;
    c.font = `${row < 20 ? (row < 11 ? 10 : 11) : 13}px system-ui, sans-serif`;
    c.textAlign = "right";
    c.textBaseline = "middle";
    const every = row < 11 ? 2 : 1; // else the names would touch
    for (const { number: vehicle } of facts.vehicles.filter((_, i) => i % every === 0)) c.fillText(`auv${vehicle}`, STRIP.left - 8, y(vehicle));
    c.fillStyle = theme.soft;
    c.font = "12px system-ui, sans-serif";
    c.textAlign = "center";
    c.textBaseline = "top";
    const step = Math.max(10, tickStep(span, (width - STRIP.left) / 90)), start = store.startS;
    for (const s of ticks(Math.max(0, from - start), to - start, step)) {
      const at = x(s + start);
      c.fillRect(at, bottom, 1, 4);
      if (at > STRIP.left + 14 && at < width - 24) c.fillText(clock(s), at, bottom + 5);
    }
    c.fillText(`mission time (${to - start < 3600 ? "min:s" : "h:min:s"})`, STRIP.left + (width - STRIP.left - STRIP.right) / 2, bottom + 19);
    this.describe(t);
  }

  drawPacket(c, packet, x, y, row, theme) {
    const { send_s } = this.store.facts.tdma, color = vehicleColor(packet.vehicle), here = y(packet.vehicle);
    c.fillStyle = color;
    c.strokeStyle = theme.ink;
    c.lineWidth = 1;
    const wide = Math.max(4, x(packet.t + send_s) - x(packet.t));
    c.fillRect(x(packet.t), here - row * 0.32, wide, row * 0.64);
    c.strokeRect(x(packet.t), here - row * 0.32, wide, row * 0.64);
    for (const { vehicle, due, state } of packet.receptions) {
      if (state === "flying" || state === "unknown") continue;
      const at = x(due), there = y(vehicle), size = Math.min(5, row * 0.26);
      c.strokeStyle = rgba(color, 0.8);
      c.beginPath();
      c.moveTo(at, here);
      c.lineTo(at, there);
      if (state === "heard") c.stroke();
      c.beginPath();
      if (state === "heard") {
        c.fillStyle = color;
        c.arc(at, there, size, 0, 7);
        c.fill();
        c.strokeStyle = theme.ink;
        c.stroke();
      } else {
        c.moveTo(at - size, there - size);
        c.lineTo(at + size, there + size);
        c.moveTo(at - size, there + size);
        c.lineTo(at + size, there - size);
        c.strokeStyle = theme.bad;
        c.lineWidth = 2.4;
        c.stroke();
        c.lineWidth = 1;
      }
    }
  }

  // Describes the current slot and the last packet in words.
  describe(t) {
    const { store } = this, facts = store.facts, slot = slotAt(facts.tdma, t), start = store.startS;
    const last = facts.vehicles.map((v) => store.at("sent", v.number, t)).filter(Boolean).sort((a, b) => b.t - a.t)[0];
    const owner = slot.owner ? `Slot of auv${slot.owner}` : "Free slot";
    const now = `${owner}, ${clock(slot.start - start)} to ${clock(slot.end - start)}.`;
    if (!last) return setText(this.words, `${now} No packet yet.`);
    const outcomes = receptionsOf(store, last, t).map(({ vehicle, heard, state }) => {
      const snr = heard && heard.snr_db !== null ? ` (${number(heard.snr_db)} dB)` : "";
      return { flying: `on its way to auv${vehicle}`, heard: `received by auv${vehicle}${snr}`, lost: `missed by auv${vehicle}`, unknown: `no data of auv${vehicle}` }[state];
    });
    const content = last.samples === undefined ? `${last.bytes} bytes (${last.problem})` : `${last.samples} samples and a plan`;
    setText(this.words, `${now} Last packet: auv${last.vehicle} at ${clock(last.t - start)}, ${content}; ${outcomes.join(", ") || "no other vehicle"}.`);
  }
}
