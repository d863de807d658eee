// Aircraft on a 2D canvas, for machines whose browser has no WebGL2: the same shapes and colours, drawn one by one.

import { symbolSize } from "./symbols.js";

const RAD = Math.PI / 180;

export class FlatSymbols {
  constructor(context) {
    this._context = context;
  }

  upload() {} // everything is at hand in the traffic itself

  draw(view, traffic, _moved, texts, ratio, seconds) {
    const context = this._context, frame = traffic.frame;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, view.width, view.height);
    const size = symbolSize(view.zoom) / 2;
    for (let i = 0; i < traffic.count; i++) {
      const x = traffic.sx[i], y = traffic.sy[i];
      if (x < -20 || y < -20 || x > view.width + 20 || y > view.height + 20) continue;
      context.strokeStyle = context.fillStyle = texts[traffic.colour[i]];
      if (seconds && traffic.passes[i]) {
        context.beginPath();
        context.moveTo(x, y);
        context.lineTo(x + traffic.vx[i] * view.scale * seconds, y + traffic.vy[i] * view.scale * seconds);
        context.stroke();
      }
      shape(context, traffic.source[i], x, y, frame.status(i) === 0 ? size * 0.7 : size, frame.angle(i) * RAD);
    }
  }
}

function shape(context, source, x, y, r, angle) {
  context.lineWidth = Math.max(1, r / 3);
  context.beginPath();
  if (source === 0) {
    context.arc(x, y, r * 0.72, 0, 7);
    context.fill();
  } else if (source === 1) {
    const c = Math.cos(angle), s = Math.sin(angle);
    for (const [px, py] of [[0, -0.95], [0.7, 0.75], [0, 0.45], [-0.7, 0.75]]) context.lineTo(x + r * (px * c - py * s), y + r * (px * s + py * c));
    context.fill();
  } else if (source === 2) {
    context.fillRect(x - r * 0.62, y - r * 0.62, r * 1.24, r * 1.24);
  } else if (source === 3) {
    context.arc(x, y, r * 0.6, 0, 7);
    context.stroke();
  } else {
    for (const [px, py] of [[0, -0.8], [0.8, 0], [0, 0.8], [-0.8, 0], [0, -0.8]]) context.lineTo(x + r * px, y + r * py);
    context.moveTo(x - r * 0.4, y - r * 0.4);
    context.lineTo(x + r * 0.4, y + r * 0.4);
    context.stroke();
  }
}
