// Marks over the traffic: rings round selected aircraft and emergencies, arrows to emergencies out of view, the ruler.

import { distance } from "./format.js";
import { inverse } from "./projection.js";

const RING_PX = 11;
const EDGE_PX = 22; // of an arrow from the edge of the map

export function drawMarks(context, stage, view, colours) {
  const traffic = stage.traffic, selected = stage.selectedRows(), emergencies = new Set(traffic.emergencies);
  const marked = new Set([...emergencies, ...selected, ...(stage.hover >= 0 ? [stage.hover] : [])]);
  for (const i of marked) {
    const emergency = emergencies.has(i), x = traffic.sx[i], y = traffic.sy[i];
    const outside = x < 0 || y < 0 || x > view.width || y > view.height;
    context.strokeStyle = emergency ? colours.emergency : selected.has(i) ? colours.selected : colours.faint;
    context.lineWidth = emergency ? 2.5 : 2;
    if (!outside) ringAt(context, x, y, emergency ? RING_PX + 3 : RING_PX);
    else if (emergency) arrow(context, view, x, y, traffic.frame.name(i), colours);
  }
  if (stage.ruler) drawRuler(context, stage, view, colours);
}

function ringAt(context, x, y, r) {
  context.beginPath();
  context.arc(x, y, r, 0, 2 * Math.PI);
  context.stroke();
}

// An aircraft in distress out of view: an arrow at the edge points to it.
function arrow(context, view, x, y, name, colours) {
  const cx = view.width / 2, cy = view.height / 2;
  const angle = Math.atan2(y - cy, x - cx);
  const k = Math.min((cx - EDGE_PX) / Math.abs(Math.cos(angle) || 1e-9), (cy - EDGE_PX) / Math.abs(Math.sin(angle) || 1e-9));
  const ax = cx + Math.cos(angle) * k, ay = cy + Math.sin(angle) * k;
  context.fillStyle = colours.emergency;
  context.beginPath();
  for (const [length, turn] of [[12, 0], [10, 2.5], [10, -2.5]]) context.lineTo(ax + Math.cos(angle + turn) * length, ay + Math.sin(angle + turn) * length);
  context.fill();
  context.font = "bold 12px system-ui, sans-serif";
  context.textAlign = ax > cx ? "right" : "left";
  context.fillText(name, ax + (ax > cx ? -16 : 16), ay + 4);
  context.textAlign = "left";
}

function drawRuler(context, stage, view, colours) {
  const { from, to } = stage.ruler;
  if (!to) return;
  const [x1, y1] = view.toScreen(from.lat, from.lon), [x2, y2] = view.toScreen(to.lat, to.lon);
  const { distance: d, bearing } = inverse(from.lat, from.lon, to.lat, to.lon);
  context.strokeStyle = context.fillStyle = colours.selected;
  context.lineWidth = 1.5;
  context.setLineDash([5, 4]);
  context.beginPath();
  context.moveTo(x1, y1);
  context.lineTo(x2, y2);
  context.stroke();
  context.setLineDash([]);
  context.font = "12px system-ui, sans-serif";
  context.fillText(`${distance(d, stage.settings)} ${bearing.toFixed(0).padStart(3, "0")}°`, x2 + 10, y2 - 8);
}
