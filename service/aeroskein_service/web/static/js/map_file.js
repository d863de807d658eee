// The shipped map: coast, borders and land of Natural Earth, unpacked from `map/world.bin`.
//
// `tools/convert_map.py` makes the file and explains its layout. Each vertex carries the coarsest level of detail that it
// is needed for, so one set of arcs serves the whole world and a single country.

import { mercatorX, mercatorY } from "./projection.js";

export const COAST = 0;
export const BORDER = 1;
// Natural Earth cuts land at the antimeridian and at the South Pole; these cuts are no coast. Degrees.
const CUT_LON = 179.98;
const CUT_LAT = -89.9;

class Stream {
  constructor(bytes, at) {
    this._bytes = bytes;
    this._at = at;
  }

  number() {
    let value = 0, factor = 1, byte;
    do {
      byte = this._bytes[this._at++];
      value += (byte & 0x7f) * factor;
      factor *= 128;
    } while (byte & 0x80);
    return value;
  }

  signed() {
    return unzigzag(this.number());
  }
}

function unzigzag(value) {
  return value % 2 === 0 ? value / 2 : -(value + 1) / 2;
}

// Arcs `{kind, x, y, level, cut, box}` in Mercator units, and rings of arc references. Raises an Error for other files.
export function readMap(buffer) {
  const head = new DataView(buffer);
  const magic = String.fromCharCode(...new Uint8Array(buffer, 0, 4));
  if (magic !== "ASKM" || head.getUint8(4) !== 1) throw new Error("map/world.bin is no map of version 1");
  const arcCount = head.getUint32(8, true), ringCount = head.getUint32(12, true);
  const [scaleX, scaleY, startX, startY] = [20, 28, 36, 44].map((at) => head.getFloat64(at, true));
  const stream = new Stream(new Uint8Array(buffer), 52);
  const arcs = [];
  for (let a = 0; a < arcCount; a++) arcs.push(readArc(stream, scaleX, scaleY, startX, startY));
  const rings = [];
  for (let r = 0; r < ringCount; r++) {
    const count = stream.number();
    rings.push(Array.from({ length: count }, () => stream.signed()));
  }
  return { arcs, rings: rings.map((references) => ring(arcs, references)) };
}

function readArc(stream, scaleX, scaleY, startX, startY) {
  const kind = stream.number(), n = stream.number();
  const x = new Float64Array(n), y = new Float64Array(n), level = new Uint8Array(n), cut = new Uint8Array(n);
  let gx = 0, gy = 0, lonBefore = 0, latBefore = 0;
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  for (let i = 0; i < n; i++) {
    const packed = stream.number();
    level[i] = packed % 4;
    gx += unzigzag((packed - level[i]) / 4);
    gy += stream.signed();
    const lon = startX + gx * scaleX, lat = startY + gy * scaleY;
    x[i] = mercatorX(lon);
    y[i] = mercatorY(lat);
    // The piece that ends here is left out of the coast where it only closes a cut.
    const alongCut = (Math.abs(lon) > CUT_LON && Math.abs(lonBefore) > CUT_LON) || (lat < CUT_LAT && latBefore < CUT_LAT);
    cut[i] = i > 0 && (alongCut || Math.abs(lon - lonBefore) > 180) ? 1 : 0;
    lonBefore = lon;
    latBefore = lat;
    box[0] = Math.min(box[0], x[i]); box[1] = Math.min(box[1], y[i]);
    box[2] = Math.max(box[2], x[i]); box[3] = Math.max(box[3], y[i]);
  }
  return { kind, x, y, level, cut, box };
}

function ring(arcs, references) {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  const parts = references.map((reference) => {
    const arc = arcs[reference < 0 ? ~reference : reference];
    for (const k of [0, 1]) box[k] = Math.min(box[k], arc.box[k]);
    for (const k of [2, 3]) box[k] = Math.max(box[k], arc.box[k]);
    return { arc, reversed: reference < 0 };
  });
  return { parts, box };
}

// Which level of detail a map of so many pixels per world needs.
export function levelFor(pixelsPerWorld) {
  const degreesPerPixel = 360 / pixelsPerWorld;
  return degreesPerPixel > 0.15 ? 0 : degreesPerPixel > 0.025 ? 1 : 2;
}
