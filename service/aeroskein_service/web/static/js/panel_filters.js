// The panel with the filters. What does not pass is dimmed, never hidden.

import { h, panelHead } from "./dom.js";
import { DEFAULTS } from "./settings.js";
import { FILTER_SETTINGS, parseBox } from "./filters.js";
import { bare, checkbox, choice, entry, syncFields } from "./fields.js";

export class FiltersPanel {
  constructor(element, { settings, stage, view }, close) {
    this._element = element;
    this._settings = settings;
    this._stage = stage;
    this._view = view;
    this._close = close;
    this._count = h("p", { role: "status" });
  }

  show() {
    const s = this._settings;
    this._box = h("p", { class: "bad", hidden: true }, "A box is lat min, lon min, lat max, lon max in degrees.");
    this._element.replaceChildren(
      panelHead("Filters", this._close),
      h("p", { class: "dim" }, "What does not pass is dimmed and loses its label and its row in the table; its symbol stays. Emergencies and selected aircraft always pass."),
      entry(s, "q", "Callsign, address, code", { placeholder: "contains" }),
      h("div", { class: "field" }, "Flight level",
        h("span", { class: "pair" }, bare(s, "altmin", { placeholder: "from", label: "Lowest flight level" }), bare(s, "altmax", { placeholder: "to", label: "Highest flight level" }))),
      entry(s, "bbox", "Box", { placeholder: "47,9,49,13" }), this._box,
      h("button", { type: "button", onclick: () => this._boxOfView() }, "Box of the map's view"),
      choice(s, "sensor", "Sensor", [["", "any"], ...this._stage.sensors.map((sensor) => [sensor.id, sensor.id])]),
      choice(s, "status", "Status", [["", "any"], ["confirmed", "confirmed"], ["tentative", "tentative"], ["coasting", "coasting"]]),
      choice(s, "source", "Rests on", [["", "any"], ["fused", "ADS-B and radar"], ["adsb", "ADS-B only"], ["radar", "radar only"], ["coasted", "coasted"], ["suspect", "suspect"]]),
      checkbox(s, "emergency", "Emergencies only (7500, 7600, 7700)"),
      checkbox(s, "isolate", "Selected only"),
      this._count,
      h("button", { type: "button", onclick: () => this._clear() }, "Clear all filters"),
    );
    this._tell();
  }

  settings() {
    syncFields(this._element, this._settings);
    this._box.hidden = this._settings.bbox.trim() === "" || parseBox(this._settings.bbox) !== null;
  }

  frame() {
    this._tell();
  }

  _tell() {
    this._count.textContent = `${this._stage.traffic.passed} of ${this._stage.traffic.count} pass.`;
  }

  _boxOfView() {
    const box = this._view.box(0);
    this._settings.set({ bbox: box ? box.map((v) => v.toFixed(3)).join(",") : "" });
    syncFields(this._element, this._settings);
  }

  _clear() {
    this._settings.set(Object.fromEntries(FILTER_SETTINGS.map((name) => [name, DEFAULTS[name]])));
    syncFields(this._element, this._settings);
  }
}
