// Which aircraft pass the filters: altitude band, box, sensor, status, source, text, emergencies only.
//
// What does not pass is dimmed and loses its label and its row in the table; its symbol stays, for an air picture that
// hides traffic is none. Emergencies and selected aircraft always pass.

import { STATUS } from "./frame.js";
import { SOURCES } from "./colours.js";

// Names of the settings that filter.
export const FILTER_SETTINGS = ["q", "altmin", "altmax", "bbox", "sensor", "status", "source", "emergency", "isolate"];

// A box `lat_min,lon_min,lat_max,lon_max`, null where the text is none.
export function parseBox(text) {
  const parts = text.split(",").map((part) => (part.trim() === "" ? NaN : Number(part)));
  if (parts.length !== 4 || !parts.every(Number.isFinite)) return null;
  const [latMin, lonMin, latMax, lonMax] = parts;
  const fits = latMin <= latMax && Math.abs(latMin) <= 90 && Math.abs(latMax) <= 90 && Math.abs(lonMin) <= 180 && Math.abs(lonMax) <= 180;
  return fits ? parts : null;
}

function level(text) {
  const value = Number(text);
  return text.trim() !== "" && Number.isFinite(value) ? value * 30.48 : null;
}

// A function of frame, row and source; `sensors` are the sensors in the order of their bits.
export function makeFilter(settings, sensors) {
  const tests = [];
  const low = level(settings.altmin), high = level(settings.altmax);
  if (low !== null) tests.push((f, i) => f.altitude(i) >= low);
  if (high !== null) tests.push((f, i) => f.altitude(i) <= high);
  const box = parseBox(settings.bbox);
  if (box) tests.push((f, i) => inBox(f.lat(i), f.lon(i), box));
  const bit = sensors.findIndex((sensor) => sensor.id === settings.sensor);
  if (settings.sensor) tests.push(bit < 0 ? () => false : (f, i) => (f.sensors(i) >>> bit) & 1);
  if (settings.status) tests.push((f, i) => STATUS[f.status(i)] === settings.status);
  if (settings.source) tests.push((_f, _i, source) => SOURCES[source] === settings.source);
  const text = settings.q.trim().toUpperCase();
  if (text) tests.push((f, i) => f.callsign(i).includes(text) || f.label(i).includes(text) || f.address(i).includes(text) || f.codeText(i).includes(text));
  if (settings.emergency) tests.push(() => false);
  const chosen = new Set(settings.selected);
  const isolate = settings.isolate && chosen.size > 0;
  return (frame, i, source) => {
    if (frame.emergency(i)) return true;
    if (chosen.size && chosen.has(frame.label(i))) return true;
    return !isolate && tests.every((test) => test(frame, i, source));
  };
}

export function inBox(lat, lon, [latMin, lonMin, latMax, lonMax]) {
  const between = lonMin <= lonMax ? lon >= lonMin && lon <= lonMax : lon >= lonMin || lon <= lonMax;
  return lat >= latMin && lat <= latMax && between;
}

// How many filters are on.
export function activeFilters(settings) {
  return FILTER_SETTINGS.filter((name) => settings[name] !== "" && settings[name] !== false).length;
}
