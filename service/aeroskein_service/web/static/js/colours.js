// Colours of the canvases in both themes, and the scales that colour traffic by source, altitude, accuracy or age.
//
// The panels' colours are in css/theme.css; those of the canvases are read from there too, so a theme is changed in one
// place. The sources follow Okabe and Ito (2008), whose palette people with colour-blindness can tell apart.

export const SOURCES = ["fused", "adsb", "radar", "coasted", "suspect"];
export const SOURCE_NAMES = {
  fused: "ADS-B and radar", adsb: "ADS-B only", radar: "radar only", coasted: "coasted: predicted, no report lately",
  suspect: "ADS-B contradicted by radar",
};
const CONTRAST = 3.05; // of a symbol with the map: 3 after rounding
const STEPS = 24; // colours of a scale
export const PALETTE_SIZE = 32; // uniforms of the shader
const FILTERED = PALETTE_SIZE - 1;
const UNKNOWN = PALETTE_SIZE - 2;
const EMERGENCY = PALETTE_SIZE - 3;

const NAMES = [
  "sea", "land", "coast", "border", "grid", "ring", "site", "layer", "faint", "text", "halo", "selected", "emergency",
  "fused", "adsb", "radar", "coasted", "suspect", "filtered", "unknown", "trail", "axis", "division", "boundary",
  "rejected", "ellipse", "panel",
];

// The colours of the theme in force, by name, as CSS text.
export function themeColours() {
  const style = getComputedStyle(document.documentElement);
  const made = {};
  for (const name of NAMES) made[name] = style.getPropertyValue(`--map-${name}`).trim();
  made.dark = document.documentElement.dataset.theme === "dark";
  return made;
}

// A colour for a sensor, the same everywhere: ADS-B and its like in blues, radars in greens and ochres.
const SENSOR_DARK = { other: ["#56b4e9", "#9fd6ff", "#7f9cff"], radar: ["#3ddc97", "#ff9f6b", "#c7a6ff", "#8ee0d0", "#f0c808"] };
const SENSOR_LIGHT = { other: ["#0062a8", "#3f51b5", "#006d8f"], radar: ["#00734d", "#a8400f", "#00696b", "#8a5a00", "#6a3fb5"] };

export function sensorColour(sensors, id, dark) {
  const sensor = sensors.find((s) => s.id === id);
  const family = sensor?.radar ? "radar" : "other";
  const place = Math.max(0, sensors.filter((s) => Boolean(s.radar) === Boolean(sensor?.radar)).findIndex((s) => s.id === id));
  const list = (dark ? SENSOR_DARK : SENSOR_LIGHT)[family];
  return list[place % list.length];
}

// "#rgb", "#rrggbb" or "rgb(...)" as three numbers from 0 to 1.
export function rgb(text) {
  if (text.startsWith("#")) {
    const full = text.length === 4 ? [...text.slice(1)].map((c) => c + c).join("") : text.slice(1);
    return [0, 2, 4].map((at) => parseInt(full.slice(at, at + 2), 16) / 255);
  }
  return (text.match(/[\d.]+/g) ?? ["128", "128", "128"]).slice(0, 3).map((v) => Number(v) / 255);
}

function hsl(h, s, l) {
  const f = (n) => {
    const k = (n + h / 30) % 12;
    return l - s * Math.min(l, 1 - l) * Math.max(-1, Math.min(k - 3, 9 - k, 1));
  };
  return [f(0), f(8), f(4)];
}

// The contrast of two colours, WCAG 2.2.
export function contrast(one, other) {
  const light = (colour) => colour.map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)).reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0);
  const [low, high] = [light(one), light(other)].sort((a, b) => a - b);
  return (high + 0.05) / (low + 0.05);
}

// A colour made lighter or darker until it stands out from every ground as symbols and lines must.
function legible(colour, ground, dark) {
  let made = colour;
  for (let k = 0; k < 40 && ground.some((g) => contrast(made, g) < CONTRAST); k++) made = made.map((v) => (dark ? v + 0.04 * (1 - v) : 0.96 * v));
  return made;
}

const css = ([r, g, b]) => `rgb(${Math.round(r * 255)} ${Math.round(g * 255)} ${Math.round(b * 255)})`;

// What each way of colouring looks like: `colour(k)` for 0 <= k <= 1, its ticks, and the value of an aircraft.
const SCALES = {
  altitude: {
    title: "Altitude", unit: "FL",
    ticks: [[0, "0"], [100, "100"], [200, "200"], [300, "300"], [400, "400"]],
    share: (v) => v / 430,
    value: (frame, i) => frame.altitude(i) / 30.48,
    colour: (k, dark) => hsl(20 + 280 * k, dark ? 0.85 : 0.9, dark ? 0.62 : 0.36),
  },
  accuracy: {
    title: "One sigma of position", unit: "m",
    ticks: [[1, "1"], [10, "10"], [100, "100"], [1000, "1000"]],
    share: (v) => Math.log10(Math.max(v, 1)) / 3,
    value: (frame, i) => frame.sigma(i),
    colour: (k, dark) => hsl(150 - 150 * k, dark ? 0.8 : 0.95, dark ? 0.58 : 0.32),
  },
  age: {
    title: "Since the newest report", unit: "s",
    ticks: [[0, "0"], [5, "5"], [10, "10"], [20, "20"], [30, "30"]],
    share: (v) => v / 30,
    value: (frame, i) => frame.heard(i),
    colour: (k, dark) => hsl(200 - 190 * k, dark ? 0.85 : 0.9, dark ? 0.6 : 0.34),
  },
};

export class TrafficColours {
  constructor() {
    this.palette = new Float32Array(PALETTE_SIZE * 3);
    this.texts = [];
  }

  // Make the palette for a way of colouring and a theme.
  choose(mode, theme) {
    this._mode = mode;
    const scale = SCALES[mode];
    const ground = [rgb(theme.land), rgb(theme.sea)];
    const colours = scale
      ? Array.from({ length: STEPS }, (_, k) => legible(scale.colour(k / (STEPS - 1), theme.dark), ground, theme.dark))
      : SOURCES.map((name) => rgb(theme[name]));
    colours[EMERGENCY] = rgb(theme.emergency);
    colours[UNKNOWN] = rgb(theme.unknown);
    colours[FILTERED] = rgb(theme.filtered);
    this.texts = [];
    for (let k = 0; k < PALETTE_SIZE; k++) {
      const colour = colours[k] ?? [0.5, 0.5, 0.5];
      this.palette.set(colour, k * 3);
      this.texts.push(css(colour));
    }
  }

  // The place in the palette of one aircraft; `source` is its index in SOURCES.
  index(frame, i, source, passes) {
    if (frame.emergency(i)) return EMERGENCY;
    if (!passes) return FILTERED;
    const scale = SCALES[this._mode];
    if (!scale) return source;
    const value = scale.value(frame, i);
    if (!Number.isFinite(value)) return UNKNOWN;
    return Math.round(Math.max(0, Math.min(1, scale.share(value))) * (STEPS - 1));
  }

  // For the legend: names with colours, or ticks along a scale.
  legend() {
    const scale = SCALES[this._mode];
    if (!scale) return { title: "Source", items: SOURCES.map((name, k) => ({ name, text: SOURCE_NAMES[name], colour: this.texts[k] })) };
    return {
      title: `${scale.title} [${scale.unit}]`,
      colours: this.texts.slice(0, STEPS),
      ticks: scale.ticks.map(([v, text]) => ({ at: scale.share(v), text })),
    };
  }
}
