// The story beside the drawing: how reports become a position, in steps with the numbers of the chosen element.
//
// The steps are numbered as in the drawing. Resting on a step, or focusing it, shows there what it talks about.

import { numberOf } from "./elements_badges.js";
import { facts, h, refill } from "./dom.js";
import { clock, metres, reason } from "./format.js";

export class ElementsStory {
  constructor(element, { emphasise, colour }) {
    this._element = element;
    this._colour = colour;
    const step = (event) => emphasise(event.target.closest?.("[data-key]")?.dataset.key ?? null);
    for (const come of ["pointerover", "focusin"]) element.addEventListener(come, step);
    for (const go of ["pointerleave", "focusout"]) element.addEventListener(go, () => emphasise(null));
  }

  draw(scene, chosen, sensors) {
    const element = scene?.elements.find((e) => e.index === chosen);
    if (!element) {
      refill(this._element, h("p", { class: "dim" }, "An aircraft gets its first element some seconds after it is confirmed."));
      return;
    }
    refill(this._element, h("p", {}, h("b", {}, "How this position is made. "),
      h("span", { class: "dim" }, "The numbers stand in the drawing too; rest on a step to see what it means, click an element to read about it.")),
    h("ol", { "aria-label": "How the position is made" }, this._steps(scene, element, sensors)), this._reports(element));
  }

  _step(kind, title, ...text) {
    return h("li", { tabIndex: 0, "data-key": kind, value: numberOf(kind) }, h("i", {}, numberOf(kind)), h("b", {}, title), ...text);
  }

  _dot(id) {
    return h("span", { class: "swatch circle", style: { background: this._colour(id) } });
  }

  _steps(scene, element, sensors) {
    const accepted = element.reports.filter((r) => r.accepted), refused = element.reports.filter((r) => !r.accepted);
    const perSensor = sensors.map((s) => [s.id, accepted.filter((r) => r.sensor === s.id).length]).filter(([, n]) => n);
    const length = element.end - element.start, lasts = element.span[1] - element.span[0];
    const point = element.point, live = scene.live;
    const size = (e) => (e ? `one sigma ${e.major.toFixed(1)} m × ${e.minor.toFixed(1)} m` : "no accuracy in this mode");
    const steps = [
      this._step("axis", "Master track", "The most accurate sensor leads: here ", ...(element.master ? [this._dot(element.master), element.master] : ["none, every sensor is silent"]),
        ". The flight as it tells it, smoothed with the help of all others, is the axis."),
      this._step("divisions", "Division points", `cut the axis every ${lasts.toFixed(0)} s of flight. A piece between two is a differential element: here ${metres(length)}, short enough to be treated as simple.`),
    ];
    if (Number.isFinite(element.halfWidth)) {
      steps.push(this._step("boundaries", "Boundary lines", `run ${metres(element.halfWidth)} to each side: as far as the errors of the reports in it can reach. What lies outside belongs to something else.`));
    }
    steps.push(
      this._step("reports", "Reports", perSensor.length ? `${accepted.length} are accepted in this element: ` : "None is accepted in this element; its point is predicted",
        ...perSensor.flatMap(([id, n], k) => [k ? ", " : "", this._dot(id), `${n} of ${id}`]), ". Radars are corrected by their registration first."),
      this._step("rejected", "Refused", refused.length ? `${refused.length} in this element: ${[...new Set(refused.map((r) => reason(r.reason)))].join(", ")}.` : "None in this element. A report that does not fit is crossed out, with its reason, and not used."),
    );
    if (point) {
      steps.push(this._step("points", "Fused point", `All accepted reports, each moved along the flight to the middle of the element and weighted by its accuracy, make one point. Its ellipse says how good it is: ${size(point.ellipse)}.`));
    }
    if (live) {
      const ahead = live.time_s - element.span[1];
      steps.push(this._step("live", "Live state", `Elements wait some seconds for late reports, here ${Math.max(ahead, 0).toFixed(0)} s. The live state does not: it is what the map shows, at once, with ${size(live.ellipse)}.`));
    }
    if (scene.waiting.length) steps.push(this._step("waiting", "Not closed yet", `${scene.waiting.length} reports (hollow) belong to elements that are still open; the live state has used them already.`));
    return steps;
  }

  _reports(element) {
    const rows = [...element.reports].sort((a, b) => a.time_s - b.time_s).map((r) =>
      h("tr", {},
        h("td", {}, this._dot(r.sensor), r.sensor), h("td", { class: "num" }, `${(r.time_s - element.span[0]).toFixed(1)} s`),
        h("td", { class: "num" }, r.across.toFixed(0)), h("td", { class: "num" }, r.residual.along.toFixed(0)),
        h("td", { class: r.accepted ? "good" : "bad" }, r.accepted ? "accepted" : r.reason.replaceAll("_", " "))));
    const head = ["Sensor", "At", "Across m", "Along m", ""].map((text) => h("th", { scope: "col" }, text));
    return h("div", {},
      h("h3", {}, `Element ${element.index}`),
      facts([
        ["Span", `${clock(element.span[0], 1)} – ${clock(element.span[1], 1)}`],
        ["Master", element.master ?? "none"],
        ["Fused at", element.point ? clock(element.point.time_s, 2) : ""],
        ["Note", (element.point?.flags ?? []).map((flag) => flag.replaceAll("_", " ")).join(", ")],
      ]),
      rows.length ? h("table", {}, h("thead", {}, h("tr", {}, head)), h("tbody", {}, rows)) : h("p", { class: "dim" }, "No reports are known in it."));
  }
}
