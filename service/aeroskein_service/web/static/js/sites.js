// Radars on the map: the site, range rings every so many miles, and the instrumented range where it is known.

import { NM_M, direct } from "./projection.js";

const CORNERS = 90; // of a ring
const NAME_PX = 7; // a letter of a radar's name
const DEFAULT_RANGE_M = 150 * NM_M;

export function drawSites(context, view, sensors, settings, colours) {
  for (const sensor of sensors) {
    if (!sensor.radar || sensor.lat_deg == null || sensor.lon_deg == null) continue;
    if (settings.rings) drawRings(context, view, sensor, settings, colours);
    const [x, y] = view.toScreen(sensor.lat_deg, sensor.lon_deg);
    context.strokeStyle = context.fillStyle = colours.site;
    context.lineWidth = 1.5;
    context.beginPath();
    context.moveTo(x - 6, y + 5);
    context.lineTo(x, y - 6);
    context.lineTo(x + 6, y + 5);
    context.closePath();
    context.stroke();
    context.font = "12px system-ui, sans-serif";
    context.fillText(sensor.id, x + 9, y + 4);
  }
}

// Where the radars' symbols and names stand on the screen, as x, y, width, height: data blocks leave them free.
export function siteBoxes(view, sensors) {
  return sensors.filter((sensor) => sensor.radar && sensor.lat_deg != null && sensor.lon_deg != null).map((sensor) => {
    const [x, y] = view.toScreen(sensor.lat_deg, sensor.lon_deg);
    return [x - 7, y - 7, 18 + NAME_PX * sensor.id.length, 14];
  });
}

function drawRings(context, view, sensor, settings, colours) {
  const step = settings.ringstep * NM_M;
  const range = sensor.range_max_m ?? DEFAULT_RANGE_M;
  context.strokeStyle = colours.ring;
  context.fillStyle = colours.faint;
  context.font = "11px system-ui, sans-serif";
  context.lineWidth = 1;
  for (let r = step; r <= range + 1; r += step) {
    ring(context, view, sensor, r);
    const top = direct(sensor.lat_deg, sensor.lon_deg, 0, r);
    const [x, y] = view.toScreen(top.lat, top.lon);
    if (x > 0 && x < view.width && y > 0 && y < view.height) context.fillText(`${Math.round(r / NM_M)} NM`, x + 3, y - 3);
  }
  if (sensor.range_max_m != null) {
    context.setLineDash([6, 4]);
    ring(context, view, sensor, sensor.range_max_m);
    context.setLineDash([]);
  }
}

function ring(context, view, sensor, radius) {
  context.beginPath();
  let before = 0;
  for (let k = 0; k <= CORNERS; k++) {
    const place = direct(sensor.lat_deg, sensor.lon_deg, (k * 360) / CORNERS, radius);
    const [x, y] = view.toScreen(place.lat, place.lon);
    if (k > 0 && Math.abs(x - before) < view.scale / 2) context.lineTo(x, y);
    else context.moveTo(x, y);
    before = x;
  }
  context.stroke();
}
