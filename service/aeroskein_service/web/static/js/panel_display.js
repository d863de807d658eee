// The panel that says what is drawn and how; and the user's own map layers.

import { ask } from "./asking.js";
import { h, panelHead } from "./dom.js";
import { bare, checkbox, choice, entry, syncFields } from "./fields.js";
import { readLayer } from "./geojson.js";

const LARGEST = 50e6; // bytes of a layer

export class DisplayPanel {
  constructor(element, { settings, stage, state }, close) {
    this._element = element;
    this._settings = settings;
    this._stage = stage;
    this._state = state;
    this._close = close;
    this._layers = h("div", { id: "layers" });
    this._loadServerLayers();
    window.addEventListener("dragover", (event) => event.preventDefault());
    window.addEventListener("drop", (event) => {
      event.preventDefault();
      this._addFiles(event.dataTransfer?.files ?? []);
    });
  }

  show() {
    const s = this._settings;
    const file = h("input", { type: "file", accept: ".geojson,.json", multiple: true, hidden: true, onchange: (event) => this._addFiles(event.target.files) });
    this._element.replaceChildren(
      panelHead("Display", this._close),
      h("h3", {}, "Traffic"),
      choice(s, "color", "Colour by", [["source", "source"], ["altitude", "altitude"], ["accuracy", "accuracy"], ["age", "age of the newest report"]]),
      choice(s, "labels", "Labels", [[0, "none"], [1, "callsign and level"], [2, "full data block"]]),
      entry(s, "density", "Labels at most", { limits: [0, 2000] }),
      choice(s, "vector", "Speed vector", [[0, "none"], [60, "1 minute"], [120, "2 minutes"], [300, "5 minutes"]]),
      choice(s, "trail", "Trails", [["auto", "automatic"], ["none", "none"], ["selected", "of the selected"], ["all", "of all"]]),
      choice(s, "trailtime", "Trail length", [[60, "1 minute"], [120, "2 minutes"], [300, "5 minutes"], [900, "15 minutes"]]),
      checkbox(s, "smooth", "Move between two pictures"),
      h("h3", {}, "Map"),
      choice(s, "theme", "Theme", [["auto", "as the system"], ["dark", "dark"], ["light", "light"]]),
      checkbox(s, "land", "Land"), checkbox(s, "borders", "Borders"), checkbox(s, "grid", "Grid"), checkbox(s, "rings", "Range rings of the radars"),
      choice(s, "ringstep", "Rings every", [[10, "10 NM"], [25, "25 NM"], [50, "50 NM"], [100, "100 NM"]]),
      h("h3", {}, "Units"),
      choice(s, "units", "Units", [["aero", "feet, knots, NM"], ["metric", "metres, m/s, km"]]),
      h("label", { class: "field" }, "QNH [hPa]", bare(s, "qnh", { limits: [850, 1100], label: "QNH in hPa" })),
      h("label", { class: "field" }, "Transition altitude [ft]", bare(s, "transition", { limits: [0, 60000], label: "Transition altitude in feet" })),
      h("h3", {}, "Layers"),
      h("p", { class: "dim" }, "GeoJSON with airspace, routes or fixes. Drop a file anywhere on the page; it stays in this browser."),
      this._layers, file,
      h("button", { type: "button", onclick: () => file.click() }, "Add a layer…"),
    );
    this._listLayers();
  }

  settings() {
    syncFields(this._element, this._settings);
  }

  async _loadServerLayers() {
    try {
      const { layers } = await (await ask("/api/layers")).json();
      for (const [number, name] of layers.entries()) this._add(name, await (await ask(`/api/layers/${number}`)).json());
    } catch (error) {
      this._state.faults.push(`layers: ${error}`);
    }
  }

  async _addFiles(files) {
    for (const file of files) {
      try {
        if (file.size > LARGEST) throw new Error(`${file.name} is larger than 50 MB`);
        this._add(file.name.replace(/\.(geo)?json$/i, ""), JSON.parse(await file.text()));
      } catch (error) {
        this._layers.append(h("p", { class: "bad" }, `${file.name}: ${error.message}`));
      }
    }
  }

  _add(name, content) {
    this._stage.base.userLayers.push(readLayer(name, content));
    this._stage.invalidate("base");
    this._listLayers();
  }

  _listLayers() {
    this._layers.replaceChildren(...this._stage.base.userLayers.map((layer) =>
      h("label", { class: "check" }, h("input", {
        type: "checkbox", checked: layer.shown,
        onchange: (event) => {
          layer.shown = event.target.checked;
          this._stage.invalidate("base");
        },
      }), layer.name)));
  }
}
