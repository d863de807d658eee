// Which panels are open, and their turn to renew themselves: sensors, filters, display, help, table, elements, replay.

import { byId } from "./dom.js";
import { DisplayPanel } from "./panel_display.js";
import { ElementsPanel } from "./elements_panel.js";
import { FiltersPanel } from "./panel_filters.js";
import { HelpPanel } from "./panel_help.js";
import { ReplayBar } from "./replay_bar.js";
import { SensorsPanel } from "./panel_sensors.js";
import { TablePanel } from "./panel_table.js";

export class Panels {
  constructor(parts) {
    const { settings, actions, state } = parts;
    this._settings = settings;
    this._state = state;
    this._side = byId("side");
    const close = () => settings.set({ panel: "" });
    this._panels = {
      sensors: new SensorsPanel(this._side, parts, close),
      filters: new FiltersPanel(this._side, parts, close),
      display: new DisplayPanel(this._side, parts, close),
      help: new HelpPanel(this._side, parts, close),
    };
    state.table = new TablePanel(byId("table"), parts);
    state.elements = new ElementsPanel(byId("elements"), parts);
    state.replay = new ReplayBar(byId("replay"), parts);
    for (const button of document.querySelectorAll("[data-panel]")) button.onclick = () => actions.panel(button.dataset.panel);
    for (const button of document.querySelectorAll("[data-toggle]")) button.onclick = () => settings.toggle(button.dataset.toggle);
  }

  hello(words) {
    this._state.replay.hello(words);
  }

  words(words) {
    this._open?.words?.(words);
  }

  frame(frame, now) {
    this._state.table.frame(frame, now);
    this._state.elements.frame(frame, now);
    this._state.replay.frame(frame);
    this._open?.frame?.(frame, now);
  }

  settings(changed) {
    const settings = this._settings;
    if (changed.has("panel")) {
      this._open = this._panels[settings.panel] ?? null;
      this._side.hidden = !this._open;
      this._side.classList.toggle("wide", settings.panel === "sensors");
      this._open?.show();
    } else {
      this._open?.settings?.(changed);
    }
    for (const button of document.querySelectorAll("[data-panel]")) button.setAttribute("aria-pressed", String(button.dataset.panel === settings.panel));
    for (const button of document.querySelectorAll("[data-toggle]")) button.setAttribute("aria-pressed", String(settings[button.dataset.toggle]));
    this._state.table.settings(changed);
    this._state.elements.settings(changed);
    this._state.replay.settings(changed);
  }
}
