// The drawing of the element view: what the method does with one aircraft's reports, as geometry.
//
// From back to front: boundary lines, the element that is chosen, division points, the master track's axis, reports by
// sensor (refused ones crossed out), fused points with their ellipses, what is not closed yet, the live state. `emphasis`
// names one of these; the others are then drawn faintly.

import { drawBadges } from "./elements_badges.js";
import { ellipseOutline } from "./elements_data.js";
import { fitCanvas } from "./dom.js";
import { clock, metres, reason } from "./format.js";

const REPORT_PX = 3.6;
const NEAR_PX = 12;
const FAINT = 0.18;
const SIGMAS = 1;

export class ElementsCanvas {
  constructor(canvas, view) {
    this.canvas = canvas;
    this.view = view;
    this.drawn = {};
    this._things = [];
  }

  draw(scene, { colours, sensorColour, emphasis, chosen }) {
    const { context, width, height } = fitCanvas(this.canvas);
    this._c = context;
    this._colours = colours;
    this._sensorColour = sensorColour;
    this._emphasis = emphasis;
    this._things = [];
    this.drawn = { elements: 0, divisions: 0, boundaries: 0, accepted: 0, rejected: 0, points: 0, ellipses: 0, waiting: 0, live: 0, badges: 0 };
    if (!scene) return;
    this.view.fit(scene, width, height);
    this._scales(scene);
    context.save();
    context.beginPath();
    const box = this.view.box;
    context.rect(this.view.strip ? box.left : 0, 0, width, height);
    context.clip();
    for (const element of scene.elements) this._area(element, element.index === chosen);
    for (const element of scene.elements) this._boundaries(element);
    for (const element of scene.elements) this._axis(element);
    this._ahead(scene);
    this._divisions(scene.elements, box);
    for (const element of scene.elements) for (const report of element.reports) this._report(report, element);
    for (const report of scene.waiting) this._waiting(report);
    for (const element of scene.elements) this._point(element);
    this._live(scene);
    context.restore();
    this.drawn.badges = drawBadges(context, scene, this.view, chosen, colours, (kind) => this._faint(kind));
  }

  _faint(kind) {
    this._c.globalAlpha = this._emphasis && this._emphasis !== kind ? FAINT : 1;
  }

  _line(points) {
    this._c.beginPath();
    points.forEach(([x, y], k) => (k ? this._c.lineTo(x, y) : this._c.moveTo(x, y)));
    this._c.stroke();
  }

  // -- scales --------------------------------------------------------------------------------------------------------
  _scales() {
    const c = this._c, view = this.view, { left, right, bottom } = view.box;
    c.font = "11px system-ui, sans-serif";
    c.fillStyle = this._colours.faint;
    c.strokeStyle = this._colours.grid;
    c.lineWidth = 1;
    if (view.strip) {
      c.textAlign = "right";
      for (const v of view.ticks()) {
        this._line([[left, view.y(v)], [right, view.y(v)]]);
        c.fillText(v ? `${v > 0 ? "+" : "−"}${Math.abs(v)} m` : "axis", left - 6, view.y(v) + 4);
      }
      c.textAlign = "left";
      c.fillText("left of the flight ↑   across the master track, scale stretched near it   ↓ right", left, 14);
    }
    const length = roundLength(view.metresPerPixel * 110);
    const px = length / view.metresPerPixel;
    c.strokeStyle = this._colours.faint;
    this._line([[right - px, bottom + 16], [right - px, bottom + 21], [right, bottom + 21], [right, bottom + 16]]);
    c.textAlign = "right";
    c.fillText(`${length >= 1000 ? `${length / 1000} km` : `${length} m`}${view.strip ? " along" : ""}`, right - px - 6, bottom + 22);
    c.textAlign = "left";
  }

  // -- the element ---------------------------------------------------------------------------------------------------
  _area(element, chosen) {
    if (!chosen || !Number.isFinite(element.halfWidth)) return;
    const c = this._c;
    const outline = this.view.strip
      ? [[element.start, 1], [element.end, 1], [element.end, -1], [element.start, -1]].map(([s, side]) => [this.view.x(s), this.view.y(side * element.halfWidth)])
      : [...element.boundaries[0], ...[...element.boundaries[1]].reverse()].map((p) => this.view.place(p));
    c.globalAlpha = 0.14;
    c.fillStyle = this._colours.selected;
    c.beginPath();
    outline.forEach(([x, y], k) => (k ? c.lineTo(x, y) : c.moveTo(x, y)));
    c.fill();
    c.globalAlpha = 1;
  }

  _boundaries(element) {
    if (!Number.isFinite(element.halfWidth)) return;
    const c = this._c, view = this.view;
    this._faint("boundaries");
    c.strokeStyle = this._colours.boundary;
    c.lineWidth = 1.2;
    c.setLineDash([7, 4]);
    if (view.strip) {
      for (const side of [1, -1]) this._line([[view.x(element.start), view.y(side * element.halfWidth)], [view.x(element.end), view.y(side * element.halfWidth)]]);
    } else {
      for (const side of element.boundaries) this._line(side.map((p) => view.place(p)));
    }
    c.setLineDash([]);
    this.drawn.boundaries += 2;
    this.drawn.elements += 1;
  }

  _axis(element) {
    const view = this.view;
    this._faint("axis");
    this._c.strokeStyle = element.master ? this._sensorColour(element.master) : this._colours.axis;
    this._c.lineWidth = 2.2;
    this._line(view.strip ? [[view.x(element.start), view.y(0)], [view.x(element.end), view.y(0)]] : element.line.axis.map((p) => view.place(p)));
  }

  _divisions(elements, box) {
    const c = this._c, view = this.view;
    this._faint("divisions");
    c.strokeStyle = c.fillStyle = this._colours.division;
    c.lineWidth = 1;
    c.font = "11px ui-monospace, 'DejaVu Sans Mono', monospace";
    elements.forEach((element, k) => {
      const ends = k === elements.length - 1 ? [0, -1] : [0];
      for (const end of ends) {
        const along = end === 0 ? element.start : element.end;
        const [x, y] = view.strip ? [view.x(along), view.y(0)] : view.place(element.line.axis.at(end));
        if (view.strip) {
          c.setLineDash([3, 4]);
          this._line([[x, box.top], [x, box.bottom]]);
          c.setLineDash([]);
        }
        c.fillRect(x - 4, y - 4, 8, 8);
        this.drawn.divisions += 1;
      }
      if (view.strip && view.x(element.end) - view.x(element.start) > 74) {
        c.textAlign = "center";
        c.fillText(`element ${element.index}`, (view.x(element.start) + view.x(element.end)) / 2, box.bottom + 13);
        c.textAlign = "left";
      }
      this._things.push({ kind: "element", element, along: (element.start + element.end) / 2 });
    });
  }

  // -- reports and points --------------------------------------------------------------------------------------------
  _report(report, element) {
    const c = this._c, [x, y] = this.view.of(report);
    this._faint(report.accepted ? "reports" : "rejected");
    c.fillStyle = c.strokeStyle = this._sensorColour(report.sensor);
    c.lineWidth = 1.4;
    c.beginPath();
    c.arc(x, y, REPORT_PX, 0, 2 * Math.PI);
    if (report.accepted) {
      c.fill();
      this.drawn.accepted += 1;
    } else {
      c.stroke();
      c.strokeStyle = this._colours.rejected;
      this._line([[x - 6, y - 6], [x + 6, y + 6]]);
      this._line([[x - 6, y + 6], [x + 6, y - 6]]);
      this.drawn.rejected += 1;
    }
    this._things.push({ kind: "report", report, element, x, y });
  }

  _waiting(report) {
    const c = this._c, [x, y] = this.view.of(report);
    this._faint("waiting");
    c.strokeStyle = this._sensorColour(report.sensor);
    c.lineWidth = 1.4;
    c.beginPath();
    c.arc(x, y, REPORT_PX, 0, 2 * Math.PI);
    c.stroke();
    this.drawn.waiting += 1;
    this._things.push({ kind: "waiting", report, x, y });
  }

  _ellipse(thing, colour, k) {
    if (!thing.ellipse) return;
    const c = this._c, view = this.view;
    const outline = ellipseOutline(thing.ellipse, view.strip ? "strip" : "plan", k).map(([u, v]) =>
      view.strip ? [view.x(thing.along + u), view.y(thing.across + v)] : view.place([thing.at[0] + u, thing.at[1] + v]));
    c.strokeStyle = c.fillStyle = colour;
    c.lineWidth = 1.4;
    c.beginPath();
    outline.forEach(([x, y], i) => (i ? c.lineTo(x, y) : c.moveTo(x, y)));
    const alpha = c.globalAlpha;
    c.globalAlpha = alpha * 0.25;
    c.fill();
    c.globalAlpha = alpha;
    c.stroke();
    // Where the drawing is too coarse for the ellipse itself, its extent across is still seen as a bar.
    if (view.strip) {
      const reach = Math.max(...ellipseOutline(thing.ellipse, "strip", k).map(([, v]) => v));
      const x = view.x(thing.along), top = view.y(thing.across + reach), bottom = view.y(thing.across - reach);
      this._line([[x, top], [x, bottom]]);
      this._line([[x - 5, top], [x + 5, top]]);
      this._line([[x - 5, bottom], [x + 5, bottom]]);
    }
    this.drawn.ellipses += 1;
  }

  _point(element) {
    if (!element.point) return;
    const c = this._c, [x, y] = this.view.of(element.point);
    this._faint("points");
    this._ellipse(element.point, this._colours.ellipse, SIGMAS);
    c.fillStyle = this._colours.ellipse;
    diamond(c, x, y, 5.5);
    c.fill();
    this.drawn.points += 1;
    this._things.push({ kind: "point", element, x, y });
  }

  _ahead(scene) {
    const view = this.view;
    if (scene.ahead.length < 2 || !scene.live) return;
    this._faint("live");
    this._c.strokeStyle = this._colours.trail;
    this._c.lineWidth = 1.4;
    this._c.setLineDash([2, 4]);
    this._line(view.strip ? [[view.x(0), view.y(0)], [view.x(scene.live.along), view.y(scene.live.across)]] : scene.ahead.map((p) => view.place(p)));
    this._c.setLineDash([]);
  }

  _live(scene) {
    if (!scene.live) return;
    const c = this._c, [x, y] = this.view.of(scene.live);
    this._faint("live");
    this._ellipse(scene.live, this._colours.axis, SIGMAS);
    c.strokeStyle = c.fillStyle = this._colours.axis;
    c.lineWidth = 2;
    // Along the flight: to the right in the strip, by its track angle in the plan.
    const turn = this.view.strip ? 0 : (((scene.live.track_angle_deg ?? 90) - 90) * Math.PI) / 180;
    c.beginPath();
    for (const [u, v] of [[9, 0], [-6, -6], [-2, 0], [-6, 6]]) c.lineTo(x + u * Math.cos(turn) - v * Math.sin(turn), y + u * Math.sin(turn) + v * Math.cos(turn));
    c.closePath();
    c.fill();
    this.drawn.live = 1;
    this._things.push({ kind: "live", live: scene.live, x, y });
    c.globalAlpha = 1;
  }

  // -- what lies under the pointer -----------------------------------------------------------------------------------
  at(px, py) {
    let best = null, least = NEAR_PX * NEAR_PX;
    for (const thing of this._things) {
      if (thing.kind === "element") continue;
      const d = (thing.x - px) ** 2 + (thing.y - py) ** 2;
      if (d < least) {
        least = d;
        best = thing;
      }
    }
    if (best || !this.view.strip) return best;
    return this._things.find((t) => t.kind === "element" && px >= this.view.x(t.element.start) && px < this.view.x(t.element.end)) ?? null;
  }
}

// A sentence about a thing in the drawing.
export function describe(thing) {
  if (!thing) return "";
  const side = (across) => `${metres(Math.abs(across), Math.abs(across) < 10 ? 1 : 0)} ${across >= 0 ? "left" : "right"} of the axis`;
  if (thing.kind === "report") {
    const r = thing.report;
    return `${r.sensor}, ${clock(r.time_s, 1)}: ${side(r.across)}, ${metres(Math.abs(r.residual.along), 0)} ${r.residual.along >= 0 ? "ahead" : "behind"} – ${r.accepted ? `accepted in element ${thing.element.index}` : `refused: ${reason(r.reason)}`}`;
  }
  if (thing.kind === "waiting") return `${thing.report.sensor}, ${clock(thing.report.time_s, 1)}: waits until its element is closed; the live state has used it already`;
  if (thing.kind === "point") {
    const p = thing.element.point;
    const size = p.ellipse ? `, one sigma ${p.ellipse.major.toFixed(1)} m × ${p.ellipse.minor.toFixed(1)} m` : "";
    return `fused point of element ${thing.element.index}, ${clock(p.time_s, 1)}: ${side(p.across)}${size}`;
  }
  if (thing.kind === "live") {
    const l = thing.live;
    return `live state at ${clock(l.time_s, 1)}${l.ellipse ? `, one sigma ${l.ellipse.major.toFixed(1)} m × ${l.ellipse.minor.toFixed(1)} m` : ""}`;
  }
  const e = thing.element;
  const accepted = e.reports.filter((r) => r.accepted).length;
  return `element ${e.index}: ${clock(e.span[0], 1)} to ${clock(e.span[1], 1)}, master ${e.master ?? "none"}, ${accepted} accepted, ${e.reports.length - accepted} refused`;
}

function diamond(c, x, y, r) {
  c.beginPath();
  for (const [dx, dy] of [[0, -r], [r, 0], [0, r], [-r, 0]]) c.lineTo(x + dx, y + dy);
  c.closePath();
}

function roundLength(m) {
  const power = 10 ** Math.floor(Math.log10(m));
  return ([5, 2, 1].find((k) => k * power <= m) ?? 1) * power;
}
