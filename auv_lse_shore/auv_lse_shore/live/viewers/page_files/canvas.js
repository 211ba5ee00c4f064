// Helpers for drawing on a canvas: lines, outlined lines, labels.

export const DM = 0.1; // lines come in decimetres
const TOLERANCE_PX = 0.25;

// Prepares a canvas for drawing in CSS pixels at the screen's resolution; returns its context.
export function prepare(canvas, width, height) {
  const ratio = window.devicePixelRatio || 1, wide = Math.round(width * ratio), high = Math.round(height * ratio);
  if (canvas.width !== wide || canvas.height !== high) {
    canvas.width = wide;
    canvas.height = high;
  }
  const c = canvas.getContext("2d");
  c.setTransform(ratio, 0, 0, ratio, 0, 0);
  return c;
}

// Adds a line to a path without the points that move it by less than `TOLERANCE_PX`: stroking costs time for each point.
export class Pen {
  constructor(c) {
    this.c = c;
    this.begun = false;
  }

  to(x, y) {
    if (!this.begun) return this.keep(x, y);
    if (this.waiting && !this.continues(x, y)) this.keep(this.lastX, this.lastY);
    const away = Math.hypot(x - this.x, y - this.y);
    this.waiting = true;
    this.lastX = x;
    this.lastY = y;
    this.far = Math.max(this.far, away);
    if (away <= TOLERANCE_PX) return;
    const direction = Math.atan2(y - this.y, x - this.x), half = Math.asin(TOLERANCE_PX / away);
    if (Number.isNaN(this.ahead)) this.ahead = direction;
    // the directions from the last point kept in which a straight line passes all points since then
    this.low = Math.max(this.low, turn(direction - this.ahead) - half);
    this.high = Math.min(this.high, turn(direction - this.ahead) + half);
  }

  continues(x, y) {
    if (Math.hypot(x - this.x, y - this.y) < this.far - TOLERANCE_PX) return false; // it comes back
    if (Number.isNaN(this.ahead)) return true;
    const angle = turn(Math.atan2(y - this.y, x - this.x) - this.ahead);
    return angle >= this.low && angle <= this.high;
  }

  keep(x, y) {
    this.c.lineTo(x, y);
    this.begun = true;
    this.waiting = false;
    this.x = x;
    this.y = y;
    this.far = 0;
    this.ahead = NaN; // the direction to the first point that is not here
    this.low = -Infinity;
    this.high = Infinity;
  }

  end() {
    if (this.waiting) this.keep(this.lastX, this.lastY);
  }
}

// An angle (rad) between -2 pi and 2 pi as one between -pi and pi.
function turn(angle) {
  return angle > Math.PI ? angle - 2 * Math.PI : angle < -Math.PI ? angle + 2 * Math.PI : angle;
}

export function trace(c, p, line, closed = false) {
  const pen = new Pen(c);
  c.beginPath();
  for (let i = 0; i < line.length; i += 2) pen.to(p.x(line[i + 1] * DM), p.y(line[i] * DM));
  pen.end();
  if (closed) c.closePath();
}

export function stroke(c, p, line, color, width, dash = []) {
  trace(c, p, line);
  c.setLineDash(dash);
  c.strokeStyle = color;
  c.lineWidth = width;
  c.stroke();
  c.setLineDash([]);
}

// Strokes the path twice: a casing, then the line, so that it is visible on any background.
export function strokeWithCasing(c, casing, wide, color, width) {
  c.strokeStyle = casing;
  c.lineWidth = wide;
  c.stroke();
  c.strokeStyle = color;
  c.lineWidth = width;
  c.stroke();
}

export function cross(c, x, y, size) {
  c.beginPath();
  c.moveTo(x - size, y - size);
  c.lineTo(x + size, y + size);
  c.moveTo(x - size, y + size);
  c.lineTo(x + size, y - size);
  strokeWithCasing(c, "#000000", 5.5, "#ffffff", 2.8);
}

// A text on the map from x on, moved to the left where it would pass `right`.
export function label(c, text, x, y, size = 13, right = Infinity) {
  c.font = `bold ${size}px system-ui, sans-serif`;
  x = Math.min(x, right - c.measureText(text).width);
  c.textAlign = "left";
  c.textBaseline = "middle";
  c.strokeStyle = "rgba(0, 0, 0, .85)";
  c.lineWidth = 3.5;
  c.lineJoin = "round";
  c.strokeText(text, x, y);
  c.fillStyle = "#ffffff";
  c.fillText(text, x, y);
}
