// Where aircraft have been: the fused points of their elements, fetched from the server and drawn as lines to the symbol.

import { ask } from "./asking.js";
import { PLACE, bindAttributes, makeProgram, setPlace } from "./gl.js";
import { mercatorX, mercatorY, wrapped } from "./projection.js";

const EVERY_MS = 4000; // elements are some four seconds long
const MOST = 100; // selected tracks that have one
const VERTEX = `
${PLACE}
layout(location=0) in vec2 at; layout(location=1) in float fade;
uniform vec3 colour;
out vec4 tint;
void main() {
  gl_Position = vec4(place(at), 0.0, 1.0);
  tint = vec4(colour, 1.0) * fade;
}`;
const FRAGMENT = `
in vec4 tint; out vec4 paint;
void main() { paint = tint; }`;

export class Trails {
  constructor(gl) {
    this._gl = gl;
    this._program = gl ? makeProgram(gl, VERTEX, FRAGMENT) : null;
    this._buffers = gl ? [gl.createBuffer(), gl.createBuffer()] : [];
    this._reference = null;
    this._rows = []; // of the aircraft whose trails are drawn
    this._flown = this._legs = 0; // vertices
    this._fetchedAt = -Infinity;
    this._busy = false;
    this.trails = new Map(); // by track number: Mercator x and y, oldest first
  }

  // Fetch again when it is time: the trails of the tracks of some `numbers`, or of all in a box where that is null.
  async refresh(now, numbers, box, seconds, at, done) {
    if (numbers?.size === 0) {
      this.trails = new Map();
      this._fetchedAt = -Infinity;
      return;
    }
    if (this._busy || now - this._fetchedAt < EVERY_MS) return;
    this._busy = true;
    this._fetchedAt = now;
    try {
      const query = new URLSearchParams({ seconds: String(seconds) });
      if (numbers) query.set("tracks", [...numbers].slice(0, MOST).join(","));
      else if (box) query.set("box", box.map((v) => v.toFixed(5)).join(","));
      if (at) query.set("at", String(at));
      const response = await ask(`/api/trails?${query}`);
      if (response.ok) {
        this.trails = readTrails(await response.arrayBuffer());
        done();
      }
    } catch {
      // The connection's own banner says so.
    } finally {
      this._busy = false;
    }
  }

  hurry() {
    this._fetchedAt = -Infinity;
  }

  // Lines along each trail and on to where its aircraft is drawn now; `numbers` limits them, null means all.
  upload(traffic, numbers, moved) {
    if (!this._gl) return;
    const reference = traffic.reference, key = numbers ? [...numbers].join() : "all";
    // What has been flown changes with the frame, the way to the aircraft with every drawing.
    if (this._reference !== reference || this._from !== this.trails || this._key !== key) {
      Object.assign(this, { _reference: reference, _from: this.trails, _key: key });
      this._rows = [];
      const lines = [];
      for (let i = 0; i < traffic.count; i++) {
        const number = traffic.frame.number(i), trail = numbers && !numbers.has(number) ? undefined : this.trails.get(number);
        if (!trail) continue;
        this._rows.push(i);
        const { x, y } = trail, n = x.length;
        for (let k = 1; k < n; k++) this._line(lines, x[k - 1], y[k - 1], x[k], y[k], fade(k - 1, n), fade(k, n));
      }
      this._flown = this._send(this._buffers[0], lines);
    }
    const legs = [];
    for (const i of this._rows) {
      const { x, y } = this.trails.get(traffic.frame.number(i)), n = x.length;
      this._line(legs, x[n - 1], y[n - 1], ...traffic.at(i, moved), fade(n - 1, n), fade(n, n));
    }
    this._legs = this._send(this._buffers[1], legs);
  }

  // Two vertices, unless the line would run round the world.
  _line(lines, x1, y1, x2, y2, fade1, fade2) {
    const { x, y } = this._reference, begin = wrapped(x1 - x), end = wrapped(x2 - x);
    if (Math.abs(end - begin) < 0.5) lines.push(begin, y1 - y, fade1, end, y2 - y, fade2);
  }

  // Fills a buffer; how many vertices it has.
  _send(buffer, lines) {
    const gl = this._gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(lines), gl.DYNAMIC_DRAW);
    return lines.length / 3;
  }

  draw(view, colour) {
    if (!this._flown && !this._legs) return;
    const gl = this._gl, { program, uniforms } = this._program;
    gl.useProgram(program);
    setPlace(gl, uniforms, view, this._reference, 0);
    gl.uniform3fv(uniforms.colour, colour);
    for (const [buffer, count] of [[this._buffers[0], this._flown], [this._buffers[1], this._legs]]) {
      bindAttributes(gl, buffer, 12, [[0, 2, gl.FLOAT, false, 0], [1, 1, gl.FLOAT, false, 8]]);
      gl.drawArrays(gl.LINES, 0, count);
    }
  }
}

// A trail grows fainter towards its beginning.
function fade(k, n) {
  return 0.25 + (0.5 * k) / n;
}

// The answer of /api/trails: see `trails.py`.
export function readTrails(buffer) {
  const head = new DataView(buffer);
  const made = new Map();
  if (head.getUint32(0, true) !== 1) return made;
  const count = head.getUint32(4, true);
  let at = 8 + count * 8;
  for (let k = 0; k < count; k++) {
    const number = head.getUint32(8 + k * 8, true), n = head.getUint32(12 + k * 8, true);
    const x = new Float64Array(n), y = new Float64Array(n);
    for (let i = 0; i < n; i++, at += 8) {
      y[i] = mercatorY(head.getInt32(at, true) * 1e-7);
      x[i] = mercatorX(head.getInt32(at + 4, true) * 1e-7);
    }
    made.set(number, { x, y });
  }
  return made;
}
