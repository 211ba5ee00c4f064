// Helpers for drawing on a canvas: lines, outlined lines, labels.

export const DM = 0.1; // lines come in decimetres

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

export function trace(c, p, line, closed = false) {
  c.beginPath();
  for (let i = 0; i < line.length; i += 2) c.lineTo(p.x(line[i + 1] * DM), p.y(line[i] * DM));
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

export function label(c, text, x, y, size = 13) {
  c.font = `bold ${size}px system-ui, sans-serif`;
  c.textAlign = "left";
  c.textBaseline = "middle";
  c.strokeStyle = "rgba(0, 0, 0, .85)";
  c.lineWidth = 3.5;
  c.lineJoin = "round";
  c.strokeText(text, x, y);
  c.fillStyle = "#ffffff";
  c.fillText(text, x, y);
}
