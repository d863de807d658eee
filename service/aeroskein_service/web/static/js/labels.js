// Data blocks beside the symbols, with leader lines, placed so that they cover neither symbols nor each other.
//
// Greedy, most important first: selected, emergency, then those that had a place before, so that labels do not jump. A
// block that finds no free place of sixteen is left out; the symbol never is. An emergency is always written.

import { knots, level, speed, trend } from "./format.js";

const FONT = "12px ui-monospace, 'DejaVu Sans Mono', Menlo, Consolas, monospace";
const CHAR_PX = 7.23; // of that font
const LINE_PX = 14;
const NEAR_PX = 14; // from the symbol to the block
const FAR_PX = 44;
const CELL_PX = 24; // of the raster that finds free places
// Directions tried: right up first, as controllers are used to.
const AROUND = [[1, -1], [1, 1], [-1, -1], [-1, 1], [1, 0], [-1, 0], [0, -1], [0, 1]];
// Near the symbol, then farther off with a longer leader line. [side, up or down, px]
const DIRECTIONS = [NEAR_PX, FAR_PX].flatMap((away) => AROUND.map(([h, v]) => [h, v, away]));
const EMERGENCY_WORDS = { 0o7500: "HIJACK", 0o7600: "RADIO", 0o7700: "EMERGENCY" };

export class Labels {
  constructor(context, settings) {
    this._context = context;
    this._settings = settings;
    this._places = new Map(); // direction by track number, kept from one placing to the next
    this._placed = [];
    this.drawn = 0;
    this.wanted = 0;
  }

  // Find places for the labels of this frame. `marked` are rows that come first.
  place(traffic, view, moved, marked) {
    const settings = this._settings, frame = traffic.frame;
    const rows = [];
    for (let i = 0; i < frame.count; i++) {
      const first = marked.has(i) || frame.emergency(i);
      if (!first && (settings.labels === 0 || !traffic.passes[i])) continue;
      const [mx, my] = traffic.at(i, moved);
      const x = view.screenX(mx), y = view.screenY(my);
      if (x < -20 || y < -20 || x > view.width + 20 || y > view.height + 20) continue;
      rows.push({ i, x, y, rank: marked.has(i) ? 0 : frame.emergency(i) ? 1 : this._places.has(frame.number(i)) ? 2 : 3 });
    }
    this.wanted = rows.length;
    rows.sort((a, b) => a.rank - b.rank || frame.number(a.i) - frame.number(b.i));
    const raster = new Raster(view.width, view.height);
    for (const row of rows) raster.take(row.x - 5, row.y - 5, 10, 10);
    this._placed = [];
    const places = new Map();
    for (const row of rows) {
      if (this._placed.length >= settings.density && row.rank > 1) break;
      const block = this._block(traffic, row, raster);
      if (!block) continue;
      places.set(frame.number(row.i), block.direction);
      this._placed.push(block);
    }
    this._places = places;
  }

  _block(traffic, row, raster) {
    const lines = dataBlock(traffic.frame, row.i, row.rank === 0 ? 2 : Math.max(this._settings.labels, row.rank === 1 ? 2 : 0), this._settings);
    const width = Math.max(...lines.map((line) => line.length)) * CHAR_PX, height = lines.length * LINE_PX;
    const before = this._places.get(traffic.frame.number(row.i));
    const order = before === undefined ? DIRECTIONS.keys() : [before, ...DIRECTIONS.keys()];
    for (const direction of order) {
      const offset = blockOffset(direction, width, height);
      if (raster.free(row.x + offset.x, row.y + offset.y, width, height)) {
        raster.take(row.x + offset.x, row.y + offset.y, width, height);
        return { i: row.i, lines, width, height, direction, rank: row.rank };
      }
    }
    if (row.rank > 1) return null;
    return { i: row.i, lines, width, height, direction: 0, rank: row.rank };
  }

  draw(traffic, view, moved, colours, palette) {
    const context = this._context, frame = traffic.frame;
    context.font = FONT;
    context.textBaseline = "top";
    this.drawn = 0;
    for (const block of this._placed) {
      if (block.i >= frame.count) continue;
      const [mx, my] = traffic.at(block.i, moved);
      const x = view.screenX(mx), y = view.screenY(my);
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
      context.lineWidth = 3;
      context.strokeStyle = colours.halo;
      context.fillStyle = ink;
      context.lineJoin = "round";
      block.lines.forEach((line, k) => {
        context.strokeText(line, left, top + k * LINE_PX);
        context.fillText(line, left, top + k * LINE_PX);
      });
      this.drawn += 1;
    }
    context.textBaseline = "alphabetic";
  }

  // The row whose label lies under a point of the screen, -1 where there is none.
  at(traffic, view, moved, px, py) {
    for (const block of this._placed) {
      const [mx, my] = traffic.at(block.i, moved);
      const offset = blockOffset(block.direction, block.width, block.height);
      const left = view.screenX(mx) + offset.x, top = view.screenY(my) + offset.y;
      if (px >= left && px <= left + block.width && py >= top && py <= top + block.height) return block.i;
    }
    return -1;
  }
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
    this._columns = Math.ceil(width / CELL_PX) + 2;
    this._rows = Math.ceil(height / CELL_PX) + 2;
    this._boxes = Array.from({ length: this._columns * this._rows }, () => null);
  }

  *_cells(x, y, w, h) {
    const left = Math.max(0, Math.floor(x / CELL_PX) + 1), right = Math.min(this._columns - 1, Math.floor((x + w) / CELL_PX) + 1);
    const top = Math.max(0, Math.floor(y / CELL_PX) + 1), bottom = Math.min(this._rows - 1, Math.floor((y + h) / CELL_PX) + 1);
    for (let r = top; r <= bottom; r++) for (let c = left; c <= right; c++) yield r * this._columns + c;
  }

  free(x, y, w, h) {
    for (const cell of this._cells(x, y, w, h)) {
      const boxes = this._boxes[cell];
      if (boxes && boxes.some((b) => x < b[0] + b[2] && x + w > b[0] && y < b[1] + b[3] && y + h > b[1])) return false;
    }
    return true;
  }

  take(x, y, w, h) {
    const box = [x, y, w, h];
    for (const cell of this._cells(x, y, w, h)) (this._boxes[cell] ??= []).push(box);
  }
}
