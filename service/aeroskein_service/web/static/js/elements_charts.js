// The charts beside the elements: residuals of each sensor, altitude, speed, and which sensor was the master.

import { drawChart } from "./charts.js";
import { fitCanvas, h } from "./dom.js";
import { clock, feet, knots } from "./format.js";

const HEIGHTS = { across: 104, along: 104, altitude: 84, speed: 84, master: 44 };

export class ElementsCharts {
  constructor(element, settings) {
    this._settings = settings;
    this._canvases = {};
    this.drawn = {};
    const titles = {
      across: "Residual across the master track [m]", along: "Residual along it [m]", altitude: "Altitude", speed: "Ground speed", master: "Master",
    };
    for (const [name, title] of Object.entries(titles)) {
      this._canvases[name] = h("canvas", { class: "chart", style: { height: `${HEIGHTS[name]}px` }, role: "img", "aria-label": `${title} over time` });
      this._title ??= {};
      this._title[name] = h("h3", {}, title);
      element.append(this._title[name], this._canvases[name]);
    }
  }

  // `scene` of all remembered elements; `trail` is the server's memory of the track before that.
  draw(scene, trail, { colours, sensorColour, sensors, chosen }) {
    const elements = scene?.elements ?? [];
    const first = elements[0]?.span[0] ?? trail?.time_s?.[0], last = scene?.live?.time_s ?? elements.at(-1)?.span[1];
    const times = first === undefined || last === undefined ? null : [Math.max(first, last - 300), last];
    const cursor = elements.find((e) => e.index === chosen)?.point?.time_s ?? null;
    const metric = this._settings.units === "metric";
    this._residual("across", elements, times, cursor, colours, sensorColour, sensors);
    this._residual("along", elements, times, cursor, colours, sensorColour, sensors);
    this._title.altitude.textContent = `Altitude [${metric ? "m" : "ft"}]`;
    this._title.speed.textContent = `Ground speed [${metric ? "m/s" : "kt"}]`;
    this._value("altitude", elements, trail, scene, times, cursor, colours, (p) => p.altitude_m, trail?.altitude_m, metric ? (v) => v : feet);
    this._value("speed", elements, trail, scene, times, cursor, colours, (p) => p.ground_speed_mps, trail?.speed_mps, metric ? (v) => v : knots);
    this._master(elements, trail, times, colours, sensorColour, sensors);
  }

  _residual(name, elements, times, cursor, colours, sensorColour, sensors) {
    const series = [];
    for (const sensor of sensors) {
      for (const accepted of [true, false]) {
        const reports = elements.flatMap((e) => e.reports.filter((r) => r.sensor === sensor.id && r.accepted === accepted));
        series.push({
          x: reports.map((r) => r.time_s), y: reports.map((r) => Math.asinh(r.residual[name] / 10)), colour: accepted ? sensorColour(sensor.id) : colours.rejected, cross: !accepted,
        });
      }
    }
    // Stretched near zero like the drawing, so that metres and kilometres are seen together.
    const most = Math.max(1.5, ...series.flatMap((s) => s.y.map(Math.abs)));
    this.drawn[name] = drawChart(this._canvases[name], colours, {
      series, times, cursor, zero: true, values: [-most * 1.08, most * 1.08], format: (y) => Math.round(10 * Math.sinh(y)).toString(), ticks: [-1000, -300, -100, -30, 0, 30, 100, 300, 1000].map((v) => Math.asinh(v / 10)),
    });
  }

  _value(name, elements, trail, scene, times, cursor, colours, pick, old, unit) {
    const convert = (v) => (v == null || !Number.isFinite(v) ? NaN : unit(v));
    const points = elements.map((e) => e.point).filter(Boolean);
    const begin = points[0]?.time_s ?? Infinity;
    const before = (trail?.time_s ?? []).map((t, k) => [t, convert(old?.[k])]).filter(([t]) => t < begin);
    const series = [{
      x: [...before.map(([t]) => t), ...points.map((p) => p.time_s)], y: [...before.map(([, v]) => v), ...points.map((p) => convert(pick(p)))], colour: colours.ellipse, line: true,
    }];
    if (scene?.live) series.push({ x: [scene.live.time_s], y: [convert(pick(scene.live))], colour: colours.axis });
    // At least this much is shown, so that noise does not look like a manoeuvre.
    const least = name === "altitude" ? 300 : 20;
    const all = series.flatMap((s) => s.y).filter(Number.isFinite);
    const low = Math.min(...all), high = Math.max(...all), spare = Math.max((least - (high - low)) / 2, (high - low) * 0.08);
    this.drawn[name] = drawChart(this._canvases[name], colours, { series, times, cursor, values: all.length ? [low - spare, high + spare] : null, format: (y) => Math.round(y).toString() });
  }

  _master(elements, trail, times, colours, sensorColour, sensors) {
    const { context, width } = fitCanvas(this._canvases.master);
    this.drawn.master = 0;
    if (!times) return;
    const px = (t) => 44 + ((t - times[0]) / Math.max(times[1] - times[0], 1e-9)) * (width - 52);
    const known = new Set(elements.map((e) => e.index));
    const spans = elements.map((e) => [e.span[0], e.span[1], e.master]);
    (trail?.element ?? []).forEach((index, k) => {
      if (!known.has(index)) spans.push([trail.time_s[k] - 2, trail.time_s[k] + 2, sensors[trail.master[k]]?.id ?? null]);
    });
    const names = new Set();
    for (const [start, end, master] of spans) {
      if (end < times[0] || !master) continue;
      context.fillStyle = sensorColour(master);
      const left = Math.max(px(start), 44);
      context.fillRect(left, 6, Math.max(px(end) - left, 1), 14);
      names.add(master);
      this.drawn.master += 1;
    }
    context.font = "11px system-ui, sans-serif";
    let x = 44;
    for (const name of names) {
      context.fillStyle = sensorColour(name);
      context.fillRect(x, 30, 9, 9);
      context.fillStyle = colours.text;
      context.fillText(name, x + 13, 39);
      x += context.measureText(name).width + 30;
    }
    context.fillStyle = colours.faint;
    context.textAlign = "right";
    context.fillText(clock(times[1]), width - 6, 39);
    context.textAlign = "left";
  }
}
