// The page put together: settings, connection, stage and panels, and what happens between them.

import { Banner } from "./banner.js";
import { Details } from "./details.js";
import { byId } from "./dom.js";
import { activeFilters } from "./filters.js";
import { clock, count, date } from "./format.js";
import { listenToKeys } from "./keyboard.js";
import { drawCursor, drawLegend, drawScale } from "./legend.js";
import { Link } from "./link.js";
import { MapView } from "./map_view.js";
import { Panels } from "./panels.js";
import { exposeView } from "./probe.js";
import { inverse } from "./projection.js";
import { makeActions } from "./actions.js";
import { Search } from "./search.js";
import { Settings } from "./settings.js";
import { Stage } from "./stage.js";

const BANNER_MS = 500;
const AGES = 240;

const settings = new Settings();
const state = { hello: null, words: null, frames: 0, drawn: 0, ages: [], faults: [], newest: null, frameAt: 0, shown: null };
const overlay = byId("map-overlay");

// First of all: the first picture is on its way while the graphics card gets ready.
const link = new Link({ frame: takeFrame, words: takeWords, state: () => judge(), fault });
const view = new MapView(overlay, {
  onChange: () => viewChanged(),
  onRest: () => viewRests(),
  onClick: (at) => actions.click(at),
  onHover: (at) => hover(at),
});
const stage = new Stage(view, settings, { base: byId("map-base"), traffic: byId("map-traffic"), overlay });
const banner = new Banner(byId("banner"), byId("spoken"));
const actions = makeActions({ settings, view, stage, link, state });
const details = new Details(byId("details"), settings, stage, actions);
state.details = details;
const search = new Search(byId("search"), { select: (track) => actions.goTo(track), atQuery: () => actions.atQuery() });
const panels = new Panels({ settings, stage, view, state, actions, link });

// -- what comes in ---------------------------------------------------------------------------------------------------
function takeFrame(frame) {
  if (frame.frame !== state.newest?.frame) state.frames += 1;
  state.newest = frame;
  state.frameAt = performance.now();
  stage.take(frame, state.frameAt);
  if (document.hidden) link.shown(frame.frame); // nobody sees it, nothing is drawn
  if (settings.zoom === 0 && !state.placed) firstLook();
}

function takeWords(words) {
  if (words.type === "hello") {
    state.hello = words;
    byId("area").textContent = words.area || words.file || "";
    document.title = words.area ? `${words.area} – aeroskein` : "aeroskein";
    panels.hello(words);
    actions.restoreReplay();
  } else if (words.type === "status") {
    state.words = words;
    if (JSON.stringify(words.sensors) !== JSON.stringify(stage.sensors)) stage.setSensors(words.sensors);
    panels.words(words);
    if (settings.zoom === 0 && !state.placed) firstLook();
  }
  judge();
}

function fault(error) {
  state.faults.push(String(error));
  if (state.faults.length > 20) state.faults.shift();
}

// Look at the traffic and the sensors, until the user looks elsewhere; wide enough that a single aircraft has a place.
function firstLook() {
  const sites = stage.sensors.filter((sensor) => sensor.lat_deg != null);
  const extent = stage.traffic.extent();
  if (!extent && sites.length === 0) return;
  const box = extent ?? [90, 180, -90, -180];
  const include = (lat, lon, around) => {
    box[0] = Math.min(box[0], lat - around); box[1] = Math.min(box[1], lon - 1.5 * around);
    box[2] = Math.max(box[2], lat + around); box[3] = Math.max(box[3], lon + 1.5 * around);
  };
  for (const site of sites) include(site.lat_deg, site.lon_deg, 0.6);
  if (extent) include((box[0] + box[2]) / 2, (box[1] + box[3]) / 2, 0.5);
  state.placed = Boolean(extent);
  view.fit(...box);
  if (settings.view === "elements") actions.elementsPlace();
}

// -- what is drawn ---------------------------------------------------------------------------------------------------
stage.onDrawn((began) => {
  const frame = state.newest;
  if (frame && frame !== state.shown) {
    // A frame may come twice, for another view; it counts once.
    if (frame.frame !== state.shown?.frame) state.drawn += 1;
    state.shown = frame;
    state.ages.push(Date.now() / 1000 - frame.sent);
    if (state.ages.length > AGES) state.ages.shift();
    link.shown(frame.frame);
    afterFrame(frame, began);
  }
});

function afterFrame(frame, now) {
  byId("clock").textContent = clock(frame.time);
  byId("clock").title = `Time of the picture, UTC, ${date(frame.time)}`;
  const passed = stage.traffic.passed === frame.count ? "" : ` · ${count(stage.traffic.passed)} pass`;
  byId("tally").textContent = `${count(frame.total)} aircraft${frame.count < frame.total ? ` · ${count(frame.count)} in view` : ""}${passed}`;
  if (settings.follow) actions.follow();
  details.update(now);
  panels.frame(frame, now);
  const box = frame.count < frame.total || frame.total > 1500 ? view.box() : null;
  stage.trails.refresh(now, stage.trailNumbers(), box ?? view.box(), settings.trailtime, actions.at(), () => stage.invalidate());
  judge();
}

function judge() {
  banner.update({
    linkState: link?.state, frame: stage.traffic.frame, frameAt: state.frameAt, words: state.words, now: performance.now(),
    kind: state.hello?.kind,
  });
}

// -- the view --------------------------------------------------------------------------------------------------------
function viewChanged() {
  if (!stage) return;
  view.moving = true;
  stage.viewChanged();
  drawScale(byId("scale"), view, settings);
}

function viewRests() {
  view.moving = false;
  stage.invalidate("base", "labels");
  if (state.placed || settings.zoom !== 0) {
    state.placed = true;
    settings.set({ lat: round(view.lat), lon: round(view.lon), zoom: Math.round(view.zoom * 100) / 100 });
  }
  lookAtView();
}

function lookAtView() {
  const pinned = [...stage.selectedNumbers()].slice(0, 16);
  link.look(settings.inview || !settings.table ? view.box() : null, pinned);
}

function round(value) {
  return Math.round(value * 1e5) / 1e5;
}

function hover(at) {
  const row = at ? stage.pick(at.x, at.y) : -1;
  overlay.style.cursor = row >= 0 ? "pointer" : "crosshair";
  const place = at ? view.toPlace(at.x, at.y) : null;
  if (stage.ruler) stage.ruler.to = place;
  drawCursor(byId("cursor"), place, actions.cursorFrom(), settings, inverse);
  if (row !== stage.hover || stage.ruler) {
    stage.hover = row;
    stage.invalidate("labels");
  }
}

// -- settings --------------------------------------------------------------------------------------------------------
settings.onChange((changed) => {
  if (changed.has("theme") || changed.has("color")) drawLegend(byId("legend"), stage.legend());
  if (changed.has("units")) drawScale(byId("scale"), view, settings);
  if (changed.has("sel") || changed.has("table") || changed.has("inview")) lookAtView();
  if (changed.has("follow") && settings.follow) actions.follow();
  if (changed.has("view") && settings.view === "elements") actions.elementsPlace();
  showHint();
  details.update(performance.now());
  panels.settings(changed);
  const filters = activeFilters(settings);
  byId("filter-count").textContent = filters ? ` (${filters})` : "";
});

// For newcomers, until they have found out.
function showHint() {
  byId("hint").hidden = settings.sel !== "" || settings.panel !== "";
}

matchMedia("(prefers-color-scheme: light)").addEventListener("change", () => {
  stage.retheme();
  drawLegend(byId("legend"), stage.legend());
});
document.addEventListener("visibilitychange", () => stage.invalidate());
new ResizeObserver(([entry]) => stage.resize(entry.contentRect.width, entry.contentRect.height)).observe(byId("map"));
setInterval(judge, BANNER_MS);
listenToKeys(actions.keys(search));
drawLegend(byId("legend"), stage.legend());
if (!stage.webgl) fault("no WebGL2: aircraft are drawn on a 2D canvas");
if (settings.zoom !== 0) view.lookAt(settings.lat, settings.lon, settings.zoom);
stage.base.load("/static/map/world.bin").then(() => stage.invalidate("base"), fault);
panels.settings(new Set(["panel", "table", "view"]));
showHint();
exposeView({ settings, view, stage, link, banner, details, state });
