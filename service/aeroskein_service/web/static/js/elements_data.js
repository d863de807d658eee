// The elements of one aircraft as plane geometry: axis, division points, boundary lines, reports, fused points, live state.
//
// Two frames of reference. "plan": metres east and north of a place near the aircraft. "strip": metres along the master
// track's axis and across it (left of the flight is positive), the flight laid out straight, as the method itself sees it.

import { LocalPlane } from "./projection.js";

const KEEP = 450; // elements of the selected aircraft that are remembered, half an hour

// Elements as they come, remembered by index, so that the charts reach farther back than the service's own memory.
export class ElementHistory {
  constructor() {
    this.clear("");
  }

  clear(track) {
    this.track = track;
    this.elements = new Map();
    this.live = null;
    this.waiting = [];
    this.number = null; // of the track; another one is another flight
  }

  take(answer) {
    const number = answer.live?.track_number ?? this.number;
    if (this.number !== null && number !== this.number) this.clear(this.track);
    this.number = number;
    for (const element of answer.elements ?? []) this.elements.set(element.element, element);
    // A replay may have jumped back: what is ahead of it is not known yet.
    for (const [index, element] of this.elements) if (element.span_s[1] > answer.time_s) this.elements.delete(index);
    this.live = answer.live ?? null;
    this.waiting = answer.waiting ?? [];
    const indices = [...this.elements.keys()].sort((a, b) => a - b);
    for (const old of indices.slice(0, -KEEP)) this.elements.delete(old);
  }

  // In order of time.
  list() {
    return [...this.elements.values()].sort((a, b) => a.element - b.element);
  }
}

// What is drawn: the last `count` elements with everything in both frames.
export function makeScene(history, count) {
  const records = unbroken(history.list()).slice(-count);
  if (!records.length && !history.live) return null;
  const place = history.live ?? records.at(-1).point;
  const plane = new LocalPlane(place.lat_deg, place.lon_deg);
  let station = 0;
  const elements = records.map((record) => {
    const element = makeElement(record, plane, station);
    station = element.end;
    return element;
  });
  // The newest division point is where the axis is 0, so that the picture does not jump when an old element goes.
  for (const element of elements) shift(element, -station);
  return { plane, elements, ...makeAhead(history, elements, plane) };
}

// The elements from the newest back to where one is missing, as after a jump of a replay.
function unbroken(records) {
  let first = records.length - 1;
  while (first > 0 && records[first - 1].element === records[first].element - 1) first -= 1;
  return records.slice(Math.max(first, 0));
}

function makeElement(record, plane, start) {
  const axis = axisOf(record).map(([lat, lon]) => plane.to(lat, lon));
  const stations = [start];
  for (let k = 1; k < axis.length; k++) stations.push(stations[k - 1] + Math.hypot(axis[k][0] - axis[k - 1][0], axis[k][1] - axis[k - 1][1]));
  const line = { axis, stations };
  const times = record.axis_time_s ?? [record.span_s[0], record.span_s[1]];
  const point = record.point ? makePoint(record.point, plane, line) : null;
  return {
    record, index: record.element, span: record.span_s, start, end: stations.at(-1), line,
    boundaries: (record.boundary_lines ?? []).map((side) => side.map(([lat, lon]) => plane.to(lat, lon))),
    halfWidth: record.half_width_m ?? NaN,
    reports: (record.reports ?? []).map((report) => makeReport(report, plane, line, times)),
    point, master: record.point?.master ?? null,
  };
}

// A file of fused points has no axis: the flight through the point, as long as the element.
function axisOf(record) {
  if (record.axis?.length > 1) return record.axis;
  const { lat_deg: lat, lon_deg: lon, ground_speed_mps: v, track_angle_deg: angle } = record.point;
  const half = ((record.span_s[1] - record.span_s[0]) / 2) * (v ?? 0);
  const dy = (half * Math.cos((angle * Math.PI) / 180)) / 111320, dx = (half * Math.sin((angle * Math.PI) / 180)) / (111320 * Math.cos((lat * Math.PI) / 180));
  return [[lat - dy, lon - dx], [lat, lon], [lat + dy, lon + dx]];
}

function makeReport(report, plane, line, times) {
  const at = plane.to(report.lat_deg, report.lon_deg);
  const { along, across } = project(at, line);
  const expected = stationAt(report.time_s, times, line.stations);
  return { ...report, at, along, across, residual: { along: along - expected, across } };
}

function makePoint(point, plane, line) {
  const at = plane.to(point.lat_deg, point.lon_deg);
  const { along, across, direction } = project(at, line);
  return { ...point, at, along, across, ellipse: ellipse(point.position_cov_m2, direction) };
}

// The newest division point, what has not been closed yet, and the live state.
function makeAhead(history, elements, plane) {
  const live = history.live && history.live.lat_deg != null ? { ...history.live, at: plane.to(history.live.lat_deg, history.live.lon_deg) } : null;
  const last = elements.at(-1);
  if (!live) return { live: null, waiting: [], ahead: [] };
  if (!last) {
    const line = { axis: [[0, 0], [0, 1]], stations: [0, 1] };
    return { live: { ...live, along: 0, across: 0, ellipse: ellipse(live.position_cov_m2, [0, 1]) }, waiting: [], ahead: line.axis };
  }
  const from = last.line.axis.at(-1);
  const axis = Math.hypot(live.at[0] - from[0], live.at[1] - from[1]) > 1 ? [from, live.at] : [from, [from[0] + 1, from[1]]];
  const line = { axis, stations: [0, Math.hypot(axis[1][0] - axis[0][0], axis[1][1] - axis[0][1])] };
  const { along, across, direction } = project(live.at, line);
  const waiting = history.waiting.map((report) => {
    const at = plane.to(report.lat_deg, report.lon_deg);
    return { ...report, at, ...project(at, line) };
  });
  return { live: { ...live, along, across, ellipse: ellipse(live.position_cov_m2, direction) }, waiting, ahead: axis };
}

function shift(element, by) {
  element.start += by;
  element.end += by;
  for (const report of element.reports) report.along += by;
  if (element.point) element.point.along += by;
  element.line.stations = element.line.stations.map((s) => s + by);
}

// Where a point lies along and across a polyline; its first and last pieces go on straight beyond their ends.
export function project([x, y], { axis, stations }) {
  let best = null;
  for (let k = 1; k < axis.length; k++) {
    const [x0, y0] = axis[k - 1], dx = axis[k][0] - x0, dy = axis[k][1] - y0;
    const length = Math.hypot(dx, dy) || 1e-9, ux = dx / length, uy = dy / length;
    let along = (x - x0) * ux + (y - y0) * uy;
    if (k > 1) along = Math.max(0, along);
    if (k < axis.length - 1) along = Math.min(length, along);
    const away = Math.hypot(x - x0 - along * ux, y - y0 - along * uy);
    if (!best || away < best.away) {
      const side = ux * (y - y0) - uy * (x - x0);
      best = { away, along: stations[k - 1] + along, across: Math.sign(side) * away, direction: [ux, uy] };
    }
  }
  return best;
}

function stationAt(time, times, stations) {
  let k = 1;
  while (k < times.length - 1 && time > times[k]) k++;
  const share = (time - times[k - 1]) / Math.max(times[k] - times[k - 1], 1e-9);
  const step = stations.length === times.length ? 1 : (stations.length - 1) / (times.length - 1);
  const a = stations[Math.round((k - 1) * step)], b = stations[Math.round(k * step)];
  return a + share * (b - a);
}

// Axes of one sigma and their direction, in east and north and along and across; null without a covariance.
export function ellipse(covariance, [ux, uy]) {
  if (!covariance) return null;
  const [ee, en, nn] = covariance;
  const mean = (ee + nn) / 2, off = Math.hypot((ee - nn) / 2, en);
  const turn = 0.5 * Math.atan2(2 * en, ee - nn);
  return {
    major: Math.sqrt(Math.max(mean + off, 0)), minor: Math.sqrt(Math.max(mean - off, 0)),
    plan: turn, strip: turn - Math.atan2(uy, ux),
  };
}

// Points on the ellipse of `k` sigma around the origin, in the given frame.
export function ellipseOutline(shape, frame, k, corners = 36) {
  const turn = shape[frame], c = Math.cos(turn), s = Math.sin(turn);
  return Array.from({ length: corners + 1 }, (_, i) => {
    const a = (i * 2 * Math.PI) / corners, u = k * shape.major * Math.cos(a), v = k * shape.minor * Math.sin(a);
    return [u * c - v * s, u * s + v * c];
  });
}
