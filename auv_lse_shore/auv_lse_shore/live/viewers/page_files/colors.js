// Colors of vehicles (Okabe and Ito, distinguishable with color blindness), map layers and theme.

const VEHICLES = ["#D55E00", "#56B4E9", "#009E73", "#CC79A7", "#E69F00", "#0072B2", "#F0E442", "#8C8C8C"];

export function vehicleColor(number) {
  return VEHICLES[(number - 1) % VEHICLES.length];
}

// Whether a vehicle shares its color with another one; its track then gets a dashed core.
export function sharesColor(number) {
  return number > VEHICLES.length;
}

// Seventeen equally spaced stops of Matplotlib's maps, each 6 hexadecimal digits.
const STOPS = {
  cividis: "00224e002e6a1a386f32436d434e6c535a6d61656f6f70737d7c788c88789b9476aba072bcae6ccdbb63dec958f0d846fee838",
  viridis_r: "fde725d5e21aaadc3281d34d5cc8633dbc7427ad811f9f8821908d26818e2c718e33628d3b518b423f85472c7a481769440154",
  PuOr: "7f3b08a04d07be630adb7d12ef9e3cfdbd6efed7a2fbe9cff6f6f7e3e4efcecde4b6b0d4988dbe7967a65d379044176f2d004b",
};

function table(name) {
  const colors = new Uint8Array(255 * 3);
  const stop = (i, c) => parseInt(STOPS[name].slice(6 * i + 2 * c, 6 * i + 2 * c + 2), 16);
  for (let byte = 0; byte < 255; byte++) {
    const at = (byte / 254) * 16, low = Math.min(15, Math.floor(at)), part = at - low;
    for (let c = 0; c < 3; c++) colors[3 * byte + c] = Math.round(stop(low, c) * (1 - part) + stop(low + 1, c) * part);
  }
  return colors;
}

const CIVIDIS = table("cividis"), VIRIDIS_R = table("viridis_r"), PUOR = table("PuOr");

// The map layers: name, key, title and color table. Their labels come with the mission's facts.
export const LAYERS = [
  { name: "risk", key: "r", title: "Expected cost of calling a location deep enough or not", colors: CIVIDIS },
  { name: "p_safe", key: "p", title: "Probability that it is at least as deep as the isobath",
    colors: PUOR },
  { name: "depth", key: "d", title: "Estimated depth of water (m)", colors: VIRIDIS_R },
  { name: "std", key: "s", title: "Standard deviation of the depth (m)", colors: CIVIDIS },
];

// The current theme's colors.
export function themeColors() {
  const style = getComputedStyle(document.documentElement);
  const of = (name) => style.getPropertyValue(name).trim();
  return { ink: of("--ink"), soft: of("--soft"), paper: of("--paper"), line: of("--line"), card: of("--card"),
    grid: of("--grid"), accent: of("--accent"), bad: of("--bad") };
}

export function rgba(hex, alpha) {
  const part = (i) => parseInt(hex.slice(i, i + 2), 16);
  return `rgba(${part(1)}, ${part(3)}, ${part(5)}, ${alpha})`;
}
