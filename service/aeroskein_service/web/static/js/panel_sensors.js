// Sensors and service: rates, ages, registration with its history, rejects by reason, inbox depth, time of every stage.

import { ask } from "./asking.js";
import { drawChart } from "./charts.js";
import { sensorColour } from "./colours.js";
import { facts, h, panelHead, refill } from "./dom.js";
import * as format from "./format.js";

const HISTORY_MS = 5000;
const STATE_CLASS = { converged: "good", converging: "warn", frozen: "warn", off: "bad" };
const BIASES = [
  ["range_bias_m", "range_bias_sigma_m", "Range bias", " m", 1, 1],
  ["azimuth_bias_deg", "azimuth_bias_sigma_deg", "Azimuth bias", "°", 3, 1],
  ["time_bias_s", "time_bias_sigma_s", "Time bias", " s", 3, 1],
  ["range_gain", "range_gain_sigma", "Range gain", " ppm", 0, 1e6],
];

export class SensorsPanel {
  constructor(element, { stage, state }, close) {
    this._element = element;
    this._stage = stage;
    this._state = state;
    this._close = close;
    this._history = null;
    this._askedAt = -Infinity;
    this._content = h("div", {});
    this._open = new Set(); // sensors whose details are open
  }

  show() {
    this._element.replaceChildren(panelHead("Sensors and service", this._close), this._content);
    this._askedAt = -Infinity;
    this.words(this._state.words);
  }

  async words(words) {
    const now = performance.now();
    if (now - this._askedAt > HISTORY_MS) {
      this._askedAt = now;
      try {
        const response = await ask("/api/history");
        if (response.ok) this._history = await response.json();
      } catch {
        // The banner tells of a lost connection.
      }
    }
    if (words) this._draw(words);
  }

  _draw(words) {
    const service = words.service;
    const parts = [];
    for (const sensor of this._stage.sensors) parts.push(this._sensor(sensor, words));
    refill(this._content, ...parts, ...(service ? this._service(words, service) : [h("p", { class: "dim" }, "The service has not said anything yet.")]));
    this._charts();
  }

  _sensor(sensor, words) {
    const state = words.service?.sensors?.[sensor.id], rates = words.rates?.sensors?.[sensor.id];
    const registration = words.registration?.[sensor.id];
    const age = state?.last_report_s == null ? NaN : words.time_s - state.last_report_s;
    const late = !(age < Math.max(10, 3 * (sensor.period_s ?? 4)));
    const colour = sensorColour(this._stage.sensors, sensor.id, this._stage.colours.dark);
    const refused = Object.entries(state?.rejected ?? {}).sort((a, b) => b[1] - a[1]);
    return h(
      "section", { "aria-label": `Sensor ${sensor.id}` },
      h("h3", {}, h("span", { class: "swatch", style: { background: colour } }), `${sensor.id} `, h("span", { class: "dim" }, KINDS[sensor.kind] ?? sensor.kind), " ",
        state ? h("span", { class: `chip ${late ? "bad" : "good"}` }, late ? "silent" : "reporting") : ""),
      facts([
        ["Reports", `${format.rate(rates?.accepted_per_s)} used, ${format.rate(rates?.rejected_per_s)} refused`],
        ["Newest report", Number.isFinite(age) ? `${format.seconds(Math.max(0, age))} ago` : "none yet"],
        ["Age on arrival", format.seconds(state?.latency_s ?? NaN)],
        ["Waiting", state ? `${state.inbox} batches, ${format.count(state.dropped)} dropped, ${format.count(state.lost_batches)} lost on the way` : ""],
        ["Refused so far", refused.length ? h("span", {}, refused.map(([name, many]) => h("div", {}, `${format.count(many)} × ${format.reason(name)}`))) : "none"],
        ...(registration ? this._registration(registration) : []),
      ]),
      registration ? this._registrationCharts(sensor) : "",
    );
  }

  _registration(state) {
    // A sigma of exactly zero: it is not estimated.
    const value = ([name, sigma, , unit, decimals, scale]) => (state[name] == null || state[sigma] === 0 ? null
      : `${format.signed(state[name] * scale, decimals)} ± ${state[sigma] == null ? "?" : (state[sigma] * scale).toFixed(decimals)}${unit}`);
    return [
      ["Registration", h("span", {}, h("span", { class: `chip ${STATE_CLASS[state.state] ?? ""}` }, state.state), ` from ${format.count(state.samples)} plots of ${format.count(state.aircraft)} aircraft`)],
      ...BIASES.map((bias) => [bias[2], value(bias)]),
    ];
  }

  _registrationCharts(sensor) {
    const open = this._open.has(sensor.id);
    const details = h("details", { open, ontoggle: (event) => {
      if (event.target.open) this._open.add(sensor.id);
      else this._open.delete(sensor.id);
      this._charts();
    } }, h("summary", { "data-key": `history-${sensor.id}` }, "History of the registration"));
    for (const [name, , title, unit] of BIASES.slice(0, 3)) {
      details.append(h("div", { class: "dim" }, `${title} [${unit.trim()}]`), h("canvas", { class: "chart", style: { height: "84px" }, "data-sensor": sensor.id, "data-bias": name, role: "img", "aria-label": `${title} of ${sensor.id} over time` }));
    }
    return details;
  }

  _charts() {
    const colours = this._stage.colours;
    for (const canvas of this._content.querySelectorAll("canvas[data-bias]")) {
      if (!canvas.clientWidth) continue;
      const states = this._history?.registration?.[canvas.dataset.sensor] ?? [];
      const [name, sigma] = BIASES.find(([n]) => n === canvas.dataset.bias);
      const points = states.filter((s) => s[name] != null);
      drawChart(canvas, colours, {
        bands: [{ x: points.map((s) => s.time_s), low: points.map((s) => s[name] - s[sigma]), high: points.map((s) => s[name] + s[sigma]), colour: colours.boundary }],
        series: [{ x: points.map((s) => s.time_s), y: points.map((s) => s[name]), colour: sensorColour(this._stage.sensors, canvas.dataset.sensor, colours.dark), line: true }],
      });
    }
    const canvas = this._content.querySelector("canvas[data-rates]");
    if (canvas) {
      const rates = this._history?.rates ?? [];
      drawChart(canvas, colours, {
        fromZero: true,
        series: this._stage.sensors.map((sensor) => ({
          x: rates.map((r) => r.time_s), y: rates.map((r) => r.sensors[sensor.id]?.accepted_per_s ?? NaN),
          colour: sensorColour(this._stage.sensors, sensor.id, colours.dark), line: true,
        })),
      });
    }
  }

  _service(words, service) {
    const stages = Object.entries(service.stages_us ?? {});
    return [
      h("h3", {}, "Reports used per second"), h("canvas", { class: "chart", style: { height: "110px" }, "data-rates": "1", role: "img", "aria-label": "Reports per second of each sensor over the last five minutes" }),
      h("h3", {}, "Service"),
      facts([
        ["Instance", service.instance], ["Started", `${format.date(service.started_s)} ${format.clock(service.started_s)} UTC`],
        ["Status", `${format.seconds(words.silent_s)} ago`],
        ["Tracks", Object.entries(service.tracks).map(([name, many]) => `${format.count(many)} ${name}`).join(", ")],
        ["Points", Object.entries(service.points).map(([name, many]) => `${format.count(many)} ${name}`).join(", ")],
        ["Delay, worst", format.seconds(service.publish_delay_s ?? NaN)],
        ["Viewers", words.viewers], ["Feed", `${format.count(words.feed?.points)} points read, ${format.count(words.feed?.broken)} not readable`],
      ]),
      h("h3", {}, "Time of each stage, per report or element"),
      facts(stages.map(([name, us]) => [name, us < 1000 ? `${us.toFixed(us < 10 ? 2 : 0)} µs` : `${(us / 1000).toFixed(1)} ms`])),
      h("h3", {}, "Alarms"),
      service.alarms.length ? h("ul", {}, service.alarms.map((text) => h("li", { class: "warn" }, text))) : h("p", { class: "dim" }, "none"),
    ];
  }
}

const KINDS = { adsb: "ADS-B", ssr: "secondary radar", psr: "primary radar", wam: "multilateration" };
