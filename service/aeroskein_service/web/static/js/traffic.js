// The aircraft of the newest frame as the layers draw them: places in Mercator units, velocity, source, colour, filter.
//
// Worked out once per frame, for all at once, into typed arrays; drawing then only moves them on.

import { FLAG, Frame } from "./frame.js";
import { SOURCES } from "./colours.js";
import { mercatorX, mercatorY, unitsPerMetre, wrapped } from "./projection.js";

export const STRIDE = 28; // bytes of one aircraft in the buffer for the graphics card
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
    this.source = new Uint8Array(n);
    this.colour = new Uint8Array(n);
    this.passes = new Uint8Array(n);
    this.bytes = new ArrayBuffer(n * STRIDE);
    this._floats = new Float32Array(this.bytes);
    this._octets = new Uint8Array(this.bytes);
  }

  // Take a new frame over.
  take(frame, now) {
    this.frame = frame;
    this.arrivedAt = now;
    if (frame.count > this.x.length) this._grow(2 ** Math.ceil(Math.log2(frame.count)));
    for (let i = 0; i < frame.count; i++) {
      const lat = frame.lat(i), v = frame.speed(i);
      this.x[i] = mercatorX(frame.lon(i));
      this.y[i] = mercatorY(lat);
      if (v > 0) {
        const k = v * unitsPerMetre(lat), a = frame.angle(i) * RAD;
        this.vx[i] = k * Math.sin(a);
        this.vy[i] = -k * Math.cos(a);
      } else {
        this.vx[i] = this.vy[i] = 0;
      }
      this.source[i] = sourceOf(frame, i, this.radarBits);
    }
  }

  // Colours and filters, when the frame or a setting has changed.
  style(filter) {
    const frame = this.frame;
    this.passed = 0;
    for (let i = 0; i < frame.count; i++) {
      const passes = filter(frame, i, this.source[i]);
      this.passes[i] = passes ? 1 : 0;
      if (passes) this.passed += 1;
      this.colour[i] = this._colours.index(frame, i, this.source[i], passes);
    }
  }

  // The buffer for the graphics card, relative to a place near the map's centre, where single precision is enough.
  pack(reference) {
    this.reference = reference;
    const frame = this.frame, floats = this._floats, octets = this._octets;
    for (let i = 0; i < frame.count; i++) {
      const at = i * (STRIDE / 4), byte = i * STRIDE + 20;
      floats[at] = wrapped(this.x[i] - reference.x);
      floats[at + 1] = this.y[i] - reference.y;
      floats[at + 2] = this.vx[i];
      floats[at + 3] = this.vy[i];
      floats[at + 4] = frame.age(i);
      const status = frame.status(i);
      octets[byte] = this.source[i] + (status === TENTATIVE || status === TERMINATED ? SHAPE_SMALL : 0);
      octets[byte + 1] = this.colour[i];
      octets[byte + 2] = this.passes[i];
      octets[byte + 3] = frame.emergency(i) ? 1 : 0;
      floats[at + 6] = frame.angle(i) * RAD;
    }
    return new Uint8Array(this.bytes, 0, frame.count * STRIDE);
  }

  // Seconds that have passed in the picture since the frame was made.
  moved(now) {
    if (!this._settings.smooth || !this.frame.playing) return 0;
    return Math.max(0, Math.min(((now - this.arrivedAt) / 1000) * this.frame.pace, 5 * this.frame.pace));
  }

  // Where an aircraft is drawn now, in Mercator units.
  at(i, moved) {
    const t = Math.max(-1, Math.min(AHEAD_MAX, moved + this.frame.age(i)));
    return [this.x[i] + this.vx[i] * t, this.y[i] + this.vy[i] * t];
  }

  // The same in pixels, written into `to`: for loops over all aircraft, which must not make objects.
  screen(view, i, moved, to) {
    const t = Math.max(-1, Math.min(AHEAD_MAX, moved + this.frame.age(i)));
    const dx = this.x[i] + this.vx[i] * t - view.cx;
    to.x = (dx - Math.round(dx)) * view.scale + view.width / 2;
    to.y = (this.y[i] + this.vy[i] * t - view.cy) * view.scale + view.height / 2;
  }

  // The aircraft nearest to a point of the screen, -1 where none is near.
  nearest(view, px, py, within, moved) {
    let best = -1, least = within * within;
    const at = { x: 0, y: 0 };
    for (let i = 0; i < this.frame.count; i++) {
      this.screen(view, i, moved, at);
      const dx = at.x - px, dy = at.y - py;
      const d = dx * dx + dy * dy;
      if (d < least) {
        least = d;
        best = i;
      }
    }
    return best;
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
