// Aircraft as WebGL2 points: the shape says what a track rests on, the colour what the user has chosen.
//
// Circle: ADS-B and radar. Arrow head: ADS-B only. Square: radar only. Ring: coasted. Crossed diamond: suspect. Small:
// not confirmed. Speed vectors are lines of a buffer of their own, made where they are long enough to be seen: instances
// of one line would need no buffer, but without a graphics card 20,000 of them take a third of a second.

import { PALETTE_SIZE } from "./colours.js";
import { PLACE, bindAttributes, makeProgram, setPlace } from "./gl.js";
import { STRIDE } from "./traffic.js";

const POINTS = `
${PLACE}
layout(location=0) in vec2 at; layout(location=1) in vec2 velocity; layout(location=2) in float age;
layout(location=3) in uvec4 kind; layout(location=4) in float angle;
uniform vec3 palette[${PALETTE_SIZE}]; uniform float size;
out vec3 colour; out vec2 turn; flat out uint shape; out float opacity; out float pixel;
void main() {
  gl_Position = vec4(place(at + velocity * ahead(age)), 0.0, 1.0);
  bool small = kind.x >= 8u;
  shape = small ? kind.x - 8u : kind.x;
  float passes = float(kind.z);
  gl_PointSize = size * (small ? 0.7 : 1.0) * (kind.w == 1u ? 1.35 : 1.0) * mix(0.75, 1.0, passes);
  pixel = 2.0 / gl_PointSize;
  colour = palette[kind.y];
  opacity = mix(0.75, 1.0, passes);
  turn = vec2(cos(angle), sin(angle));
}`;

const SHAPES = `
in vec3 colour; in vec2 turn; flat in uint shape; in float opacity; in float pixel;
out vec4 paint;
void main() {
  vec2 p = gl_PointCoord * 2.0 - 1.0;
  vec2 q = vec2(p.x * turn.x + p.y * turn.y, p.y * turn.x - p.x * turn.y);
  float d; // below zero inside
  if (shape == 0u) d = length(p) - 0.72;
  else if (shape == 1u) d = max(0.925 * abs(q.x) - 0.381 * q.y - 0.362, -0.394 * abs(q.x) + 0.919 * q.y - 0.414);
  else if (shape == 2u) d = max(abs(p.x), abs(p.y)) - 0.62;
  else if (shape == 3u) d = abs(length(p) - 0.6) - 0.17;
  else d = min(abs(abs(p.x) + abs(p.y) - 0.8) - 0.13, max(abs(abs(p.x) - abs(p.y)) - 0.12, abs(p.x) + abs(p.y) - 0.8));
  float cover = clamp(0.5 - d / pixel, 0.0, 1.0) * opacity;
  if (cover < 0.02) discard;
  paint = vec4(colour * cover, cover);
}`;

const VECTORS = `
${PLACE}
layout(location=0) in vec2 at; layout(location=1) in vec2 velocity; layout(location=2) in float age;
layout(location=3) in uvec4 kind;
uniform vec3 palette[${PALETTE_SIZE}]; uniform float seconds;
out vec4 colour;
void main() {
  float t = ahead(age) + float(kind.w) * seconds;
  gl_Position = vec4(place(at + velocity * t), 0.0, 1.0);
  colour = vec4(palette[kind.y], 1.0) * 0.75;
}`;

const PLAIN = `
in vec4 colour; out vec4 paint;
void main() { paint = colour; }`;

const ATTRIBUTES = (gl) => [
  [0, 2, gl.FLOAT, false, 0],
  [1, 2, gl.FLOAT, false, 8],
  [2, 1, gl.FLOAT, false, 16],
  [4, 1, gl.FLOAT, false, 24],
];

export class Symbols {
  constructor(gl) {
    this._gl = gl;
    this._points = makeProgram(gl, POINTS, SHAPES);
    this._vectors = makeProgram(gl, VECTORS, PLAIN);
    this._buffer = gl.createBuffer();
    this._lines = gl.createBuffer();
    this._count = 0;
    this._ends = 0; // vertices of the speed vectors, -1: to be made
  }

  upload(traffic, reference) {
    const gl = this._gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, this._buffer);
    gl.bufferData(gl.ARRAY_BUFFER, traffic.pack(reference), gl.DYNAMIC_DRAW);
    this._count = traffic.count;
    this._ends = -1;
  }

  _bind(buffer) {
    const gl = this._gl;
    bindAttributes(gl, buffer, STRIDE, ATTRIBUTES(gl));
    gl.enableVertexAttribArray(3);
    gl.vertexAttribIPointer(3, 4, gl.UNSIGNED_BYTE, STRIDE, 20);
  }

  drawVectors(view, traffic, moved, palette, seconds) {
    // What the symbols cover need not be drawn.
    if (!this._count || seconds * traffic.fastest * view.scale < symbolSize(view.zoom) / 2) return;
    const gl = this._gl, { program, uniforms } = this._vectors;
    gl.useProgram(program);
    gl.bindBuffer(gl.ARRAY_BUFFER, this._lines);
    if (this._ends < 0) {
      const vertices = traffic.packVectors();
      gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.DYNAMIC_DRAW);
      this._ends = vertices.byteLength / STRIDE;
    }
    this._bind(this._lines);
    setPlace(gl, uniforms, view, traffic.reference, moved);
    gl.uniform3fv(uniforms.palette, palette);
    gl.uniform1f(uniforms.seconds, seconds);
    gl.drawArrays(gl.LINES, 0, this._ends);
  }

  draw(view, traffic, moved, palette, ratio) {
    if (!this._count) return;
    const gl = this._gl, { program, uniforms } = this._points;
    gl.useProgram(program);
    this._bind(this._buffer);
    setPlace(gl, uniforms, view, traffic.reference, moved);
    gl.uniform3fv(uniforms.palette, palette);
    gl.uniform1f(uniforms.size, symbolSize(view.zoom) * ratio);
    gl.drawArrays(gl.POINTS, 0, this._count);
  }
}

// Pixels of a symbol: small where the whole world is shown.
export function symbolSize(zoom) {
  return Math.max(5, Math.min(15, 3 + 1.4 * (zoom - 2)));
}
