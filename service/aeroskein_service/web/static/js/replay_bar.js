// The bar of a replay: time line, play and pause, speed, jumps.

import { h } from "./dom.js";
import { clock, date } from "./format.js";

const SPEEDS = [0.5, 1, 2, 5, 10, 30, 60];

export class ReplayBar {
  constructor(element, { settings, actions, stage }) {
    this._element = element;
    this._settings = settings;
    this._actions = actions;
    this._stage = stage;
    this._range = null;
    this._held = false;
    this._time = h("span", { class: "time" });
    this._play = h("button", { type: "button", onclick: () => actions.play(settings.paused) });
    this._line = h("input", {
      type: "range", min: "0", max: "1000", step: "1", "aria-label": "Time of the replay",
      oninput: () => {
        this._held = true;
        this._say(this._at());
      },
      onchange: () => {
        this._held = false;
        actions.jump(this._at());
      },
    });
    this._speed = h("select", { "aria-label": "Speed of the replay", onchange: (event) => actions.play(!settings.paused, Number(event.target.value)) },
      SPEEDS.map((v) => h("option", { value: String(v) }, `${v} ×`)));
    const jump = (text, by, title) => h("button", { type: "button", title, "aria-label": title, onclick: () => actions.jump(stage.traffic.frame.time + by) }, text);
    element.append(jump("−60", -60, "A minute back"), jump("−10", -10, "Ten seconds back"), this._play, jump("+10", 10, "Ten seconds on"), jump("+60", 60, "A minute on"), this._speed, this._line, this._time);
  }

  hello(words) {
    this._range = words.kind === "replay" ? [words.begin_s, words.end_s] : null;
    this._element.hidden = !this._range;
    this.settings(new Set(["paused", "speed"]));
  }

  settings(changed) {
    if (changed.has("paused")) this._play.textContent = this._settings.paused ? "Play" : "Pause";
    if (changed.has("speed")) {
      const value = String(this._settings.speed);
      if (![...this._speed.options].some((option) => option.value === value)) this._speed.append(h("option", { value }, `${value} ×`));
      this._speed.value = value;
    }
  }

  frame(frame) {
    if (!this._range || this._held) return;
    const [begin, end] = this._range;
    this._line.value = String(Math.round((1000 * (frame.time - begin)) / Math.max(end - begin, 1)));
    this._say(frame.time);
  }

  _at() {
    const [begin, end] = this._range;
    return begin + (Number(this._line.value) / 1000) * (end - begin);
  }

  _say(time) {
    this._time.textContent = `${date(time)} ${clock(time)}`;
    this._line.setAttribute("aria-valuetext", clock(time));
  }

  numbers() {
    const frame = this._stage.traffic.frame;
    return this._range ? { begin: this._range[0], end: this._range[1], time: frame.time, playing: frame.playing, speed: frame.pace } : null;
  }
}
