// The map on the screen: three canvases above each other, and the one place that decides when something is drawn.
//
// Base map, traffic (WebGL2, or the 2D canvas where there is none), and an overlay with labels and marks. Nothing is drawn
// unless a frame came, the view or a setting changed, or an aircraft has moved by most of a pixel since.

import { BaseLayer } from "./base_layer.js";
import { TrafficColours, rgb, themeColours } from "./colours.js";
import { FILTER_SETTINGS, makeFilter } from "./filters.js";
import { Labels } from "./labels.js";
import { drawMarks } from "./marks.js";
import { siteBoxes } from "./sites.js";
import { Symbols } from "./symbols.js";
import { FlatSymbols } from "./symbols_flat.js";
import { Traffic } from "./traffic.js";
import { Trails } from "./trails.js";

const STEP_PX = 0.7; // movement worth a new picture
const STEP_MIN_MS = 66;
const QUICK_MS = 12; // a base map that took longer is only shifted while the map is moved
const PLACE_MS = 900; // between two placings of the labels while only aircraft move
const FAR_PX = 1e6; // a reference farther off than this costs precision
const TIMES = 240; // drawing times kept
const FEW = 300; // aircraft that may all have a trail without being asked for it

export class Stage {
  constructor(view, settings, canvases) {
    this._view = view;
    this._settings = settings;
    this.settings = settings;
    this._canvases = canvases;
    this.colours = themeColours();
    this._trafficColours = new TrafficColours();
    this.traffic = new Traffic(settings, this._trafficColours);
    this._overlay = canvases.overlay.getContext("2d");
    this.base = new BaseLayer(canvases.base, view, settings, this.colours);
    this.labels = new Labels(this._overlay, settings);
    this.sensors = [];
    this.hover = -1; // row under the pointer
    this.ruler = null; // {lat, lon}: distances from here
    this.elementOverlay = null; // draws the selected aircraft's elements on the map
    this.times = [];
    this.parts = {}; // what the newest drawing cost, ms by part
    this.draws = 0;
    this._dirty = { base: true, style: true, labels: true, upload: true };
    this._baseMs = 0;
    this._took = 0;
    this._asked = false;
    this._placedAt = 0;
    this._onDrawn = () => {};
    this._graphics();
    settings.onChange((changed) => this._settingsChanged(changed));
    this.retheme();
  }

  _graphics() {
    const gl = this._canvases.traffic.getContext("webgl2", { alpha: true, antialias: false, premultipliedAlpha: true, powerPreference: "low-power" });
    this.webgl = Boolean(gl);
    this._gl = gl;
    if (gl) {
      this._programs();
      this._canvases.traffic.addEventListener("webglcontextlost", (event) => event.preventDefault());
      this._canvases.traffic.addEventListener("webglcontextrestored", () => {
        this._programs();
        this.invalidate("upload");
      });
    } else {
      this._symbols = new FlatSymbols(this._canvases.traffic.getContext("2d"));
      this.trails = new Trails(null);
    }
  }

  // What a new context of the graphics card begins with.
  _programs() {
    const gl = this._gl;
    this._symbols = new Symbols(gl);
    this.trails = new Trails(gl);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  // Whether something has changed that is not drawn yet; that aircraft move is no change.
  get waiting() {
    return Object.values(this._dirty).some(Boolean);
  }

  onDrawn(listener) {
    this._onDrawn = listener;
  }

  // -- what has changed ----------------------------------------------------------------------------------------------
  take(frame, now) {
    this.traffic.take(frame, now);
    this.parts.take = performance.now() - now;
    this._took += this.parts.take;
    this.hover = -1;
    this.invalidate("style", "labels", "upload");
  }

  setSensors(sensors) {
    this.sensors = sensors;
    this.base.sensors = sensors;
    this.traffic.setSensors(sensors);
    this.invalidate("base", "style");
  }

  retheme() {
    const dark = this._settings.theme === "dark" || (this._settings.theme === "auto" && !matchMedia("(prefers-color-scheme: light)").matches);
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    Object.assign(this.colours, themeColours());
    this._trafficColours.choose(this._settings.color, this.colours);
    this.invalidate("base", "style", "labels");
  }

  legend() {
    return this._trafficColours.legend();
  }

  _settingsChanged(changed) {
    const some = (...names) => names.some((name) => changed.has(name));
    if (some("theme", "color")) this.retheme();
    if (some(...FILTER_SETTINGS, "sel")) this.invalidate("style", "labels");
    if (some("land", "borders", "grid", "rings", "ringstep")) this.invalidate("base");
    if (some("trail", "trailtime", "sel")) this.trails.hurry();
    this.invalidate("labels");
  }

  viewChanged() {
    this.invalidate("base", "labels");
  }

  invalidate(...parts) {
    for (const part of parts) this._dirty[part] = true;
    if (this._asked) return;
    this._asked = true;
    requestAnimationFrame(() => this._draw());
  }

  resize(width, height) {
    this.ratio = Math.min(devicePixelRatio || 1, 2);
    for (const canvas of Object.values(this._canvases)) {
      canvas.width = Math.round(width * this.ratio);
      canvas.height = Math.round(height * this.ratio);
    }
    this._view.resize(width, height);
    this.invalidate("base", "labels");
  }

  // -- drawing -------------------------------------------------------------------------------------------------------
  _draw() {
    this._asked = false;
    const began = performance.now();
    const moved = this.traffic.moved(began);
    const part = (name, work) => {
      const start = performance.now();
      work();
      this.parts[name] = performance.now() - start;
    };
    if (this._dirty.base) part("base", () => this._drawBase());
    if (this._dirty.style) part("style", () => this._restyle());
    part("traffic", () => this._drawTraffic(moved));
    part("project", () => this.traffic.project(this._view, moved));
    part("overlay", () => this._drawOverlay(began));
    this._dirty = { base: this._dirty.again ?? false, style: false, labels: false, upload: false };
    // What it took to take the frame over belongs to drawing it.
    const spent = performance.now() - began + this._took;
    this._took = 0;
    this.times.push(spent);
    if (this.times.length > TIMES) this.times.shift();
    this.draws += 1;
    this._onDrawn(began);
    this._nextStep(moved);
  }

  _drawBase() {
    const began = performance.now();
    this.base.draw(this.ratio, this._view.moving && this._baseMs > QUICK_MS);
    this._baseMs = 0.7 * this._baseMs + 0.3 * (performance.now() - began);
  }

  _restyle() {
    this.traffic.style(makeFilter(this._settings, this.sensors));
    this._dirty.upload = true;
  }

  _drawTraffic(moved) {
    const view = this._view, traffic = this.traffic, gl = this._gl;
    const far = Math.hypot(traffic.reference.x - view.cx, traffic.reference.y - view.cy) * view.scale > FAR_PX;
    if (this._dirty.upload || far) {
      this._symbols.upload(traffic, { x: view.cx, y: view.cy });
    }
    const palette = this._trafficColours;
    if (gl) {
      gl.viewport(0, 0, gl.drawingBufferWidth, gl.drawingBufferHeight);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT);
      const numbers = this.trailNumbers();
      if (numbers?.size !== 0) {
        this.trails.upload(traffic, numbers, moved);
        this.trails.draw(view, rgb(this.colours.trail));
      }
      this._symbols.drawVectors(view, traffic, moved, palette.palette, this._settings.vector);
      this._symbols.draw(view, traffic, moved, palette.palette, this.ratio);
    } else {
      this._symbols.draw(view, traffic, moved, palette.texts, this.ratio, this._settings.vector);
    }
  }

  _drawOverlay(now) {
    const context = this._overlay, view = this._view;
    const marked = this.selectedRows();
    if (this.hover >= 0) marked.add(this.hover);
    if (this._dirty.labels || now - this._placedAt > PLACE_MS) {
      const start = performance.now();
      this.labels.place(this.traffic, view, marked, siteBoxes(view, this.sensors));
      this._placedAt = now;
      this.parts.place = performance.now() - start;
    }
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.clearRect(0, 0, view.width, view.height);
    this.elementOverlay?.(context, view, this.colours);
    drawMarks(context, this, view, this.colours);
    this.labels.draw(this.traffic, this.colours, this._trafficColours.texts);
  }

  // Draw again when the fastest aircraft in view will have moved by most of a pixel.
  _nextStep() {
    clearTimeout(this._stepTimer);
    if (!this._settings.smooth || !this.traffic.frame.playing || document.hidden) return;
    const drawing = median(this.times.slice(-20));
    const pixelsPerSecond = this.traffic.fastestInView(this._view) * this.traffic.frame.pace;
    if (pixelsPerSecond < STEP_PX) return;
    const wait = Math.max((STEP_PX / pixelsPerSecond) * 1000, STEP_MIN_MS, drawing * 6);
    if (wait < 1000) this._stepTimer = setTimeout(() => this.invalidate(), wait);
  }

  // The numbers of those whose trails are shown, null for all.
  trailNumbers() {
    const wanted = this._settings.trail, auto = this.traffic.frame.total <= FEW ? "all" : "selected";
    const which = wanted === "auto" ? auto : wanted;
    return which === "all" ? null : which === "selected" ? this.selectedNumbers() : new Set();
  }

  // -- selection -----------------------------------------------------------------------------------------------------
  selectedRows() {
    const rows = new Set();
    for (const label of this._settings.selected) {
      const row = this.traffic.frame.find(label);
      if (row >= 0) rows.add(row);
    }
    return rows;
  }

  selectedNumbers() {
    return new Set([...this.selectedRows()].map((row) => this.traffic.frame.number(row)));
  }

  // The aircraft or label under a point of the screen, -1 where there is none.
  pick(px, py) {
    const row = this.traffic.nearest(px, py, 14);
    return row >= 0 ? row : this.labels.at(this.traffic, px, py);
  }

  medianDraw() {
    return median(this.times);
  }
}

function median(values) {
  if (values.length === 0) return 0;
  const sorted = [...values].sort((a, b) => a - b);
  return sorted[sorted.length >> 1];
}
