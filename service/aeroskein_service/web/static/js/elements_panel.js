// The element view: how the position of the selected aircraft was made, told as a drawing, a story and charts.

import { ask } from "./asking.js";
import { ElementHistory, makeScene } from "./elements_data.js";
import { ElementsCanvas, describe } from "./elements_canvas.js";
import { ElementsCharts } from "./elements_charts.js";
import { ElementsView } from "./elements_view.js";
import { ElementsOnMap } from "./elements_map.js";
import { ElementsStory } from "./elements_story.js";
import { h } from "./dom.js";
import { sensorColour } from "./colours.js";

const EVERY_MS = 1000;
const DRAWN_ELEMENTS = 30;

export class ElementsPanel {
  constructor(element, { settings, stage, actions, state }) {
    this._element = element;
    this._settings = settings;
    this._stage = stage;
    this._actions = actions;
    this._state = state;
    this._history = new ElementHistory();
    this._view = new ElementsView();
    this._askedAt = 0;
    this._chosen = null; // index of an element the user has picked; null: the newest
    this._scene = null;
    this._build();
    this._onMap = new ElementsOnMap((id) => this._colour(id));
    stage.elementOverlay = (context, view, colours) => {
      if (this._shown) this._onMap.draw(context, view, colours, this._history);
    };
  }

  get _shown() {
    return this._settings.view === "elements" && this._settings.primary !== "";
  }

  _build() {
    const settings = this._settings;
    const canvas = h("canvas", { tabIndex: 0, role: "img", "aria-label": "Elements of the selected aircraft. Left and right choose an element, plus and minus zoom." });
    this._canvas = new ElementsCanvas(canvas, this._view);
    this._title = h("span", { class: "title" });
    this._said = h("p", { class: "mono", role: "status" });
    this._strip = h("button", { type: "button", onclick: () => settings.set({ frame: "strip" }) }, "Strip");
    this._plan = h("button", { type: "button", onclick: () => settings.set({ frame: "plan" }) }, "Plan");
    const story = h("div", { class: "story" });
    const charts = h("div", { class: "charts" });
    const drawing = h("div", { class: "drawing" },
      h("div", { class: "row" }, this._title, this._strip, this._plan,
        h("button", { type: "button", onclick: () => this._resetView() }, "Reset view"),
        h("button", { type: "button", onclick: () => settings.set({ view: "map" }) }, "Close")),
      canvas, this._said, story);
    this._story = new ElementsStory(story, { emphasise: (kind) => this._emphasise(kind), colour: (id) => this._colour(id) });
    this._charts = new ElementsCharts(charts, settings);
    this._element.append(drawing, charts);
    this._listen(canvas);
    new ResizeObserver(() => this._draw()).observe(canvas);
  }

  _colour(id) {
    return sensorColour(this._stage.sensors, id, this._stage.colours.dark);
  }

  // -- hands ---------------------------------------------------------------------------------------------------------
  _listen(canvas) {
    let from = null, far = false;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      from = [event.offsetX, event.offsetY];
      far = false;
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!from) {
        this._said.textContent = describe(this._canvas.at(event.offsetX, event.offsetY));
        return;
      }
      const dx = event.offsetX - from[0], dy = event.offsetY - from[1];
      far ||= Math.hypot(dx, dy) > 4;
      if (!far) return;
      this._view.drag(dx, dy);
      from = [event.offsetX, event.offsetY];
      this._draw();
    });
    canvas.addEventListener("pointerup", (event) => {
      from = null;
      if (far) return;
      const thing = this._canvas.at(event.offsetX, event.offsetY);
      this._said.textContent = describe(thing);
      this._choose(thing?.element?.index ?? null);
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this._view.zoomBy(Math.exp(-event.deltaY / 500));
      this._draw();
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => this._key(event));
  }

  _key(event) {
    const elements = this._scene?.elements ?? [];
    const at = elements.findIndex((e) => e.index === this._current());
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (step && elements[at + step]) {
      this._choose(elements[at + step].index);
      this._said.textContent = describe({ kind: "element", element: elements[at + step] });
    } else if (event.key === "+" || event.key === "=") this._view.zoomBy(1.3);
    else if (event.key === "-") this._view.zoomBy(1 / 1.3);
    else if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    this._draw();
  }

  _choose(index) {
    this._chosen = index;
    this._draw();
  }

  // The element that the story is about: the chosen one, else the newest.
  _current() {
    const elements = this._scene?.elements ?? [];
    return (elements.find((e) => e.index === this._chosen) ?? elements.at(-1))?.index ?? null;
  }

  // Only the drawing: the story would lose what the pointer rests on.
  _emphasise(kind) {
    if (kind === (this._emphasis ?? null)) return;
    this._emphasis = kind;
    this._canvas.draw(this._scene, this._look());
  }

  _look() {
    const { colours, sensors } = this._stage;
    return { colours, sensors, sensorColour: (id) => this._colour(id), emphasis: this._emphasis, chosen: this._current() };
  }

  _resetView() {
    this._view.reset();
    this._chosen = null;
    this._draw();
  }

  // -- data ----------------------------------------------------------------------------------------------------------
  settings(changed) {
    this._element.hidden = !this._shown;
    if (changed.has("view") || changed.has("sel")) {
      this._askedAt = 0;
      if (this._history.track !== this._settings.primary) {
        this._history.clear(this._settings.primary);
        this._resetView();
      }
      if (this._shown) this._ask(performance.now());
    }
    this._view.frame = this._settings.frame;
    this._strip.setAttribute("aria-pressed", String(this._settings.frame === "strip"));
    this._plan.setAttribute("aria-pressed", String(this._settings.frame === "plan"));
    if (this._shown) this._draw();
  }

  frame(_frame, now) {
    if (this._shown && now - this._askedAt > EVERY_MS * 0.9) this._ask(now);
  }

  async _ask(now) {
    this._askedAt = now;
    const track = this._settings.primary;
    try {
      const response = await ask(`/api/elements/${encodeURIComponent(track)}${this._actions.atQuery()}`);
      const answer = await response.json().catch(() => ({}));
      if (track !== this._history.track) return;
      if (response.ok) this._history.take(answer);
      this._said.classList.toggle("bad", !response.ok);
      if (!response.ok) this._said.textContent = answer.error ?? "There are no elements of this aircraft now.";
    } catch {
      return; // the banner tells of a lost connection
    }
    this._draw();
  }

  _draw() {
    if (!this._shown) return;
    const { _stage: stage, _settings: settings } = this;
    const row = stage.traffic.frame.find(settings.primary);
    this._title.textContent = `Elements of ${row >= 0 ? stage.traffic.frame.name(row) : settings.primary}`;
    this._scene = makeScene(this._history, DRAWN_ELEMENTS);
    const look = this._look();
    this._canvas.draw(this._scene, look);
    this._whole = makeScene(this._history, Infinity);
    this._charts.draw(this._whole, this._state.details?.whole?.trail, look);
    this._story.draw(this._scene, look.chosen, look.sensors);
    stage.invalidate();
  }

  numbers() {
    if (!this._shown) return null;
    const reports = (this._whole?.elements ?? []).flatMap((e) => e.reports);
    const residuals = {};
    for (const report of reports.filter((r) => r.accepted)) (residuals[report.sensor] ??= []).push(Math.abs(report.residual.across));
    return {
      track: this._history.track, known: this._history.elements.size, chosen: this._current(), frame: this._view.frame,
      drawn: { ...this._canvas.drawn }, charts: { ...this._charts.drawn }, onMap: this._onMap.drawn,
      accepted: reports.filter((r) => r.accepted).length, rejected: reports.filter((r) => !r.accepted).length,
      reasons: [...new Set(reports.filter((r) => !r.accepted).map((r) => r.reason))],
      masters: [...new Set((this._whole?.elements ?? []).map((e) => e.master))],
      sigma: this._scene?.elements.at(-1)?.point?.ellipse?.major ?? null, liveSigma: this._scene?.live?.ellipse?.major ?? null,
      residuals: Object.fromEntries(Object.entries(residuals).map(([id, list]) => [id, list.sort((a, b) => a - b)[list.length >> 1]])),
      said: this._said.textContent,
    };
  }
}
