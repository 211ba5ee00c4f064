// Lines of equal latitude and longitude on the map.

import { label } from "./canvas.js";
import { fromGeodetic, tickDigits, ticks, tickStep, toGeodetic } from "./format.js";

const SPACING_PX = 150, POINTS = 5;

// Draws the lines in a frame (canvas pixels), with labels at its upper and left edge.
export function drawGraticule(c, p, { left, right, top, bottom }, origin) {
  const corners = [[left, top], [right, top], [left, bottom], [right, bottom]].map(([x, y]) => {
    const { north, east } = p.position(x, y);
    return toGeodetic(north, east, origin);
  });
  const range = (i) => [Math.min(...corners.map((q) => q[i])), Math.max(...corners.map((q) => q[i]))];
  const [south, north] = range(0), [west, east] = range(1);
  const lines = (low, high, span) => {
    const step = tickStep(high - low, Math.max(1, span / SPACING_PX)), digits = tickDigits(step);
    return ticks(low, high, step).map((value) => ({ value, digits }));
  };
  const along = (low, high, point) => {
    c.beginPath();
    for (let i = 0; i < POINTS; i++) {
      const position = fromGeodetic(...point(low + ((high - low) * i) / (POINTS - 1)), origin);
      c.lineTo(p.x(position.east), p.y(position.north));
    }
    c.strokeStyle = "rgba(0, 0, 0, .3)";
    c.lineWidth = 2;
    c.stroke();
    c.strokeStyle = "rgba(255, 255, 255, .6)";
    c.lineWidth = 0.8;
    c.stroke();
  };
  const words = (value, digits, signs) => `${Math.abs(value).toFixed(digits)}° ${value < 0 ? signs[1] : signs[0]}`;
  const middle = (low, high) => (low + high) / 2;
  for (const { value, digits } of lines(west, east, right - left)) {
    along(south, north, (latitude) => [latitude, value]);
    const x = p.x(fromGeodetic(middle(south, north), value, origin).east);
    if (x > left && x < right) label(c, words(value, digits, "EW"), x < right - 90 ? x + 4 : x - 80, top + 10, 11);
  }
  for (const { value, digits } of lines(south, north, bottom - top)) {
    along(west, east, (longitude) => [value, longitude]);
    const y = p.y(fromGeodetic(value, middle(west, east), origin).north);
    if (y > top + 30 && y < bottom - 40) label(c, words(value, digits, "NS"), left + 4, y - 8, 11);
  }
}
