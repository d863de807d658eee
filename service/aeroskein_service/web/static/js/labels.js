// Data blocks beside the symbols, with leader lines, placed so that they cover neither symbols nor each other.
//
// Greedy, most important first: selected, emergency, then those that had a place before, so that labels do not jump. A
// block that finds no free place is left out; the symbol never is. An emergency is always written.

import { knots, level, speed, trend } from "./format.js";

const FONT = "12px ui-monospace, 'DejaVu Sans Mono', Menlo, Consolas, monospace";
const CHAR_PX = 7.23; // of that font
const LINE_PX = 14;
const NEAR_PX = 14; // from the symbol to the block
const FAR_PX = 44;
const FARTHEST_PX = 66;
const CELL_PX = 7; // of the raster that finds free places
const EDGE = 12; // cells beyond the edge of the screen
const TRIES = 4; // aircraft that may be tried for each label that may be drawn
const VEIL = 0.6;
// Directions tried: right up first, as controllers are used to.
const AROUND = [[1, -1], [1, 1], [-1, -1], [-1, 1], [1, 0], [-1, 0], [0, -1], [0, 1]];
// Near the symbol, then farther off with a longer leader line. [side, up or down, px]
const DIRECTIONS = [NEAR_PX, FAR_PX, FARTHEST_PX].flatMap((away) => AROUND.map(([h, v]) => [h, v, away]));
const EMERGENCY_WORDS = { 0o7500: "HIJACK", 0o7600: "RADIO", 0o7700: "EMERGENCY" };

export class Labels {
  constructor(context, settings) {
    this._context = context;
    this._settings = settings;
    this._places = new Map(); // by track number, kept from one placing to the next: direction, and the row it had
    this._placed = [];
    this.drawn = 0;
    this.wanted = 0;
  }

  // Find places for the labels of this frame. `marked` are rows that come first, `kept` are boxes that stay free.
  place(traffic, view, marked, kept) {
    const frame = traffic.frame;
    const raster = new Raster(view.width, view.height);
    for (const [x, y, w, h] of kept) raster.take(x, y, w, h);
    const ranks = this._ranked(traffic, view, marked, raster);
    const places = new Map();
    this._placed = [];
    let tries = 0;
    for (const row of ranks.flat()) {
      if (row.rank > 1 && (this._placed.length >= this._settings.density || tries++ > TRIES * this._settings.density)) break;
      const block = this._block(traffic, row, raster);
      if (!block) continue;
      places.set(frame.number(row.i), block);
      this._placed.push(block);
    }
    this._places = places;
  }

  // What wants a label, by importance; every symbol takes its place on the raster.
  _ranked(traffic, view, marked, raster) {
    const { frame, sx, sy, passes } = traffic, right = view.width + 20, bottom = view.height + 20;
    const ranks = [[], [], [], []], all = this._settings.labels > 0, most = TRIES * this._settings.density;
    const before = rowsOf(this._places, frame), emergencies = new Set(traffic.emergencies);
    this.wanted = 0;
    for (let i = 0; i < frame.count; i++) {
      const x = sx[i], y = sy[i];
      if (x < -20 || y < -20 || x > right || y > bottom) continue;
      raster.mark(x, y);
      if (!all || !passes[i]) continue;
      this.wanted += 1;
      // Of those without a place so far only as many are kept as may be tried.
      if (ranks[3].length < most && !before.has(i) && !marked.has(i) && !emergencies.has(i)) ranks[3].push({ i, x, y, rank: 3 });
    }
    const inView = (i) => sx[i] >= -20 && sy[i] >= -20 && sx[i] <= right && sy[i] <= bottom;
    const add = (rows, rank) => rows.forEach((i) => inView(i) && ranks[rank].push({ i, x: sx[i], y: sy[i], rank }));
    add(marked, 0);
    add(traffic.emergencies.filter((i) => !marked.has(i)), 1);
    if (all) add([...before].filter((i) => passes[i] && !marked.has(i) && !emergencies.has(i)), 2);
    return ranks;
  }

  _block(traffic, row, raster) {
    const detail = row.rank <= 1 ? 2 : this._settings.labels;
    const lines = dataBlock(traffic.frame, row.i, detail, this._settings);
    const width = lines.reduce((most, line) => Math.max(most, line.length), 0) * CHAR_PX, height = lines.length * LINE_PX;
    const before = this._places.get(traffic.frame.number(row.i))?.direction ?? 0;
    let found = -1;
    for (let k = -1; k < DIRECTIONS.length; k++) {
      const direction = k < 0 ? before : k;
      const offset = blockOffset(direction, width, height);
      const left = row.x + offset.x, top = row.y + offset.y;
      if (!raster.free(left, top, width, height)) continue;
      if (found < 0) found = direction;
      // One that the edge of the map would cut is taken only where there is no other.
      if (!raster.holds(left, top, width, height)) continue;
      found = direction;
      break;
    }
    if (found < 0 && row.rank > 1) return null;
    const direction = Math.max(found, 0), offset = blockOffset(direction, width, height);
    raster.take(row.x + offset.x, row.y + offset.y, width, height);
    return { i: row.i, lines, width, height, direction, rank: row.rank };
  }

  draw(traffic, colours, palette) {
    const context = this._context, frame = traffic.frame;
    context.font = FONT;
    context.textBaseline = "top";
    this.drawn = 0;
    for (const block of this._placed) {
      if (block.i >= frame.count) continue;
      const x = traffic.sx[block.i], y = traffic.sy[block.i];
      const offset = blockOffset(block.direction, block.width, block.height);
      const left = x + offset.x, top = y + offset.y;
      const emergency = frame.emergency(block.i);
      const ink = emergency ? colours.emergency : block.rank === 0 ? colours.selected : colours.text;
      context.strokeStyle = emergency ? colours.emergency : palette[traffic.colour[block.i]];
      context.lineWidth = 1;
      context.beginPath();
      const [ex, ey] = [Math.max(left, Math.min(x, left + block.width)), Math.max(top, Math.min(y, top + block.height))];
      const length = Math.hypot(ex - x, ey - y);
      if (length > 7) {
        context.moveTo(x + ((ex - x) * 7) / length, y + ((ey - y) * 7) / length);
        context.lineTo(ex, ey);
        context.stroke();
      }
      // A veil under the text keeps it readable over lines; drawing an outline round it would cost as much as the text.
      context.globalAlpha = VEIL;
      context.fillStyle = colours.halo;
      context.fillRect(left - 1, top - 1, block.width + 2, block.height);
      context.globalAlpha = 1;
      context.fillStyle = ink;
      for (let k = 0; k < block.lines.length; k++) context.fillText(block.lines[k], left, top + k * LINE_PX);
      this.drawn += 1;
    }
    context.textBaseline = "alphabetic";
  }

  // The row whose label lies under a point of the screen, -1 where there is none.
  at(traffic, px, py) {
    for (const block of this._placed) {
      const offset = blockOffset(block.direction, block.width, block.height);
      const left = traffic.sx[block.i] + offset.x, top = traffic.sy[block.i] + offset.y;
      if (px >= left && px <= left + block.width && py >= top && py <= top + block.height) return block.i;
    }
    return -1;
  }
}

// The rows of tracks by number: most have the row that they had, for rows keep their order while tracks stay.
function rowsOf(places, frame) {
  const rows = new Set(), gone = new Set();
  for (const [number, { i }] of places) {
    if (i < frame.count && frame.number(i) === number) rows.add(i);
    else gone.add(number);
  }
  for (let i = 0; gone.size > 0 && i < frame.count; i++) if (gone.delete(frame.number(i))) rows.add(i);
  return rows;
}

function blockOffset(direction, width, height) {
  const [h, v, away] = DIRECTIONS[direction];
  return {
    x: h > 0 ? away : h < 0 ? -away - width : -width / 2,
    y: v > 0 ? away / 2 : v < 0 ? -away / 2 - height : -height / 2,
  };
}

// The lines of a data block: name; level with its trend and ground speed; code.
export function dataBlock(frame, i, detail, settings) {
  const lines = [frame.name(i)];
  const up = trend(frame.rate(i));
  const v = frame.speed(i);
  if (detail < 2) return [`${lines[0]} ${level(frame.altitude(i), settings)}${up}`];
  const tempo = settings.units === "metric" ? speed(v, settings) : Number.isFinite(v) ? `G${knots(v).toFixed(0)}` : "";
  lines.push(`${level(frame.altitude(i), settings)}${up} ${tempo}`.trim());
  const code = frame.codeText(i);
  if (code) lines.push(frame.emergency(i) ? `${code} ${EMERGENCY_WORDS[frame.code(i)]}` : code);
  return lines;
}

// Which cells of the screen are taken.
class Raster {
  constructor(width, height) {
    this._width = width;
    this._height = height;
    this._columns = Math.ceil(width / CELL_PX) + 2 * EDGE;
    this._rows = Math.ceil(height / CELL_PX) + 2 * EDGE;
    this._taken = new Uint8Array(this._columns * this._rows);
  }

  _column(x) { return Math.max(0, Math.min(this._columns - 1, Math.floor(x / CELL_PX) + EDGE)); }
  _row(y) { return Math.max(0, Math.min(this._rows - 1, Math.floor(y / CELL_PX) + EDGE)); }

  // Whether a box is on the screen as a whole.
  holds(x, y, w, h) {
    return x >= 0 && y >= 0 && x + w <= this._width && y + h <= this._height;
  }

  // The place of a symbol, no more than `EDGE` cells beyond the edge.
  mark(x, y) {
    this._taken[((y / CELL_PX + EDGE) | 0) * this._columns + ((x / CELL_PX + EDGE) | 0)] = 1;
  }

  free(x, y, w, h) {
    const left = this._column(x), right = this._column(x + w), bottom = this._row(y + h);
    for (let r = this._row(y); r <= bottom; r++) {
      for (let at = r * this._columns + left, end = r * this._columns + right; at <= end; at++) if (this._taken[at]) return false;
    }
    return true;
  }

  take(x, y, w, h) {
    const left = this._column(x), right = this._column(x + w), bottom = this._row(y + h);
    for (let r = this._row(y); r <= bottom; r++) this._taken.fill(1, r * this._columns + left, r * this._columns + right + 1);
  }
}
