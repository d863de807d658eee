// The banner: red while the picture stands still, amber while it lacks something. A display that is frozen must say so.

import { clock, seconds } from "./format.js";

const SILENT_S = 4; // without news from the service
const STALE_S = 4; // without a frame from the server

export class Banner {
  constructor(element, spoken) {
    this._element = element;
    this._spoken = spoken;
    this.kind = ""; // "", "frozen", "warning"
    this.text = "";
  }

  // Judge the state of things: link state, newest frame and when it came [ms], newest words.
  update({ linkState, frame, frameAt, words, now, kind }) {
    const [severity, text] = this._judge(linkState, frame, frameAt, words, now, kind);
    if (severity === this.kind && text === this.text) return;
    const spoken = severity !== this.kind;
    this.kind = severity;
    this.text = text;
    this._element.hidden = severity === "";
    this._element.classList.toggle("warn", severity === "warning");
    this._element.textContent = text;
    if (spoken && severity === "") this._spoken.textContent = "The picture is live again.";
  }

  _judge(linkState, frame, frameAt, words, now, kind) {
    const since = frame.time ? `frozen since ${clock(frame.time)} UTC` : "empty";
    if (linkState !== "open") return ["frozen", `No connection to the server of this page. The picture is ${since}. Trying again…`];
    if (kind === "replay") return ["", ""];
    if (words?.waiting) return ["frozen", `The page is ${words.waiting}. The picture is ${since}.`];
    if (frame.time && !frame.connected) return ["frozen", `No connection to the Zenoh router. The picture is ${since}.`];
    if (words && !words.heard && frame.silent > SILENT_S) return ["frozen", "No fusion service answers under this prefix. Waiting for one…"];
    if (frame.silent > SILENT_S) {
      return ["frozen", `The fusion service has been silent for ${seconds(frame.silent)}. The picture is frozen since ${clock(frame.time - frame.silent)} UTC.`];
    }
    if (frame.time && (now - frameAt) / 1000 > STALE_S) return ["frozen", `No new picture for ${seconds((now - frameAt) / 1000)}. The picture is ${since}.`];
    const alarms = words?.service?.alarms ?? [];
    return alarms.length ? ["warning", alarms.join("  ·  ")] : ["", ""];
  }
}
