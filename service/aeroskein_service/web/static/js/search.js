// The search box: by callsign, address, track number or code, over everything the server knows, not only what is in view.

import { ask } from "./asking.js";
import { h } from "./dom.js";

const WAIT_MS = 150;

export class Search {
  constructor(form, { select, atQuery }) {
    this._input = form.querySelector("input");
    this._list = form.querySelector("ul");
    this._select = select;
    this._atQuery = atQuery;
    this._found = [];
    this._foundFor = ""; // the text that this was found for
    this._at = 0;
    this._timer = 0;
    this._input.addEventListener("input", () => this._soon());
    this._input.addEventListener("keydown", (event) => this._key(event));
    this._input.addEventListener("blur", () => setTimeout(() => document.activeElement !== this._input && this._show([]), 150));
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      this._take(this._at);
    });
  }

  focus() {
    this._input.focus();
    this._input.select();
  }

  _soon() {
    clearTimeout(this._timer);
    this._timer = setTimeout(() => this._ask(), WAIT_MS);
  }

  async _ask() {
    const text = this._input.value.trim();
    if (!text) return this._show([]);
    try {
      const at = this._atQuery().replace("?", "&");
      const response = await ask(`/api/search?q=${encodeURIComponent(text)}${at}`);
      if (response.ok && text === this._input.value.trim()) this._show((await response.json()).tracks, text);
    } catch {
      this._show([]);
    }
    return undefined;
  }

  _show(found, text = "") {
    this._found = found;
    this._foundFor = text;
    this._at = 0;
    this._list.hidden = found.length === 0;
    this._list.replaceChildren(...found.map((track, k) =>
      h("li", { role: "option", id: `found-${k}`, "aria-selected": String(k === 0), onmousedown: () => this._take(k) },
        h("span", {}, track.callsign ?? track.track), h("span", { class: "dim mono" }, track.track))));
    this._input.setAttribute("aria-expanded", String(found.length > 0));
  }

  _mark(step) {
    if (!this._found.length) return;
    this._at = (this._at + step + this._found.length) % this._found.length;
    [...this._list.children].forEach((item, k) => item.setAttribute("aria-selected", String(k === this._at)));
    this._input.setAttribute("aria-activedescendant", `found-${this._at}`);
  }

  _key(event) {
    if (event.key === "ArrowDown" || event.key === "ArrowUp") {
      event.preventDefault();
      this._mark(event.key === "ArrowDown" ? 1 : -1);
    } else if (event.key === "Escape") {
      this._input.value = "";
      this._show([]);
      this._input.blur();
    }
    event.stopPropagation();
  }

  async _take(k) {
    clearTimeout(this._timer);
    // Who types quickly is ahead of what has been found so far.
    if (this._foundFor !== this._input.value.trim()) await this._ask();
    const track = this._found[k];
    if (!track) return;
    this._show([]);
    this._input.blur();
    this._select(track);
  }
}
