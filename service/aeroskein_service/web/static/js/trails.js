// Where aircraft have been: the fused points of their elements, fetched from the server and drawn as lines to the symbol.

import { PLACE, bindAttributes, makeProgram, setPlace } from "./gl.js";
import { mercatorX, mercatorY, wrapped } from "./projection.js";

const EVERY_MS = 4000; // elements are some four seconds long
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
    this._buffer = gl ? gl.createBuffer() : null;
    this._vertices = 0;
    this._reference = { x: 0.5, y: 0.5 };
    this._fetchedAt = -Infinity;
    this._busy = false;
    this.trails = new Map(); // by track number: Mercator x and y, oldest first
  }

  // Fetch again when it is time; `which` is "none", "selected" or "all".
  async refresh(now, which, box, seconds, at, done) {
    if (which === "none") {
      this.trails = new Map();
      this._fetchedAt = -Infinity;
      return;
    }
    if (this._busy || now - this._fetchedAt < EVERY_MS) return;
    this._busy = true;
    this._fetchedAt = now;
    try {
      const query = new URLSearchParams({ seconds: String(seconds) });
      if (box) query.set("box", box.map((v) => v.toFixed(5)).join(","));
      if (at) query.set("at", String(at));
      const response = await fetch(`/api/trails?${query}`);
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

  // Lines from each trail to where its aircraft is drawn now; `numbers` limits them, null means all.
  upload(traffic, reference, numbers, moved) {
    const gl = this._gl;
    if (!gl) return;
    const data = [];
    this._reference = reference;
    for (let i = 0; i < traffic.count; i++) {
      const number = traffic.frame.number(i);
      if (numbers && !numbers.has(number)) continue;
      const trail = this.trails.get(number);
      if (!trail) continue;
      const end = traffic.at(i, moved);
      const n = trail.x.length;
      let before = null;
      for (let k = 0; k <= n; k++) {
        const x = wrapped((k < n ? trail.x[k] : end[0]) - reference.x), y = (k < n ? trail.y[k] : end[1]) - reference.y;
        const fade = 0.25 + (0.5 * k) / n;
        if (before && Math.abs(x - before[0]) < 0.5) data.push(...before, x, y, fade);
        before = [x, y, fade];
      }
    }
    this._vertices = data.length / 3;
    gl.bindBuffer(gl.ARRAY_BUFFER, this._buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(data), gl.DYNAMIC_DRAW);
  }

  draw(view, colour) {
    if (!this._vertices) return;
    const gl = this._gl, { program, uniforms } = this._program;
    gl.useProgram(program);
    bindAttributes(gl, this._buffer, 12, [[0, 2, gl.FLOAT, false, 0], [1, 1, gl.FLOAT, false, 8]], 0);
    setPlace(gl, uniforms, view, this._reference, 0);
    gl.uniform3fv(uniforms.colour, colour);
    gl.drawArrays(gl.LINES, 0, this._vertices);
  }
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
