// Numbers, times and texts for the page.

export function clock(seconds) {
  const whole = Math.max(0, Math.floor(seconds + 1e-6));
  const two = (n) => String(n).padStart(2, "0");
  const hours = Math.floor(whole / 3600), minutes = Math.floor(whole / 60) % 60;
  return hours ? `${hours}:${two(minutes)}:${two(whole % 60)}` : `${minutes}:${two(whole % 60)}`;
}

// A number with as many digits after the point as asked for; a dash for unknown, a true minus sign, no "−0".
export function number(value, digits = 0) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const text = value.toFixed(digits);
  return Number(text) < 0 ? text.replace("-", "−") : text.replace("-", "");
}

// Distance between ticks, 1, 2 or 5 times a power of ten, so that about `count` of them fill a span.
export function tickStep(span, count) {
  const raw = Math.max(span, 1e-9) / Math.max(count, 1), power = 10 ** Math.floor(Math.log10(raw));
  const factor = [1, 2, 5, 10].find((f) => f * power >= raw * 0.999);
  return factor * power;
}

export function ticks(low, high, step) {
  const found = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) found.push(i * step);
  return found;
}

// Digits after the point needed to distinguish ticks.
export function tickDigits(step) {
  return Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
}

// Makes an element: tag, attributes, children (elements or texts).
export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...children);
  return made;
}

// Sets a text only if it differs, so that a screen reader does not repeat it.
export function setText(target, text) {
  if (target.textContent !== text) target.textContent = text;
}

// WGS84 latitude and longitude (deg) of a position (m north and east of the origin, a pair in deg). Terms of third order
// in the distance are left out: within 10 km the error is below 0.2 m at latitudes up to 65 deg.
export function toGeodetic(north, east, [lat0, lon0]) {
  const a = 6378137, e2 = 0.00669437999014, radian = Math.PI / 180, phi = lat0 * radian;
  const w2 = 1 - e2 * Math.sin(phi) ** 2, normal = a / Math.sqrt(w2), meridian = (a * (1 - e2)) / w2 ** 1.5;
  const lat = lat0 + (north / meridian - (east * east * Math.tan(phi)) / (2 * meridian * normal)) / radian;
  const lon = lon0 + ((east / (normal * Math.cos(phi))) * (1 + (north * Math.tan(phi)) / normal)) / radian;
  return [lat, lon];
}

// The inverse of `toGeodetic`, to 1 mm, by correcting a flat guess.
export function fromGeodetic(lat, lon, origin) {
  const metre = 180 / (Math.PI * 6378137), shrink = Math.cos((origin[0] * Math.PI) / 180), position = { north: 0, east: 0 };
  for (let i = 0; i < 6; i++) {
    const [ownLat, ownLon] = toGeodetic(position.north, position.east, origin);
    position.north += (lat - ownLat) / metre;
    position.east += ((lon - ownLon) * shrink) / metre;
  }
  return position;
}

// `toGeodetic` as a text.
export function geodetic(north, east, origin) {
  const [lat, lon] = toGeodetic(north, east, origin);
  const side = (value, signs) => `${Math.abs(value).toFixed(6)}° ${value < 0 ? signs[1] : signs[0]}`;
  return `${side(lat, "NS")}, ${side(lon, "EW")}`;
}
