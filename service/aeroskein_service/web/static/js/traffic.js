// The aircraft of the newest frame as the layers draw them: places in Mercator units, velocity, source, colour, filter.
//
// Worked out once per frame, for all at once, into typed arrays; drawing then only moves them on.

import { FLAG, Frame } from "./frame.js";
import { SOURCES } from "./colours.js";
import { mercatorX, mercatorY, unitsPerMetre } from "./projection.js";

// One aircraft in the buffer for the graphics card: place, velocity, age (20 bytes), four octets, track angle.
export const STRIDE = 28;
const WORDS = STRIDE / 4;
const SHAPE = 20, COLOUR = 21, PASSES = 22, LARGE = 23;
const RAD = Math.PI / 180;
const FUSED = 0, ADSB = 1, RADAR = 2, COASTED = 3, SUSPECT = 4;
const TENTATIVE = 0, COASTING = 2, TERMINATED = 3;
const SHAPE_SMALL = 8; // added to the shape of a tentative track
const AHEAD_MAX = 15; // s an aircraft is moved on at most

export class Traffic {
  constructor(settings, colours) {
    this._settings = settings;
    this._colours = colours;
    this.frame = Frame.empty();
    this.reference = { x: 0.5, y: 0.5 };
    this.arrivedAt = 0; // performance.now() when the frame came, ms
    this.radarBits = 0;
    this.passed = 0; // aircraft that pass the filters
    this.fastest = 0; // Mercator units per second
    this.emergencies = []; // rows
    this._grow(1024);
  }

  get count() {
    return this.frame.count;
  }

  setSensors(sensors) {
    this.radarBits = sensors.reduce((bits, sensor, k) => bits | (sensor.radar ? 1 << k : 0), 0);
  }

  _grow(n) {
    this.x = new Float64Array(n);
    this.y = new Float64Array(n);
    this.vx = new Float64Array(n); // Mercator units per second
    this.vy = new Float64Array(n);
    this.age = new Float32Array(n); // s
    this.sx = new Float32Array(n); // where it was drawn last, pixels: see `project`
    this.sy = new Float32Array(n);
    this.source = new Uint8Array(n);
    this.colour = new Uint8Array(n);
    this.passes = new Uint8Array(n);
    this.bytes = new ArrayBuffer(n * STRIDE);
    this._floats = new Float32Array(this.bytes);
    this._words = new Uint32Array(this.bytes);
    this._octets = new Uint8Array(this.bytes);
  }

  // Take a new frame over: all of it that no filter and no view changes.
  take(frame, now) {
    this.frame = frame;
    this.arrivedAt = now;
    if (frame.count > this.x.length) this._grow(2 ** Math.ceil(Math.log2(frame.count)));
    const { x, y, vx, vy, age, source, _floats: floats, _octets: octets } = this;
    let fastest = 0;
    this.emergencies = [];
    for (let i = 0, at = 0; i < frame.count; i++, at += WORDS) {
      const lat = frame.lat(i), v = frame.speed(i), angle = frame.angle(i) * RAD, status = frame.status(i);
      x[i] = mercatorX(frame.lon(i));
      y[i] = mercatorY(lat);
      const k = v > 0 ? v * unitsPerMetre(lat) : 0;
      if (k > fastest) fastest = k;
      vx[i] = k * Math.sin(angle);
      vy[i] = -k * Math.cos(angle);
      age[i] = frame.age(i);
      source[i] = sourceOf(frame, i, this.radarBits);
      const emergency = frame.emergency(i);
      if (emergency) this.emergencies.push(i);
      floats[at + 2] = vx[i];
      floats[at + 3] = vy[i];
      floats[at + 4] = age[i];
      floats[at + 6] = angle;
      octets[at * 4 + SHAPE] = source[i] + (status === TENTATIVE || status === TERMINATED ? SHAPE_SMALL : 0);
      octets[at * 4 + LARGE] = emergency ? 1 : 0;
    }
    this.fastest = fastest;
  }

  // Colours and filters, when the frame or a setting has changed.
  style(filter) {
    const { frame, source, colour, passes, _octets: octets, _colours: colours } = this;
    this.passed = 0;
    for (let i = 0, byte = 0; i < frame.count; i++, byte += STRIDE) {
      const pass = filter(frame, i, source[i]);
      if (pass) this.passed += 1;
      octets[byte + PASSES] = passes[i] = pass ? 1 : 0;
      octets[byte + COLOUR] = colour[i] = colours.index(frame, i, source[i], pass);
    }
  }

  // The buffer for the graphics card, relative to a place near the map's centre, where single precision is enough.
  pack(reference) {
    this.reference = reference;
    const { x, y, _floats: floats } = this, n = this.frame.count;
    for (let i = 0, at = 0; i < n; i++, at += WORDS) {
      const dx = x[i] - reference.x;
      floats[at] = dx - Math.round(dx);
      floats[at + 1] = y[i] - reference.y;
    }
    return new Uint8Array(this.bytes, 0, n * STRIDE);
  }

  // Two vertices for the speed vector of each aircraft that passes, as `pack` has left it; in the second one `LARGE` is 1.
  packVectors() {
    const { passes, vx, vy, _words: words } = this, n = this.frame.count;
    const made = new Uint32Array(2 * n * WORDS), octets = new Uint8Array(made.buffer);
    let to = 0;
    for (let i = 0; i < n; i++) {
      if (!passes[i] || (vx[i] === 0 && vy[i] === 0)) continue;
      for (let end = 0; end < 2; end++, to += WORDS) {
        for (let k = 0, at = i * WORDS; k < WORDS; k++) made[to + k] = words[at + k];
        octets[to * 4 + LARGE] = end;
      }
    }
    return made.subarray(0, to);
  }

  // Seconds that have passed in the picture since the frame was made.
  moved(now) {
    if (!this._settings.smooth || !this.frame.playing) return 0;
    return Math.max(0, Math.min(((now - this.arrivedAt) / 1000) * this.frame.pace, 5 * this.frame.pace));
  }

  // Where an aircraft is drawn now, in Mercator units.
  at(i, moved) {
    const t = Math.max(-1, Math.min(AHEAD_MAX, moved + this.age[i]));
    return [this.x[i] + this.vx[i] * t, this.y[i] + this.vy[i] * t];
  }

  // All of them in pixels, into `sx` and `sy`.
  project(view, moved) {
    const { x, y, vx, vy, age, sx, sy } = this, n = this.frame.count;
    const { cx, cy, scale } = view, middle = view.width / 2, half = view.height / 2;
    for (let i = 0; i < n; i++) {
      const t = Math.max(-1, Math.min(AHEAD_MAX, moved + age[i]));
      const dx = x[i] + vx[i] * t - cx;
      sx[i] = (dx - Math.round(dx)) * scale + middle;
      sy[i] = (y[i] + vy[i] * t - cy) * scale + half;
    }
  }

  // The aircraft nearest to a point of the screen as it was drawn last, -1 where none is near.
  nearest(px, py, within) {
    const { sx, sy } = this;
    let best = -1, least = within * within;
    for (let i = 0; i < this.frame.count; i++) {
      const dx = sx[i] - px, dy = sy[i] - py, d = dx * dx + dy * dy;
      if (d < least) {
        least = d;
        best = i;
      }
    }
    return best;
  }

  // Pixels per second of the fastest aircraft in view.
  fastestInView(view) {
    const { vx, vy, sx, sy } = this, { width, height } = view;
    let most = 0;
    for (let i = 0; i < this.frame.count; i++) {
      if (!(sx[i] > 0 && sy[i] > 0 && sx[i] < width && sy[i] < height)) continue;
      const v = vx[i] * vx[i] + vy[i] * vy[i];
      if (v > most) most = v;
    }
    return Math.sqrt(most) * view.scale;
  }

  // The box of all aircraft, null where there is none: lat_min, lon_min, lat_max, lon_max.
  extent() {
    const frame = this.frame;
    if (frame.count === 0) return null;
    const box = [90, 180, -90, -180];
    for (let i = 0; i < frame.count; i++) {
      box[0] = Math.min(box[0], frame.lat(i)); box[1] = Math.min(box[1], frame.lon(i));
      box[2] = Math.max(box[2], frame.lat(i)); box[3] = Math.max(box[3], frame.lon(i));
    }
    return box;
  }
}

// Which symbol and colour a track has: what it rests on lately.
export function sourceOf(frame, i, radarBits) {
  const flags = frame.flags(i), status = frame.status(i), sensors = frame.sensors(i);
  if (flags & FLAG.adsb_suspect) return SUSPECT;
  if (status === COASTING || flags & FLAG.coasted || sensors === 0) return COASTED;
  const radar = (sensors & radarBits) !== 0, other = (sensors & ~radarBits) !== 0;
  return radar && other ? FUSED : radar ? RADAR : ADSB;
}

export function sourceName(index) {
  return SOURCES[index];
}
