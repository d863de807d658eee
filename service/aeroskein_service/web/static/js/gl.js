// The few WebGL2 calls that the layers share: programs with errors that say where, and buffers that grow.

// A program from its two shaders. Raises an Error with the compiler's words.
export function makeProgram(gl, vertex, fragment) {
  const program = gl.createProgram(), shaders = [];
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, `#version 300 es\nprecision highp float;\n${source}`);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
    shaders.push(shader);
  }
  gl.linkProgram(program);
  // Asked once for all, for each answer waits until the graphics card has done what it was told.
  if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
    throw new Error([...shaders.map((shader) => gl.getShaderInfoLog(shader)), gl.getProgramInfoLog(program)].filter(Boolean).join("\n"));
  }
  const uniforms = {};
  const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) ?? 0;
  for (let k = 0; k < count; k++) {
    const name = gl.getActiveUniform(program, k).name.replace("[0]", "");
    uniforms[name] = gl.getUniformLocation(program, name);
  }
  return { program, uniforms };
}

// Attributes of an interleaved buffer: `[location, size, type, normalised, offset]` each.
export function bindAttributes(gl, buffer, stride, attributes) {
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  for (const [location, size, type, normalised, offset] of attributes) {
    gl.enableVertexAttribArray(location);
    gl.vertexAttribPointer(location, size, type, normalised, stride, offset);
  }
}

// Place of a Mercator point on the screen, shared by all shaders. `shift` is reference minus centre, in Mercator units;
// `moved` seconds have passed since the frame. Points off the other side of the world come round.
export const PLACE = `
uniform vec2 shift; uniform vec2 view; uniform float scale; uniform float moved;
vec2 place(vec2 at) {
  vec2 d = at + shift;
  d.x -= round(d.x);
  return vec2(2.0, -2.0) * d * scale / view;
}
float ahead(float age) { return clamp(moved + age, -1.0, 15.0); }
`;

export function setPlace(gl, uniforms, view, reference, moved) {
  let dx = reference.x - view.cx;
  dx -= Math.round(dx);
  gl.uniform2f(uniforms.shift, dx, reference.y - view.cy);
  gl.uniform2f(uniforms.view, view.width, view.height);
  gl.uniform1f(uniforms.scale, view.scale);
  if (uniforms.moved) gl.uniform1f(uniforms.moved, moved);
}
