// Small charts over time on a 2D canvas: lines or dots per series, bands, a strip of colours, and a line under the pointer.

import { fitCanvas } from "./dom.js";
import { clock } from "./format.js";

const LEFT = 44, RIGHT = 8, TOP = 6, BOTTOM = 16; // px round the drawing

// A round step for about `many` ticks over a span.
export function tickStep(span, many) {
  const raw = span / Math.max(many, 1);
  const power = 10 ** Math.floor(Math.log10(raw));
  return ([1, 2, 5].find((k) => k * power >= raw) ?? 10) * power;
}

function extent(values) {
  let low = Infinity, high = -Infinity;
  for (const list of values) {
    for (const v of list) {
      if (!Number.isFinite(v)) continue;
      if (v < low) low = v;
      if (v > high) high = v;
    }
  }
  return low < Infinity ? [low, high] : null;
}

// The extent with some room above and below.
function range(values, fromZero) {
  let [low, high] = extent(values) ?? [NaN, NaN];
  if (!Number.isFinite(low)) return null;
  if (fromZero) low = Math.min(low, 0);
  const spare = Math.max((high - low) * 0.08, Math.abs(high) * 1e-6, 1e-9);
  return high - low < 1e-9 ? [low - Math.max(Math.abs(low) * 0.05, 0.5), high + Math.max(Math.abs(high) * 0.05, 0.5)] : [fromZero && low === 0 ? 0 : low - spare, high + spare];
}

// `content`: {series: [{x, y, colour, line, hollow, dash}], bands: [{x, low, high, colour}], times: [from, to] or none,
// values: [from, to] or none, ticks: [value] or none, fromZero, zero, marks: [time], cursor: time, format}. Returns what was drawn, for tests.
export function drawChart(canvas, colours, content) {
  const { context, width, height } = fitCanvas(canvas);
  const { series = [], bands = [] } = content;
  const xs = content.times ?? extent([...series, ...bands].map((s) => s.x));
  const ys = content.values ?? range([...series.map((s) => s.y), ...bands.flatMap((b) => [b.low, b.high])], content.fromZero);
  if (!xs || !ys || width < 80) {
    context.fillStyle = colours.faint;
    context.font = "12px system-ui, sans-serif";
    context.fillText("no data yet", 8, height / 2);
    return 0;
  }
  const px = (x) => LEFT + ((x - xs[0]) / Math.max(xs[1] - xs[0], 1e-9)) * (width - LEFT - RIGHT);
  const py = (y) => TOP + ((ys[1] - y) / (ys[1] - ys[0])) * (height - TOP - BOTTOM);
  axes(context, colours, xs, ys, px, py, width, height, content);
  context.save();
  context.beginPath();
  context.rect(LEFT, 0, width - LEFT - RIGHT + 4, height);
  context.clip();
  for (const band of bands) fillBand(context, band, px, py);
  let drawn = 0;
  for (const one of series) drawn += drawSeries(context, one, px, py);
  if (content.cursor != null) {
    context.strokeStyle = colours.selected;
    context.beginPath();
    context.moveTo(px(content.cursor), TOP);
    context.lineTo(px(content.cursor), height - BOTTOM);
    context.stroke();
  }
  context.restore();
  return drawn;
}

function axes(context, colours, xs, ys, px, py, width, height, content) {
  context.font = "11px system-ui, sans-serif";
  context.lineWidth = 1;
  const step = tickStep(ys[1] - ys[0], (height - TOP - BOTTOM) / 26);
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  context.textAlign = "right";
  const ticks = content.ticks ?? [];
  if (!content.ticks) for (let y = Math.ceil(ys[0] / step) * step; y <= ys[1] + 1e-12; y += step) ticks.push(y);
  for (const y of ticks.filter((v) => v >= ys[0] && v <= ys[1])) {
    context.strokeStyle = Math.abs(y) < step / 1e6 && content.zero ? colours.faint : colours.grid;
    context.beginPath();
    context.moveTo(LEFT, py(y));
    context.lineTo(width - RIGHT, py(y));
    context.stroke();
    context.fillStyle = colours.faint;
    context.fillText(content.format ? content.format(y) : (Math.abs(y) < step / 1e6 ? 0 : y).toFixed(Math.min(decimals, 6)), LEFT - 5, py(y) + 4);
  }
  context.textAlign = "center";
  const span = Math.max(xs[1] - xs[0], 1);
  const timeStep = [1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200].find((s) => span / s <= (width - LEFT) / 62) ?? 14400;
  for (let t = Math.ceil(xs[0] / timeStep) * timeStep; t <= xs[1]; t += timeStep) {
    context.fillStyle = colours.faint;
    context.fillText(timeStep < 60 ? clock(t) : clock(t).slice(0, 5), px(t), height - 3);
  }
  for (const t of content.marks ?? []) {
    context.strokeStyle = colours.grid;
    context.beginPath();
    context.moveTo(px(t), TOP);
    context.lineTo(px(t), height - BOTTOM);
    context.stroke();
  }
  context.textAlign = "left";
}

function fillBand(context, band, px, py) {
  if (!band.x.length) return;
  context.globalAlpha = 0.25;
  context.fillStyle = band.colour;
  context.beginPath();
  band.x.forEach((x, k) => context.lineTo(px(x), py(band.high[k])));
  for (let k = band.x.length - 1; k >= 0; k--) context.lineTo(px(band.x[k]), py(band.low[k]));
  context.fill();
  context.globalAlpha = 1;
}

function drawSeries(context, { x, y, colour, line, hollow, dash, cross }, px, py) {
  context.strokeStyle = context.fillStyle = colour;
  context.lineWidth = line ? 1.5 : 1.2;
  let drawn = 0;
  if (line) {
    context.setLineDash(dash ?? []);
    context.beginPath();
    let pen = false;
    x.forEach((t, k) => {
      if (!Number.isFinite(y[k]) || y[k] === null) {
        pen = false;
        return;
      }
      if (pen) context.lineTo(px(t), py(y[k]));
      else context.moveTo(px(t), py(y[k]));
      pen = true;
      drawn += 1;
    });
    context.stroke();
    context.setLineDash([]);
    return drawn;
  }
  x.forEach((t, k) => {
    if (!Number.isFinite(y[k]) || y[k] === null) return;
    const cx = px(t), cy = py(y[k]);
    context.beginPath();
    if (cross) {
      context.moveTo(cx - 3, cy - 3); context.lineTo(cx + 3, cy + 3);
      context.moveTo(cx - 3, cy + 3); context.lineTo(cx + 3, cy - 3);
      context.stroke();
    } else {
      context.arc(cx, cy, 2.4, 0, 2 * Math.PI);
      if (hollow) context.stroke();
      else context.fill();
    }
    drawn += 1;
  });
  return drawn;
}
