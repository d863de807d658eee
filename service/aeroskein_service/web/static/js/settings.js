// Every setting of the view, with its default, and the same in the address bar: a link shows a colleague the same view.
//
// A setting is a string, a number or a boolean, as its default is. What differs from the default stands in the query part
// of the address; the map's place is written when the map rests. Listeners are told which settings have changed.

export const DEFAULTS = Object.freeze({
  // The map.
  lat: 0, lon: 0, zoom: 0, // zoom 0: not chosen yet, the map finds the traffic by itself
  theme: "auto", // auto | dark | light
  land: true, borders: true, grid: false, rings: true, ringstep: 50, // NM
  // Traffic.
  color: "source", // source | altitude | accuracy | age
  labels: 2, // 0 none, 1 callsign and level, 2 all
  density: 300, // labels at most
  vector: 60, // s of flight in the speed vector; 0 none
  trail: "auto", // none | selected | all | auto: all of a few aircraft
  trailtime: 120, // s
  smooth: true,
  units: "aero", // aero | metric
  qnh: 1013, transition: 5000, // hPa, feet
  // What is looked at.
  sel: "", // labels with commas between; the first one is the primary
  follow: false, isolate: false,
  view: "map", // map | elements
  frame: "strip", // of the element view: strip | plan
  panel: "", // sensors | filters | display | help
  table: false, inview: true, sort: "callsign", down: false,
  // Filters: what does not pass is dimmed and loses its label, never its symbol.
  q: "", altmin: "", altmax: "", bbox: "", sensor: "", status: "", source: "", emergency: false,
  // Replay.
  t: 0, speed: 1, paused: false,
});

const CHOICES = {
  theme: ["auto", "dark", "light"],
  color: ["source", "altitude", "accuracy", "age"],
  trail: ["auto", "none", "selected", "all"],
  units: ["aero", "metric"],
  view: ["map", "elements"],
  frame: ["strip", "plan"],
  panel: ["", "sensors", "filters", "display", "help"],
  status: ["", "tentative", "confirmed", "coasting"],
  source: ["", "adsb", "radar", "fused", "coasted", "suspect"],
};
const LIMITS = {
  lat: [-85, 85], lon: [-180, 180], zoom: [0, 19], labels: [0, 2], density: [0, 2000], vector: [0, 900],
  trailtime: [10, 3600], ringstep: [1, 500], qnh: [850, 1100], transition: [0, 60000], speed: [0.1, 1000], t: [0, 1e11],
};
const LONGEST = 200; // characters of a text

function parsed(name, text) {
  const usual = DEFAULTS[name];
  if (typeof usual === "boolean") return text === "1" || text === "true" ? true : text === "0" || text === "false" ? false : usual;
  if (typeof usual === "number") {
    const value = Number(text);
    const [low, high] = LIMITS[name] ?? [-Infinity, Infinity];
    return text !== "" && Number.isFinite(value) && value >= low && value <= high ? value : usual;
  }
  if (CHOICES[name]) return CHOICES[name].includes(text) ? text : usual;
  return text.slice(0, LONGEST);
}

function written(value) {
  if (typeof value === "boolean") return value ? "1" : "0";
  return typeof value === "number" ? String(Number(value.toFixed(5))) : value;
}

export class Settings {
  constructor(search = location.search) {
    Object.assign(this, DEFAULTS);
    this._listeners = [];
    this._timer = 0;
    for (const [name, text] of new URLSearchParams(search)) {
      if (name in DEFAULTS) this[name] = parsed(name, text);
    }
  }

  // Call `listener(changed)` with the set of names whenever something changes.
  onChange(listener) {
    this._listeners.push(listener);
  }

  // Change some settings; values that are as before change nothing.
  set(changes) {
    const changed = new Set();
    for (const [name, value] of Object.entries(changes)) {
      if (!(name in DEFAULTS)) throw new Error(`no setting ${name}`);
      if (this[name] !== value) {
        this[name] = value;
        changed.add(name);
      }
    }
    if (changed.size === 0) return;
    for (const listener of this._listeners) listener(changed);
    this._writeSoon();
  }

  toggle(name) {
    this.set({ [name]: !this[name] });
  }

  get selected() {
    return this.sel ? this.sel.split(",").filter(Boolean) : [];
  }

  get primary() {
    return this.selected[0] ?? "";
  }

  // The address of the view as it is now.
  query() {
    const parameters = new URLSearchParams();
    for (const [name, usual] of Object.entries(DEFAULTS)) {
      if (this[name] !== usual) parameters.set(name, written(this[name]));
    }
    return parameters.toString().replaceAll("%2C", ",");
  }

  _writeSoon() {
    clearTimeout(this._timer);
    // Browsers refuse more than some hundred changes of the address in half a minute.
    this._timer = setTimeout(() => {
      const query = this.query();
      history.replaceState(null, "", query ? `?${query}` : location.pathname);
    }, 250);
  }
}
