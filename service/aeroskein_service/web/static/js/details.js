// The panel about the selected aircraft: who it is, where, how well that is known, and which sensors say so.

import { ask } from "./asking.js";
import { h, facts, panelHead, refill } from "./dom.js";
import { FLAG } from "./frame.js";
import * as format from "./format.js";
import { sourceName } from "./traffic.js";
import { SOURCE_NAMES, sensorColour } from "./colours.js";

const EVERY_MS = 1000;
const FLAG_WORDS = {
  coasted: "predicted: no report lately", guarded: "reports were guarded against", bias_uncertain: "a radar's bias is not certain yet",
  adsb_unverified: "ADS-B not yet confirmed by a radar", adsb_suspect: "ADS-B contradicted by radar",
  duplicate_address: "another track has the same address", on_ground: "on the ground",
};

export class Details {
  constructor(element, settings, stage, actions) {
    this._element = element;
    this._settings = settings;
    this._stage = stage;
    this._actions = actions;
    this._asked = 0;
    this._shownLabel = "";
    this.whole = null; // the newest answer of /api/track
    this.label = "";
  }

  // Once per frame: show, hide, renew.
  update(now) {
    const label = this._settings.primary;
    // The element view tells more about it, and needs the room.
    this._element.hidden = !label || this._settings.view === "elements";
    if (!label) {
      this.whole = null;
      this.label = "";
      return;
    }
    if (label !== this.label) {
      this.whole = null;
      this.label = label;
      this._asked = 0;
    }
    if (now - this._asked > EVERY_MS * 0.9) {
      this._asked = now;
      this._ask(label);
    }
    this._draw();
  }

  async _ask(label) {
    try {
      const response = await ask(`/api/track/${encodeURIComponent(label)}${this._actions.atQuery()}`);
      const whole = response.ok ? await response.json() : null;
      if (label === this.label) this.whole = whole;
    } catch {
      // The banner tells of a lost connection.
    }
  }

  _draw() {
    const { _settings: settings, _stage: stage } = this;
    const frame = stage.traffic.frame, row = frame.find(this.label);
    const head = panelHead(h("span", { class: "title" }, row >= 0 ? frame.name(row) : this.label), () => this._actions.select([]));
    if (row < 0) {
      refill(this._element, head, h("p", { class: "dim" }, `${this.label} is not in the picture now.`));
      return;
    }
    const point = this.whole?.point ?? null;
    refill(
      this._element, head, this._buttons(),
      facts([
        ["Address", frame.address(row)], ["Track", point ? `${point.track_number}` : frame.label(row)], ["Code", frame.codeText(row)],
        ["Status", this._status(frame, row)],
        ["Rests on", SOURCE_NAMES[sourceName(stage.traffic.source[row])]],
      ]),
      h("h3", {}, "Motion"),
      facts([
        ["Level", `${format.level(frame.altitude(row), settings)}${format.trend(frame.rate(row))}`],
        ["Pressure altitude", format.metres(frame.altitude(row))],
        ["Height (WGS-84)", point?.height_m == null ? "" : format.metres(point.height_m)],
        ["Ground speed", format.speed(frame.speed(row), settings)],
        ["Track angle", format.degrees(frame.angle(row), 1)],
        ["Vertical rate", format.verticalRate(frame.rate(row), settings)],
      ]),
      h("h3", {}, "Position"),
      facts([
        ["Latitude", format.latitude(frame.lat(row))], ["Longitude", format.longitude(frame.lon(row))],
        ["", h("span", { class: "mono dim" }, `${frame.lat(row).toFixed(6)}, ${frame.lon(row).toFixed(6)}`)],
        ["Accuracy (1σ)", accuracy(point, frame.sigma(row))],
        ["Valid at", `${format.clock(frame.time - frame.age(row), 1)} UTC, ${format.seconds(Math.max(0, frame.age(row)))} before the picture`],
        ["Newest report", `${frame.heard(row)} s ago`],
      ]),
      h("h3", {}, "Sensors"), this._sensors(frame, row, point),
      this._flags(frame, row),
      point?.seq != null ? h("p", { class: "dim" }, `live point ${point.seq} of service start ${new Date(point.epoch).toISOString().slice(0, 19)}Z`) : "",
    );
  }

  _buttons() {
    const settings = this._settings;
    const button = (key, text, on, press, title) =>
      h("button", { type: "button", "data-key": key, "aria-pressed": String(on), onclick: press, title }, text);
    return h(
      "div", { class: "row" },
      button("elements", "How it is made", settings.view === "elements", () => this._actions.toggleElements(), "The elements, reports and fused points behind this position (e)"),
      button("follow", "Follow", settings.follow, () => settings.toggle("follow"), "Keep it in the middle of the map (o)"),
      button("isolate", "Isolate", settings.isolate, () => settings.toggle("isolate"), "Dim all others (i)"),
    );
  }

  _status(frame, row) {
    const status = ["tentative", "confirmed", "coasting", "terminated"][frame.status(row)];
    const kind = { tentative: "warn", confirmed: "good", coasting: "warn", terminated: "bad" }[status];
    return h("span", { class: `chip ${kind}` }, status);
  }

  _sensors(frame, row, point) {
    const bits = frame.sensors(row), dark = this._stage.colours.dark;
    const list = this._stage.sensors.map((sensor, k) => {
      const lately = (bits >>> k) & 1;
      const count = point?.sources?.[sensor.id];
      const words = [lately ? "contributes" : "silent"];
      if (count && point.seq !== null) words.push(`${count} in the newest point`);
      if (frame.master(row) === k) words.push("master");
      return [
        h("span", {}, h("span", { class: "swatch", style: { background: sensorColour(this._stage.sensors, sensor.id, dark) } }), sensor.id),
        h("span", { class: lately ? "" : "dim" }, words.join(", ")),
      ];
    });
    if (point?.rejected) list.push(["refused", `${point.rejected} since the last point`]);
    return facts(list);
  }

  _flags(frame, row) {
    const flags = frame.flags(row);
    const words = Object.entries(FLAG).filter(([, bit]) => flags & bit).map(([name]) => FLAG_WORDS[name]);
    return words.length ? h("div", {}, h("h3", {}, "Note"), words.map((text) => h("p", {}, h("span", { class: "chip warn" }, text)))) : "";
  }
}

// Both axes of the ellipse where the covariance is known.
function accuracy(point, sigma) {
  const covariance = point?.position_cov_m2;
  if (!covariance) return Number.isFinite(sigma) ? format.metres(sigma, 1) : "unknown";
  const [ee, en, nn] = covariance;
  const mean = (ee + nn) / 2, off = Math.hypot((ee - nn) / 2, en);
  return `${format.metres(Math.sqrt(mean + off), 1)} × ${format.metres(Math.sqrt(Math.max(mean - off, 0)), 1)}`;
}
