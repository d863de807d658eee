// The map under the traffic: land, coast, borders, grid, the user's layers, radar sites with their rings, and the scale.
//
// It changes only when the view or a setting does, so it has a canvas of its own and costs nothing while aircraft move.
// Drawn with the 2D canvas, which fills land; while the map is being moved a coarser level keeps it quick.

import { ask } from "./asking.js";
import { drawGrid } from "./grid.js";
import { drawUserLayers } from "./geojson.js";
import { BORDER, COAST, levelFor, readMap } from "./map_file.js";
import { drawSites } from "./sites.js";

export class BaseLayer {
  constructor(canvas, view, settings, colours) {
    this._canvas = canvas;
    this._context = canvas.getContext("2d", { alpha: false });
    this._view = view;
    this._settings = settings;
    this._colours = colours;
    this._map = null;
    this.sensors = [];
    this.userLayers = [];
    this.arcs = 0; // arcs drawn last, for tests
  }

  async load(url) {
    const response = await ask(url);
    if (!response.ok) throw new Error(`the map cannot be loaded: ${response.status}`);
    this._map = readMap(await response.arrayBuffer());
  }

  draw(ratio, hurried) {
    const context = this._context, view = this._view, colours = this._colours;
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = colours.sea;
    context.fillRect(0, 0, view.width, view.height);
    if (this._map) this._drawMap(context, hurried);
    if (this._settings.grid) drawGrid(context, view, colours);
    drawUserLayers(context, view, this.userLayers, colours);
    drawSites(context, view, this.sensors, this._settings, colours);
  }

  _drawMap(context, hurried) {
    const view = this._view, settings = this._settings;
    const level = Math.max(0, levelFor(view.scale) - (hurried ? 1 : 0));
    const copies = worldCopies(view);
    if (settings.land) {
      context.beginPath();
      for (const shift of copies) this._traceLand(context, level, shift);
      context.fillStyle = this._colours.land;
      context.fill("evenodd");
    }
    this.arcs = 0;
    this._stroke(context, COAST, level, copies, this._colours.coast, 1);
    if (settings.borders) this._stroke(context, BORDER, level, copies, this._colours.border, 1);
  }

  _traceLand(context, level, shift) {
    const place = placer(this._view, shift);
    for (const ring of this._map.rings) {
      if (!place.sees(ring.box)) continue;
      let first = true;
      for (const { arc, reversed } of ring.parts) {
        const n = arc.x.length;
        for (let k = 0; k < n; k++) {
          const i = reversed ? n - 1 - k : k;
          if (arc.level[i] > level) continue;
          if (first) context.moveTo(place.x(arc.x[i]), place.y(arc.y[i]));
          else context.lineTo(place.x(arc.x[i]), place.y(arc.y[i]));
          first = false;
        }
      }
      context.closePath();
    }
  }

  _stroke(context, kind, level, copies, colour, width) {
    context.beginPath();
    for (const shift of copies) {
      const place = placer(this._view, shift);
      for (const arc of this._map.arcs) {
        if (arc.kind !== kind || !place.sees(arc.box)) continue;
        this.arcs += 1;
        let pen = false, cut = false;
        for (let i = 0; i < arc.x.length; i++) {
          cut ||= arc.cut[i] === 1;
          if (arc.level[i] > level) continue;
          if (pen && !cut) context.lineTo(place.x(arc.x[i]), place.y(arc.y[i]));
          else context.moveTo(place.x(arc.x[i]), place.y(arc.y[i]));
          pen = true;
          cut = false;
        }
      }
    }
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.lineJoin = "round";
    context.stroke();
  }
}

// The shifts by whole worlds under which something may be in view: near the antimeridian there are two.
export function worldCopies(view) {
  const half = view.width / 2 / view.scale;
  const copies = [];
  for (let shift = Math.floor(view.cx - half); shift <= Math.floor(view.cx + half); shift++) copies.push(shift);
  return copies;
}

function placer(view, shift) {
  const { cx, cy, scale, width, height } = view;
  const halfX = width / 2 / scale, halfY = height / 2 / scale;
  return {
    x: (x) => (x + shift - cx) * scale + width / 2,
    y: (y) => (y - cy) * scale + height / 2,
    sees: (box) => box[2] + shift > cx - halfX && box[0] + shift < cx + halfX && box[3] > cy - halfY && box[1] < cy + halfY,
  };
}
