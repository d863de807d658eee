// The frame of the element drawing: from metres to pixels and back, for the strip (stretched across) and the plan.

const LEFT = 56, RIGHT = 24, TOP = 26, BOTTOM = 30; // px
const STRETCH_M = 12; // across the axis: about even up to here, then ever closer together
const WINDOW_ELEMENTS = 7; // shown at first in the strip, besides what is ahead of them
const PLAN_ELEMENTS = 3; // the same in the plan

export class ElementsView {
  constructor() {
    this.frame = "strip";
    this.reset();
  }

  reset() {
    this.zoom = 1;
    this.pan = 0; // metres along, in the strip
    this.offset = [0, 0]; // metres, in the plan
  }

  // Fit the scene to the canvas.
  fit(scene, width, height) {
    this.width = width;
    this.height = height;
    const { elements, live, waiting } = scene;
    const first = elements.at(-WINDOW_ELEMENTS) ?? elements[0];
    const begin = first ? first.start : -100, end = Math.max(live?.along ?? 0, 100);
    const middle = (begin + end) / 2 + this.pan, half = ((end - begin) / 2) * 1.06 / this.zoom;
    this._along = [middle - half, middle + half];
    let widest = 60;
    for (const element of elements) {
      if (element.end < begin) continue;
      widest = Math.max(widest, element.halfWidth || 0, ...element.reports.map((r) => Math.abs(r.across)));
    }
    for (const report of waiting) widest = Math.max(widest, Math.abs(report.across));
    this._widest = widest * 1.12;
    const shown = [...elements.slice(-PLAN_ELEMENTS).flatMap((e) => e.line.axis), ...(live ? [live.at] : [])];
    const xs = shown.map((p) => p[0]), ys = shown.map((p) => p[1]);
    const span = Math.max(Math.max(...xs) - Math.min(...xs), (Math.max(...ys) - Math.min(...ys)) * (width / Math.max(height, 1)), 400);
    this._centre = [(Math.max(...xs) + Math.min(...xs)) / 2 + this.offset[0], (Math.max(...ys) + Math.min(...ys)) / 2 + this.offset[1]];
    this._scale = ((width * 0.8) / span) * this.zoom;
  }

  get strip() {
    return this.frame === "strip";
  }

  // Pixels of a thing that has `along`, `across` and `at`.
  of(thing) {
    return this.strip ? [this.x(thing.along), this.y(thing.across)] : this.place(thing.at);
  }

  place([x, y]) {
    return [this.width / 2 + (x - this._centre[0]) * this._scale, this.height / 2 - (y - this._centre[1]) * this._scale];
  }

  x(along) {
    const [a, b] = this._along;
    return LEFT + ((along - a) / (b - a)) * (this.width - LEFT - RIGHT);
  }

  y(across) {
    const half = (this.height - TOP - BOTTOM) / 2;
    return TOP + half - (half * Math.asinh(across / STRETCH_M)) / Math.asinh(this._widest / STRETCH_M);
  }

  get metresPerPixel() {
    return this.strip ? (this._along[1] - this._along[0]) / (this.width - LEFT - RIGHT) : 1 / this._scale;
  }

  get box() {
    return { left: LEFT, right: this.width - RIGHT, top: TOP, bottom: this.height - BOTTOM };
  }

  // Round distances across that have room on the scale.
  ticks() {
    return [0, 10, 30, 100, 300, 1000, 3000].filter((v) => v < this._widest && (v === 0 || this.y(0) - this.y(v) > 14)).flatMap((v) => (v ? [v, -v] : [0]));
  }

  drag(dx, dy) {
    if (this.strip) this.pan -= dx * this.metresPerPixel;
    else this.offset = [this.offset[0] - dx * this.metresPerPixel, this.offset[1] + dy * this.metresPerPixel];
  }

  zoomBy(factor) {
    this.zoom = Math.max(0.25, Math.min(60, this.zoom * factor));
  }
}
