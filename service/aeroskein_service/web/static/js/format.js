// Numbers as controllers, engineers and newcomers read them: flight levels, knots, degrees; metres where asked.

const KNOT = 1852 / 3600;
const FOOT = 0.3048;
const FEET_PER_HPA = 27.3; // near sea level, where the altimeter setting counts

export const knots = (mps) => mps / KNOT;
export const feet = (m) => m / FOOT;

// Above the transition altitude a flight level, below it the altitude on the set QNH: "F350", "A045"; "---" where unknown.
export function level(altitude_m, settings) {
  if (!Number.isFinite(altitude_m)) return "---";
  if (settings.units === "metric") return `${Math.round(altitude_m / 10) * 10} m`;
  const corrected = feet(altitude_m) + (settings.qnh - 1013.25) * FEET_PER_HPA;
  const onQnh = corrected < settings.transition;
  const hundreds = Math.round((onQnh ? corrected : feet(altitude_m)) / 100);
  const digits = String(Math.abs(hundreds)).padStart(3, "0");
  return `${onQnh ? "A" : "F"}${hundreds < 0 ? "-" : ""}${digits}`;
}

// An arrow where it climbs or descends by more than 300 feet a minute.
export function trend(rate_mps) {
  if (!Number.isFinite(rate_mps) || Math.abs(rate_mps) < 1.5) return "";
  return rate_mps > 0 ? "↑" : "↓";
}

export function speed(mps, settings, unit = true) {
  if (!Number.isFinite(mps)) return "---";
  if (settings.units === "metric") return `${mps.toFixed(0)}${unit ? " m/s" : ""}`;
  return `${knots(mps).toFixed(0)}${unit ? " kt" : ""}`;
}

export function verticalRate(mps, settings) {
  if (!Number.isFinite(mps)) return "---";
  if (settings.units === "metric") return `${signed(mps, 1)} m/s`;
  const rate = Math.round((mps / FOOT) * 60 / 50) * 50;
  return `${rate === 0 ? "0" : signed(rate, 0)} ft/min`;
}

export function distance(m, settings) {
  if (!Number.isFinite(m)) return "---";
  if (settings.units === "metric") return m < 2000 ? `${m.toFixed(0)} m` : `${(m / 1000).toFixed(1)} km`;
  return `${(m / 1852).toFixed(1)} NM`;
}

export function metres(m, decimals = 0) {
  return Number.isFinite(m) ? `${m.toFixed(decimals)} m` : "---";
}

export function degrees(value, decimals = 0) {
  return Number.isFinite(value) ? `${value.toFixed(decimals).padStart(decimals ? decimals + 4 : 3, "0")}°` : "---";
}

export function signed(value, decimals) {
  return `${value >= 0 ? "+" : "−"}${Math.abs(value).toFixed(decimals)}`;
}

export function latitude(value) {
  return `${dms(value, 2)}${value < 0 ? "S" : "N"}`;
}

export function longitude(value) {
  return `${dms(value, 3)}${value < 0 ? "W" : "E"}`;
}

function dms(value, width) {
  const seconds = Math.round(Math.abs(value) * 3600);
  const d = Math.floor(seconds / 3600), m = Math.floor((seconds % 3600) / 60), s = seconds % 60;
  return `${String(d).padStart(width, "0")}°${String(m).padStart(2, "0")}′${String(s).padStart(2, "0")}″`;
}

// Time of day, UTC.
export function clock(time_s, decimals = 0) {
  if (!Number.isFinite(time_s) || time_s <= 0) return "--:--:--";
  const text = new Date(Math.floor(time_s * 1000)).toISOString();
  return decimals ? text.slice(11, 20 + decimals) : text.slice(11, 19);
}

export function date(time_s) {
  return Number.isFinite(time_s) && time_s > 0 ? new Date(time_s * 1000).toISOString().slice(0, 10) : "";
}

export function seconds(value) {
  if (!Number.isFinite(value)) return "---";
  if (value < 1) return `${(value * 1000).toFixed(0)} ms`;
  return value < 120 ? `${value.toFixed(value < 10 ? 1 : 0)} s` : `${Math.round(value / 60)} min`;
}

export function rate(perSecond) {
  if (!Number.isFinite(perSecond)) return "---";
  return `${perSecond < 10 ? perSecond.toFixed(1) : perSecond.toFixed(0)}/s`;
}

export function count(value) {
  return Number.isFinite(value) ? Math.round(value).toLocaleString("en-US") : "---";
}

const REASONS = {
  malformed: "could not be read", bad_value: "a value is impossible", bad_address: "the address is none",
  no_position: "no position", too_old: "too old on arrival", future: "time stamp in the future",
  late: "came after its element was closed", duplicate: "the same report again", stale: "old position with a new time",
  duplicate_batch: "the same batch again", implausible: "impossible jump", outside_boundary: "outside the boundary lines",
  outlier: "does not fit the track", sensor_off: "sensor switched off", unassociated: "belongs to no track",
  overload: "dropped under load", bad_encoding: "wrong encoding", bad_version: "unknown version",
  wrong_sensor: "names another sensor", too_many_reports: "batch too large", bad_callsign: "callsign dropped",
  bad_mode_a: "code dropped",
};

export function reason(name) {
  return REASONS[name] ?? name;
}
