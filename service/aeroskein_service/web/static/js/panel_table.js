// The table of aircraft: sorted, filtered as the map is, by keyboard and mouse, and as CSV.
//
// It has rows for what the map's filters let through, 500 at most on the screen; the CSV has them all. "In view" limits it
// to the map; without it the server sends everything there is.

import { h, refill } from "./dom.js";
import { STATUS } from "./frame.js";
import * as format from "./format.js";
import { SOURCE_NAMES } from "./colours.js";
import { sourceName } from "./traffic.js";

const ROWS = 500;
const EVERY_MS = 900;

// Name, heading, value to sort and to write as CSV, text on the screen.
const COLUMNS = [
  ["callsign", "Callsign", (f, i) => f.callsign(i), null],
  ["label", "Track", (f, i) => f.label(i), null],
  ["code", "Code", (f, i) => f.codeText(i), null],
  ["level", "Level", (f, i) => f.altitude(i), (v, s) => format.level(v, s), "num"],
  ["rate", "V/S", (f, i) => f.rate(i), (v, s) => format.verticalRate(v, s), "num"],
  ["speed", "Speed", (f, i) => f.speed(i), (v, s) => format.speed(v, s), "num"],
  ["angle", "Track angle", (f, i) => f.angle(i), (v) => format.degrees(v), "num"],
  ["source", "Rests on", (f, i, t) => sourceName(t.source[i]), (v) => SOURCE_NAMES[v]],
  ["status", "Status", (f, i) => STATUS[f.status(i)], null],
  ["sigma", "1σ", (f, i) => f.sigma(i), (v) => format.metres(v), "num"],
  ["heard", "Report", (f, i) => f.heard(i), (v) => `${v} s`, "num"],
  ["lat", "Latitude", (f, i) => f.lat(i), (v) => v.toFixed(4), "num"],
  ["lon", "Longitude", (f, i) => f.lon(i), (v) => v.toFixed(4), "num"],
];

export class TablePanel {
  constructor(element, { settings, stage, view, actions }) {
    this._element = element;
    this._settings = settings;
    this._stage = stage;
    this._view = view;
    this._actions = actions;
    this._drawnAt = 0;
    this._rows = [];
    this._count = h("span", { class: "dim", role: "status" });
    this._body = h("tbody", {});
    this._head = h("tr", {});
    this._inView = h("input", { type: "checkbox", onchange: (event) => settings.set({ inview: event.target.checked }) });
    element.append(
      h("div", { class: "tools" }, h("b", {}, "Aircraft"), this._count, h("label", {}, this._inView, "in view"),
        h("button", { type: "button", onclick: () => this._save() }, "CSV"),
        h("button", { type: "button", onclick: () => settings.set({ table: false }) }, "Close")),
      h("div", { class: "scroll" }, h("table", {}, h("thead", {}, this._head), this._body)),
    );
    this._body.addEventListener("click", (event) => this._press(event));
    this._body.addEventListener("keydown", (event) => this._key(event));
  }

  settings(changed) {
    this._element.hidden = !this._settings.table;
    this._inView.checked = this._settings.inview;
    const mine = ["table", "sort", "down", "inview", "q", "altmin", "altmax", "bbox", "sensor", "status", "source", "emergency", "isolate", "sel", "units"];
    if (this._settings.table && mine.some((name) => changed.has(name))) setTimeout(() => this._draw(), 30);
  }

  frame(_frame, now) {
    if (this._settings.table && now - this._drawnAt > EVERY_MS) {
      this._drawnAt = now;
      this._draw();
    }
  }

  numbers() {
    return { shown: this._settings.table, rows: this._rows.length, labels: this._rows.map((i) => this._stage.traffic.frame.label(i)) };
  }

  // Rows that pass, in the order of the chosen column.
  _sorted() {
    const traffic = this._stage.traffic, frame = traffic.frame, settings = this._settings, view = this._view;
    const column = COLUMNS.find(([name]) => name === settings.sort) ?? COLUMNS[0];
    const rows = [];
    for (let i = 0; i < frame.count; i++) {
      if (!traffic.passes[i]) continue;
      if (settings.inview) {
        const x = view.screenX(traffic.x[i]), y = view.screenY(traffic.y[i]);
        if (x < 0 || y < 0 || x > view.width || y > view.height) continue;
      }
      rows.push({ i, value: column[2](frame, i, traffic), label: frame.label(i) });
    }
    const sign = settings.down ? -1 : 1;
    const empty = (v) => v === "" || Number.isNaN(v);
    // What is unknown comes last whichever way it is sorted.
    rows.sort((a, b) => empty(a.value) - empty(b.value) || (a.value < b.value ? -sign : a.value > b.value ? sign : a.label < b.label ? -1 : 1));
    return rows.map((row) => row.i);
  }

  _draw() {
    const { _settings: settings, _stage: stage } = this;
    if (!settings.table) return;
    const frame = stage.traffic.frame;
    this._rows = this._sorted();
    this._count.textContent = `${this._rows.length}${this._rows.length > ROWS ? `, the first ${ROWS} shown` : ""} of ${frame.total}`;
    refill(this._head, COLUMNS.map(([name, title, , , kind]) => {
      const on = settings.sort === name;
      return h("th", { scope: "col", class: kind, "aria-sort": on ? (settings.down ? "descending" : "ascending") : "none" },
        h("button", { type: "button", "data-key": `sort-${name}`, onclick: () => settings.set({ sort: name, down: on ? !settings.down : false }) },
          `${title}${on ? (settings.down ? " ↓" : " ↑") : ""}`));
    }));
    const chosen = new Set(settings.selected);
    refill(this._body, this._rows.slice(0, ROWS).map((i) => this._row(frame, i, chosen)));
  }

  _row(frame, i, chosen) {
    const label = frame.label(i);
    const cells = COLUMNS.map(([, , value, text, kind]) => {
      const v = value(frame, i, this._stage.traffic);
      return h("td", { class: kind }, text ? text(v, this._settings) : v);
    });
    return h("tr", { tabIndex: 0, "data-label": label, "data-key": `row-${label}`, "aria-selected": String(chosen.has(label)), class: frame.emergency(i) ? "emergency" : "" }, cells);
  }

  _press(event) {
    const row = event.target.closest("tr");
    if (row) this._choose(row.dataset.label);
  }

  _choose(label) {
    const frame = this._stage.traffic.frame, row = frame.find(label);
    if (row >= 0) this._actions.goTo({ track: label, lat_deg: frame.lat(row), lon_deg: frame.lon(row) });
  }

  _key(event) {
    const row = event.target.closest("tr");
    if (!row) return;
    if (event.key === "Enter" || event.key === " ") this._choose(row.dataset.label);
    else if (event.key === "ArrowDown") row.nextElementSibling?.focus();
    else if (event.key === "ArrowUp") row.previousElementSibling?.focus();
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  // The rows as text with commas between, all of them.
  csv() {
    const { traffic } = this._stage, quote = (v) => (/[",\n]/.test(v) ? `"${v.replaceAll('"', '""')}"` : v);
    const head = ["time_s", "callsign", "track", "mode_a", "altitude_m", "vertical_rate_mps", "ground_speed_mps", "track_angle_deg", "source", "status", "sigma_m", "report_age_s", "lat_deg", "lon_deg"];
    const lines = this._sorted().map((i) => {
      const values = COLUMNS.map(([, , value]) => value(traffic.frame, i, traffic));
      const cells = values.map((v) => (typeof v === "number" ? (Number.isFinite(v) ? String(Number(v.toFixed(7))) : "") : quote(v)));
      return [(traffic.frame.time - traffic.frame.age(i)).toFixed(2), ...cells].join(",");
    });
    return [head.join(","), ...lines].join("\n") + "\n";
  }

  _save() {
    const link = h("a", { href: URL.createObjectURL(new Blob([this.csv()], { type: "text/csv" })), download: `aircraft-${Math.round(this._stage.traffic.frame.time)}.csv` });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }
}
