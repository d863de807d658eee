// Help: what the symbols mean, how the method works in six sentences, and the keys.

import { h, panelHead } from "./dom.js";
import { KEYS } from "./keyboard.js";

export class HelpPanel {
  constructor(element, _parts, close) {
    this._element = element;
    this._close = close;
  }

  show() {
    this._element.replaceChildren(
      panelHead("Help", this._close),
      h("p", {}, "Each symbol is one aircraft as the fusion service sees it: the reports of all sensors, corrected for their errors, made into one track. Its shape says which sensors it rests on, the line ahead of it where it will be, the block beside it who it is."),
      h("h3", {}, "Data block"),
      h("p", { class: "mono" }, "DLH4AB", h("br"), "F350↑ G460", h("br"), "1000"),
      h("p", {}, "Callsign (or address); flight level, or altitude on the set QNH below the transition altitude, climbing; ground speed in knots; Mode A code. 7500, 7600 and 7700 are always shown in red."),
      h("h3", {}, "How a position is made"),
      h("p", {}, "Select an aircraft and press ", h("kbd", {}, "e"), ": the view shows the differential elements that its flight is cut into, the reports in each, and the fused point."),
      h("h3", {}, "Keys"),
      h("dl", { class: "facts" }, KEYS.flatMap(([key, text]) => [h("dt", {}, key.split("  ").flatMap((k, i) => [i ? " " : "", h("kbd", {}, k)])), h("dd", {}, text)])),
      h("p", { class: "dim" }, "Map: Natural Earth 1:50 m, public domain. Every setting stands in the address: copy it to share this view."),
    );
  }
}
