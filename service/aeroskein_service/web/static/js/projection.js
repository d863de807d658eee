// Web Mercator as numbers from 0 to 1, and short-range geometry on the sphere: all that the map and the charts compute with.
//
// x runs east from the antimeridian, y south from 85.05° north. Distances use the mean radius (0.3 % off the ellipsoid at
// worst): they are for rings, scales and the cursor, never for the picture itself, which comes in WGS-84.

export const EARTH_M = 6371008.8;
export const NM_M = 1852;
const RAD = Math.PI / 180;
const LAT_MAX = 85.0511;
const CIRCUMFERENCE_M = 2 * Math.PI * EARTH_M;

export function mercatorX(lon) {
  return lon / 360 + 0.5;
}

export function mercatorY(lat) {
  const s = Math.sin(Math.max(-LAT_MAX, Math.min(LAT_MAX, lat)) * RAD);
  return 0.5 - Math.log((1 + s) / (1 - s)) / (4 * Math.PI);
}

export function lonOf(x) {
  return (x - 0.5) * 360;
}

export function latOf(y) {
  return Math.atan(Math.sinh(Math.PI * (1 - 2 * y))) / RAD;
}

// Mercator units per metre at a latitude.
export function unitsPerMetre(lat) {
  return 1 / (CIRCUMFERENCE_M * Math.cos(Math.max(-LAT_MAX, Math.min(LAT_MAX, lat)) * RAD));
}

// The difference of two x, taken the short way round the world.
export function wrapped(dx) {
  return dx - Math.round(dx);
}

export function wrapLon(lon) {
  return ((((lon + 180) % 360) + 360) % 360) - 180;
}

// Distance [m] and initial bearing [degrees] from one place to another.
export function inverse(lat1, lon1, lat2, lon2) {
  const f1 = lat1 * RAD, f2 = lat2 * RAD, dl = (lon2 - lon1) * RAD;
  const h = Math.sin((f2 - f1) / 2) ** 2 + Math.cos(f1) * Math.cos(f2) * Math.sin(dl / 2) ** 2;
  const bearing = Math.atan2(Math.sin(dl) * Math.cos(f2), Math.cos(f1) * Math.sin(f2) - Math.sin(f1) * Math.cos(f2) * Math.cos(dl));
  return { distance: 2 * EARTH_M * Math.asin(Math.sqrt(Math.min(1, h))), bearing: (bearing / RAD + 360) % 360 };
}

// The place at a distance [m] and bearing [degrees].
export function direct(lat, lon, bearing, distance) {
  const f = lat * RAD, b = bearing * RAD, d = distance / EARTH_M;
  const f2 = Math.asin(Math.sin(f) * Math.cos(d) + Math.cos(f) * Math.sin(d) * Math.cos(b));
  const dl = Math.atan2(Math.sin(b) * Math.sin(d) * Math.cos(f), Math.cos(d) - Math.sin(f) * Math.sin(f2));
  return { lat: f2 / RAD, lon: wrapLon(lon + dl / RAD) };
}

// Metres east and north of a place, with the WGS-84 radii of curvature there: distances between neighbours are right to a
// thousandth within 10 km, which is all that a drawing of elements needs.
export class LocalPlane {
  constructor(lat, lon) {
    const a = 6378137, e2 = 0.00669437999014;
    const s = Math.sin(lat * RAD);
    const w = Math.sqrt(1 - e2 * s * s);
    this.lat = lat;
    this.lon = lon;
    this.north = (a * (1 - e2)) / (w * w * w) * RAD; // metres per degree
    this.east = (a / w) * Math.cos(lat * RAD) * RAD;
  }

  to(lat, lon) {
    return [wrapLon(lon - this.lon) * this.east, (lat - this.lat) * this.north];
  }
}
