// The map view: one vehicle's map, and the tracks, plans and packets of all vehicles.

import { cross, DM, label, Pen, prepare, stroke, strokeWithCasing, trace } from "./canvas.js";
import { sharesColor, LAYERS, rgba, themeColors, vehicleColor } from "./colors.js";
import { drawGraticule } from "./graticule.js";
import { geodetic, number, tickDigits, ticks, tickStep } from "./format.js";
import { packetsAt } from "./packets.js";
import { OUTSIDE } from "./store.js";

const MARGIN = { left: 58, right: 10, top: 10, bottom: 40 };

export class MapView {
  constructor(canvas, readout, store, measure) {
    this.canvas = canvas;
    this.measure = measure;
    this.readout = readout;
    this.store = store;
    this.vehicle = 1;
    this.layer = "risk";
    this.shown = { band: true, plans: true, truth: false, samples: true, true_isobath: true, graticule: true };
    this.raster = { key: "" };
    this.pointers = new Map();
    this.probe = null; // position of the readout (canvas pixels)
    this.fit();
    this.listen();
  }

  begin() {
    this.vehicle = 1;
    this.fit();
  }

  // ------------------------------------------------------------------ view

  fit() {
    this.view = null;
  }

  size() {
    return { width: this.canvas.clientWidth, height: this.canvas.clientHeight };
  }

  currentView() {
    if (this.view) return this.view;
    const [south, north, west, east] = this.store.facts.extent_m, { width, height } = this.size();
    const wide = Math.max(width - MARGIN.left - MARGIN.right, 40), high = Math.max(height - MARGIN.top - MARGIN.bottom, 40);
    const scale = 0.96 * Math.min(wide / (east - west), high / (north - south));
    return { north: (north + south) / 2, east: (east + west) / 2, scale };
  }

  // Converts positions (north, east in metres) to canvas pixels, and back.
  projection() {
    const { width, height } = this.size(), view = this.currentView();
    const x0 = (MARGIN.left + width - MARGIN.right) / 2, y0 = (MARGIN.top + height - MARGIN.bottom) / 2;
    return {
      scale: view.scale,
      x: (east) => x0 + (east - view.east) * view.scale,
      y: (north) => y0 - (north - view.north) * view.scale,
      position: (x, y) => ({ north: view.north + (y0 - y) / view.scale, east: view.east + (x - x0) / view.scale }),
    };
  }

  zoom(factor, x, y) {
    const { width, height } = this.size(), about = this.projection().position(x ?? width / 2, y ?? height / 2);
    const view = this.currentView(), scale = Math.min(200, Math.max(0.005, view.scale * factor)), ratio = view.scale / scale;
    this.view = {
      scale,
      north: about.north + (view.north - about.north) * ratio,
      east: about.east + (view.east - about.east) * ratio,
    };
  }

  move(dx, dy) {
    const view = this.currentView();
    this.view = { scale: view.scale, north: view.north + dy / view.scale, east: view.east - dx / view.scale };
  }

  listen() {
    const canvas = this.canvas, at = (e) => ({ x: e.offsetX, y: e.offsetY });
    canvas.addEventListener("pointerdown", (e) => {
      canvas.setPointerCapture(e.pointerId);
      this.pointers.set(e.pointerId, at(e));
      this.moved = 0;
    });
    canvas.addEventListener("pointermove", (e) => {
      this.probe = at(e);
      const before = this.pointers.get(e.pointerId);
      if (!before || !this.store.facts) return;
      const now = at(e), other = [...this.pointers].find(([id]) => id !== e.pointerId)?.[1];
      if (other) {
        const span = (p) => Math.hypot(p.x - other.x, p.y - other.y) || 1;
        this.zoom(span(now) / span(before), (now.x + other.x) / 2, (now.y + other.y) / 2);
      } else {
        this.move(now.x - before.x, now.y - before.y);
        this.moved += Math.hypot(now.x - before.x, now.y - before.y);
      }
      this.pointers.set(e.pointerId, now);
    });
    const end = (e) => this.pointers.delete(e.pointerId);
    canvas.addEventListener("pointerup", (e) => {
      end(e);
      if (this.measure.active && this.store.facts && this.moved < 5) this.measure.add(this.projection().position(e.offsetX, e.offsetY));
    });
    canvas.addEventListener("pointercancel", end);
    canvas.addEventListener("pointerleave", () => (this.probe = null));
    canvas.addEventListener("wheel", (e) => {
      if (!this.store.facts) return;
      e.preventDefault();
      this.zoom(Math.exp(-0.0015 * e.deltaY), e.offsetX, e.offsetY);
    }, { passive: false });
  }

  // Handles a key of the map; returns whether the key is one.
  key(event) {
    const step = 40, moves = { ArrowLeft: [step, 0], ArrowRight: [-step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
    const focused = document.activeElement === this.canvas;
    if (moves[event.key] && focused) {
      this.probe = null; // the position described is then the center
      this.move(...moves[event.key]);
    } else if (event.key === "Enter" && focused && this.measure.active) this.measure.add(this.describedPosition());
    else if (event.key === "m") this.toggleMeasure();
    else if (event.key === "Escape" && this.measure.active) this.measure.stop();
    else if (event.key === "+" || event.key === "=") this.zoom(1.25);
    else if (event.key === "-") this.zoom(0.8);
    else if (event.key === "0") this.fit();
    else return false;
    return true;
  }

  toggleMeasure() {
    if (this.measure.active) return this.measure.stop();
    this.measure.start();
    this.canvas.focus();
  }

  // The position under the pointer, else the center.
  describedPosition() {
    const { width, height } = this.size(), { x, y } = this.probe ?? { x: width / 2, y: height / 2 };
    return this.projection().position(x, y);
  }

  // ------------------------------------------------------------------ drawing

  draw(t) {
    const { store, canvas } = this, facts = store.facts, { width, height } = this.size();
    const c = prepare(canvas, width, height), theme = themeColors();
    c.fillStyle = theme.card;
    c.fillRect(0, 0, width, height);
    if (!facts || width < 80 || height < 80) return;
    const p = this.projection(), map = store.at("map", this.vehicle, t);
    c.save();
    c.beginPath();
    c.rect(MARGIN.left, MARGIN.top, width - MARGIN.left - MARGIN.right, height - MARGIN.top - MARGIN.bottom);
    c.clip();
    if (map) this.drawRaster(c, p, map);
    this.drawArea(c, p, facts, theme);
    if (map) this.drawIsobath(c, p, map);
    if (this.shown.graticule && facts.origin_deg) {
      drawGraticule(c, p, { left: MARGIN.left, right: width - MARGIN.right, top: MARGIN.top, bottom: height - MARGIN.bottom }, facts.origin_deg);
    }
    if (this.shown.true_isobath) {
      for (const line of facts.true_isobath) stroke(c, p, line, "#ffffff", 2.5);
      for (const line of facts.true_isobath) stroke(c, p, line, "#000000", 2.5, [6, 5]);
    }
    for (const { number } of facts.vehicles) this.drawTrack(c, p, number, t);
    if (this.shown.samples) this.drawSamples(c, p, t);
    if (this.shown.plans) for (const { number } of facts.vehicles) this.drawPlan(c, p, number, t);
    this.drawPackets(c, p, t);
    for (const { number } of facts.vehicles) this.drawVehicle(c, p, number, t);
    this.measure.draw(c, p, this.probe || this.isKeyed() ? this.describedPosition() : null);
    c.restore();
    this.drawAxes(c, p, width, height, theme);
    this.drawScale(c, p, width, height);
    this.describeProbe(c, p, map, width, height, theme);
  }

  drawRaster(c, p, map) {
    const key = `${this.vehicle} ${map.t} ${this.layer} ${this.shown.band}`;
    if (this.raster.key !== key || this.raster.facts !== this.store.facts) {
      this.raster = { key, facts: this.store.facts, image: this.paint(map) };
    }
    c.imageSmoothingEnabled = map.cell * p.scale < 24;
    const west = map.west - map.cell / 2, north = map.south + (map.rows - 0.5) * map.cell;
    c.drawImage(this.raster.image, p.x(west), p.y(north), map.columns * map.cell * p.scale, map.rows * map.cell * p.scale);
  }

  // Paints the layer's colors cell by cell, with a white tint where the isobath may be.
  paint(map) {
    const { rows, columns, layers } = map, bytes = layers[this.layer], image = new ImageData(columns, rows);
    const { name, colors } = LAYERS.find((l) => l.name === this.layer), level = this.store.facts.level_m;
    const top = name === "std" ? bytes.reduce((top, byte) => (byte === OUTSIDE ? top : Math.max(top, byte)), 1) : 254;
    const depth = this.store.facts.layers.find((l) => l.name === "depth"), std = this.store.facts.layers.find((l) => l.name === "std");
    for (let row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++) {
        const i = row * columns + column, byte = bytes[i], at = 4 * ((rows - 1 - row) * columns + column);
        if (byte === OUTSIDE) continue;
        const color = 3 * Math.min(254, Math.round((byte * 254) / top));
        const off = Math.abs(depth.low + layers.depth[i] * depth.step - level);
        const veil = this.shown.band && off < 1.96 * (layers.std[i] * std.step + 1e-9) ? 0.22 : 0;
        for (let k = 0; k < 3; k++) image.data[at + k] = colors[color + k] * (1 - veil) + 255 * veil;
        image.data[at + 3] = 255;
      }
    }
    const canvas = document.createElement("canvas");
    canvas.width = columns;
    canvas.height = rows;
    canvas.getContext("2d").putImageData(image, 0, 0);
    return canvas;
  }

  drawArea(c, p, facts, theme) {
    for (const hole of facts.holes) {
      trace(c, p, hole, true);
      c.fillStyle = "rgba(128, 128, 128, .55)";
      c.fill();
    }
    for (const line of [facts.area, ...facts.holes]) {
      trace(c, p, line, true);
      c.strokeStyle = theme.soft;
      c.lineWidth = 1;
      c.stroke();
    }
  }

  drawIsobath(c, p, map) {
    if (this.shown.band) {
      for (const line of [...map.shallow_edge, ...map.deep_edge]) stroke(c, p, line, "rgba(255, 255, 255, .75)", 1);
    }
    for (const line of map.guessed) stroke(c, p, line, "rgba(0, 0, 0, .55)", 1.2, [2, 5]);
    for (const [lines, width] of [[map.likely, 1.6], [map.found, 3.2]]) {
      for (const line of lines) stroke(c, p, line, "rgba(0, 0, 0, .7)", width + 2.4);
      for (const line of lines) stroke(c, p, line, "#ffffff", width);
    }
  }

  // Dots of each vehicle in one path, small ones without an edge: long missions have thousands. A dot that others of its
  // vehicle cover is left out.
  drawSamples(c, p, t) {
    const radius = Math.min(2.6, Math.max(1.2, 4 * p.scale)), small = radius < 2;
    const dots = new Map(), taken = new Set(), { width, height } = this.size();
    for (const { t: stamp, source, positions } of this.store.list("samples", this.vehicle)) {
      if (stamp > t) break;
      if (!dots.has(source)) dots.set(source, new Path2D());
      const path = dots.get(source);
      for (let i = 0; i < positions.length; i += 2) {
        const x = p.x(positions[i + 1] * DM), y = p.y(positions[i] * DM), position = ((x >> 1) * 8192 + (y >> 1)) * 32 + source;
        if (x < 0 || y < 0 || x > width || y > height || taken.has(position)) continue;
        taken.add(position);
        if (small) path.rect(x - radius, y - radius, 2 * radius, 2 * radius);
        else {
          path.moveTo(x + radius, y);
          path.arc(x, y, radius, 0, 7);
        }
      }
    }
    c.strokeStyle = "#ffffff";
    c.lineWidth = 0.9;
    for (const [source, path] of dots) {
      c.fillStyle = vehicleColor(source);
      c.fill(path);
      if (!small) c.stroke(path);
    }
    this.dotCount = taken.size;
  }

  drawTrack(c, p, vehicle, t) {
    const now = this.store.pose(vehicle, t), color = vehicleColor(vehicle);
    const line = (list, last) => {
      const pen = new Pen(c);
      c.beginPath();
      for (const position of list) {
        if (position.t > t) break;
        pen.to(p.x(position.east), p.y(position.north));
      }
      if (last) pen.to(p.x(last.east), p.y(last.north));
      pen.end();
    };
    line(this.store.list("pose", vehicle), now);
    strokeWithCasing(c, "rgba(0, 0, 0, .7)", 4, color, 2.2);
    if (sharesColor(vehicle)) {
      c.setLineDash([6, 6]);
      strokeWithCasing(c, "#ffffff", 1, "#ffffff", 1);
      c.setLineDash([]);
    }
    if (!this.shown.truth) return;
    line(this.store.list("truth", vehicle));
    c.setLineDash([1, 5]);
    c.lineCap = "round";
    strokeWithCasing(c, "#000000", 3.4, "#ffffff", 2);
    c.setLineDash([]);
    c.lineCap = "butt";
  }

  // Draws the rest of a plan: its actions as a wide, pale line, their continuation dashed.
  drawPlan(c, p, vehicle, t) {
    const plan = this.store.at("plan", vehicle, t), bound = this.store.at("bound", vehicle, t);
    if (!plan || !plan.line.length) return;
    const color = vehicleColor(vehicle), facts = this.store.facts, per = facts.points_per_leg;
    const gone = Math.max(0, (bound?.step ?? plan.step) - plan.step), legs = (plan.line.length / 2 - 1) / per;
    if (t > plan.t + (legs + 2) * facts.leg_s) return;
    const part = (from, to) => {
      trace(c, p, plan.line.slice(2 * per * Math.max(0, from), 2 * per * Math.min(to, legs) + 2));
    };
    c.lineJoin = "round";
    part(Math.max(gone, plan.own), legs);
    c.setLineDash([7, 5]);
    strokeWithCasing(c, "rgba(0, 0, 0, .45)", 3, rgba(color, 0.95), 1.6);
    c.setLineDash([]);
    this.drawWaypoints(c, p, plan, (Math.max(gone, plan.own) - plan.own) * per, color);
    part(gone, plan.own);
    c.lineCap = "round";
    strokeWithCasing(c, "rgba(0, 0, 0, .35)", 9, rgba(color, 0.55), 7);
    part(gone, plan.own);
    strokeWithCasing(c, "rgba(255, 255, 255, .9)", 1.6, "rgba(255, 255, 255, .9)", 1.6);
    c.lineCap = "butt";
  }

  // Draws the tour's waypoints that are still ahead, from the one nearest to the tour's next point on.
  drawWaypoints(c, p, plan, gonePoints, color) {
    const at = plan.own * this.store.facts.points_per_leg + gonePoints, north = plan.line[2 * at], east = plan.line[2 * at + 1];
    const away = (i) => Math.hypot(plan.waypoints[i] - north, plan.waypoints[i + 1] - east);
    let next = 0;
    if (gonePoints) for (let i = 0; i < plan.waypoints.length; i += 2) if (away(i) < away(next)) next = i;
    for (let i = next; i < plan.waypoints.length; i += 2) {
      c.beginPath();
      c.rect(p.x(plan.waypoints[i + 1] * DM) - 2.5, p.y(plan.waypoints[i] * DM) - 2.5, 5, 5);
      c.fillStyle = color;
      c.fill();
      c.strokeStyle = "#ffffff";
      c.lineWidth = 1;
      c.stroke();
    }
  }

  // Draws packets: rings around the sender while it sends, a line to each receiver, a cross for a missed reception.
  drawPackets(c, p, t) {
    for (const packet of packetsAt(this.store, t, this.store.facts.tdma.slot_s)) {
      const from = this.store.pose(packet.vehicle, t), color = vehicleColor(packet.vehicle);
      if (!from) continue;
      const x = p.x(from.east), y = p.y(from.north);
      if (packet.sending) {
        const phase = (t - packet.t) % 1;
        for (let ring = 0; ring < 3; ring++) {
          c.beginPath();
          c.arc(x, y, 14 + 16 * (ring + phase), 0, 7);
          strokeWithCasing(c, `rgba(0, 0, 0, ${0.5 - 0.15 * ring})`, 4, rgba(color, 1 - 0.28 * (ring + phase)), 2.4);
        }
      }
      for (const { vehicle, state } of packet.receptions) {
        const to = this.store.pose(vehicle, t);
        if (!to) continue;
        const X = p.x(to.east), Y = p.y(to.north), reach = packet.sending ? Math.min(1, (t - packet.t) / this.store.facts.tdma.send_s) : 1;
        c.globalAlpha = packet.fade;
        c.beginPath();
        c.moveTo(x, y);
        c.lineTo(x + (X - x) * reach, y + (Y - y) * reach);
        c.setLineDash(state === "heard" ? [] : [3, 5]);
        strokeWithCasing(c, "rgba(0, 0, 0, .6)", 4, color, state === "heard" ? 2.4 : 1.6);
        c.setLineDash([]);
        if (state === "heard") {
          c.beginPath();
          c.arc(X, Y, 13, 0, 7);
          strokeWithCasing(c, "rgba(0, 0, 0, .6)", 4.5, color, 2.6);
        } else if (state === "lost") {
          cross(c, x + (X - x) * 0.5, y + (Y - y) * 0.5, 7);
        }
        c.globalAlpha = 1;
      }
    }
  }

  drawVehicle(c, p, vehicle, t) {
    const pose = this.store.pose(vehicle, t);
    if (!pose) return;
    const x = p.x(pose.east), y = p.y(pose.north), expected = t > this.store.lastS - 1 ? this.store.expected(vehicle) : null;
    c.save();
    if (expected) c.globalAlpha = 0.45; // where it was when it was last in reach
    c.translate(x, y);
    c.rotate(pose.heading);
    c.beginPath();
    c.moveTo(0, -12);
    c.lineTo(8, 9);
    c.lineTo(0, 5);
    c.lineTo(-8, 9);
    c.closePath();
    c.fillStyle = vehicleColor(vehicle);
    c.strokeStyle = "#ffffff";
    c.lineWidth = 3.5;
    c.lineJoin = "round";
    c.stroke();
    c.strokeStyle = "#000000";
    c.lineWidth = 1.4;
    c.stroke();
    c.fill();
    c.restore();
    const right = c.canvas.clientWidth - MARGIN.right - 3;
    if (!expected) return label(c, String(vehicle), x + 13, y - 11, 13, right);
    const [X, Y] = [p.x(expected[1]), p.y(expected[0])];
    c.beginPath();
    c.arc(X, Y, 9, 0, 7);
    c.setLineDash([4, 3]);
    strokeWithCasing(c, "#ffffff", 5, vehicleColor(vehicle), 2.6);
    c.setLineDash([]);
    label(c, `${vehicle} expected`, X + 13, Y - 11, 13, right);
  }

  // ------------------------------------------------------------------ axes and words

  drawAxes(c, p, width, height, theme) {
    const right = width - MARGIN.right, bottom = height - MARGIN.bottom;
    c.strokeStyle = theme.line;
    c.lineWidth = 1;
    c.strokeRect(MARGIN.left + 0.5, MARGIN.top + 0.5, right - MARGIN.left - 1, bottom - MARGIN.top - 1);
    c.fillStyle = theme.soft;
    c.strokeStyle = theme.soft;
    c.font = "12px system-ui, sans-serif";
    const corner = p.position(MARGIN.left, bottom), far = p.position(right, MARGIN.top);
    const step = tickStep((right - MARGIN.left) / p.scale, (right - MARGIN.left) / 90), digits = tickDigits(step);
    c.textAlign = "center";
    c.textBaseline = "top";
    for (const east of ticks(corner.east, far.east, step)) {
      c.fillRect(p.x(east), bottom, 1, 4);
      if (p.x(east) < right - 12) c.fillText(number(east, digits), p.x(east), bottom + 6);
    }
    c.fillText("east of the origin (m)", (MARGIN.left + right) / 2, bottom + 22);
    c.textAlign = "right";
    c.textBaseline = "middle";
    for (const north of ticks(corner.north, far.north, step)) {
      c.fillRect(MARGIN.left - 4, p.y(north), 4, 1);
      c.fillText(number(north, digits), MARGIN.left - 7, p.y(north));
    }
    c.save();
    c.translate(12, (MARGIN.top + bottom) / 2);
    c.rotate(-Math.PI / 2);
    c.textAlign = "center";
    c.fillText("north of the origin (m)", 0, 0);
    c.restore();
  }

  drawScale(c, p, width, height) {
    const wanted = 110 / p.scale, length = tickStep(wanted, 1) > wanted ? tickStep(wanted / 2, 1) : tickStep(wanted, 1);
    const x = MARGIN.left + 14, y = height - MARGIN.bottom - 16, long = length * p.scale;
    c.beginPath();
    c.moveTo(x, y - 5);
    c.lineTo(x, y);
    c.lineTo(x + long, y);
    c.lineTo(x + long, y - 5);
    strokeWithCasing(c, "rgba(0, 0, 0, .8)", 4.5, "#ffffff", 2);
    label(c, `${length} m`, x + long + 8, y - 3);
  }

  isKeyed() {
    return this.canvas.matches(":focus-visible");
  }

  // Describes the position under the pointer, or the center while the map has keyboard focus.
  describeProbe(c, p, map, width, height, theme) {
    const at = this.probe ?? (this.isKeyed() ? { x: width / 2, y: height / 2 } : null);
    if (!at) {
      this.readout.textContent = "";
      return;
    }
    if (!this.probe) {
      c.strokeStyle = theme.ink;
      c.lineWidth = 1;
      c.strokeRect(at.x - 5, at.y - 5, 10, 10);
    }
    const { north, east } = p.position(at.x, at.y), parts = [`north ${number(north)} m, east ${number(east)} m`];
    if (this.store.facts.origin_deg) parts.push(geodetic(north, east, this.store.facts.origin_deg));
    const row = map ? Math.round((north - map.south) / map.cell) : -1, column = map ? Math.round((east - map.west) / map.cell) : -1;
    if (map && row >= 0 && row < map.rows && column >= 0 && column < map.columns) {
      const of = (layer) => this.store.value(layer, map.layers[layer][row * map.columns + column]);
      if (of("risk") !== null) {
        const level = number(this.store.facts.level_m, 1);
        parts.push(`depth ${number(of("depth"), 1)} ± ${number(of("std"), 1)} m`, `expected loss ${number(of("risk"), 2)}`);
        parts.push(`P(at least ${level} m) ${number(of("p_safe"), 2)}`);
      }
    }
    this.readout.textContent = parts.join(" · ");
  }
}
