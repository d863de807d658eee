// Meridians and parallels at a round spacing, labelled at the edge.

import { mercatorX, mercatorY, wrapLon } from "./projection.js";

const STEPS = [30, 15, 10, 5, 2, 1, 1 / 2, 1 / 3, 1 / 6, 1 / 12, 1 / 30, 1 / 60, 1 / 120, 1 / 360]; // degrees
const APART_PX = 110;

export function gridStep(view) {
  const pixelsPerDegree = view.scale / 360;
  return STEPS.findLast((step) => step * pixelsPerDegree >= APART_PX) ?? STEPS[0];
}

export function drawGrid(context, view, colours) {
  const step = gridStep(view);
  const left = (view.cx - view.width / 2 / view.scale - 0.5) * 360, right = (view.cx + view.width / 2 / view.scale - 0.5) * 360;
  const south = view.toPlace(0, view.height).lat, north = view.toPlace(0, 0).lat;
  context.beginPath();
  const marks = [];
  for (let lon = Math.ceil(left / step) * step; lon <= right; lon += step) {
    const x = (mercatorX(lon) - view.cx) * view.scale + view.width / 2;
    context.moveTo(x, 0);
    context.lineTo(x, view.height);
    marks.push([text(wrapLon(lon), "E", "W"), x + 3, view.height - 6]);
  }
  for (let lat = Math.ceil(south / step) * step; lat <= north; lat += step) {
    const y = view.screenY(mercatorY(lat));
    context.moveTo(0, y);
    context.lineTo(view.width, y);
    marks.push([text(lat, "N", "S"), 4, y - 3]);
  }
  context.strokeStyle = colours.grid;
  context.lineWidth = 1;
  context.stroke();
  context.fillStyle = colours.faint;
  context.font = "11px system-ui, sans-serif";
  for (const [label, x, y] of marks) context.fillText(label, x, y);
}

function text(value, positive, negative) {
  const minutes = Math.round(Math.abs(value) * 60 * 60) / 60;
  const d = Math.floor(minutes / 60), m = minutes - d * 60;
  const side = value >= 0 ? positive : negative;
  return m < 1e-6 ? `${d}°${side}` : `${d}°${m.toFixed(Number.isInteger(m) ? 0 : 1)}′${side}`;
}
