// The measuring tool: distances and bearings between positions that the user chooses on the map.

import { label, strokeWithCasing } from "./canvas.js";
import { number } from "./format.js";

export class Measure {
  constructor(output, button) {
    [this.output, this.button] = [output, button];
    this.stop();
  }

  start() {
    this.points = [];
    this.active = true;
    this.describe();
  }

  stop() {
    this.points = [];
    this.active = false;
    this.describe();
  }

  add(position) {
    this.points.push(position);
    this.describe();
  }

  describe() {
    const { points } = this, legs = points.slice(1).map((to, i) => leg(points[i], to)), last = legs[legs.length - 1];
    const total = legs.length > 1 ? `, ${number(legs.reduce((sum, { m }) => sum + m, 0))} m in all` : "";
    const hint = points.length ? "next position" : "first position";
    this.output.textContent = this.active ? `${last ? `${words(last)}${total}. ` : ""}Click the ${hint} (keys: Enter); Escape ends.` : "";
    this.button.setAttribute("aria-pressed", String(this.active));
  }

  // Draws the legs, and the one to the position under the pointer.
  draw(c, p, position) {
    if (!this.active) return;
    const all = position ? [...this.points, position] : this.points, at = ({ north, east }) => [p.x(east), p.y(north)];
    if (!this.points.length) return;
    c.beginPath();
    for (const point of all) c.lineTo(...at(point));
    c.setLineDash([8, 4]);
    strokeWithCasing(c, "#000000", 4, "#ffffff", 2);
    c.setLineDash([]);
    for (const point of this.points) {
      c.beginPath();
      c.arc(...at(point), 4, 0, 7);
      strokeWithCasing(c, "#000000", 4, "#ffffff", 2);
    }
    for (let i = 1; i < all.length; i++) {
      const [x, y] = at(all[i - 1]), [X, Y] = at(all[i]);
      if (Math.hypot(X - x, Y - y) > 24) label(c, words(leg(all[i - 1], all[i])), (x + X) / 2 + 8, (y + Y) / 2);
    }
  }
}

// Distance (m) and bearing (deg, clockwise from north, 0 to 359) from one position to another.
export function leg(from, to) {
  const north = to.north - from.north, east = to.east - from.east;
  return { m: Math.hypot(north, east), deg: Math.round((Math.atan2(east, north) * 180) / Math.PI + 360) % 360 };
}

function words({ m, deg }) {
  return `${number(m, m < 10 ? 1 : 0)} m, ${String(deg).padStart(3, "0")}°`;
}
