// What the user can do, by mouse, key or button: select, follow, go somewhere, change a setting step by step, replay.

const VECTORS = [0, 60, 120, 300];
const COLOURS = ["source", "altitude", "accuracy", "age"];
const TRAILS = ["auto", "none", "selected", "all"];
const CLOSE_ZOOM = 9;
const STEP_S = 10;

export function makeActions({ settings, view, stage, link, state }) {
  const next = (list, value) => list[(list.indexOf(value) + 1) % list.length];

  const actions = {
    select(labels) {
      settings.set({ sel: labels.join(","), ...(labels.length ? {} : { follow: false, isolate: false, view: "map" }) });
    },

    click(at) {
      const row = stage.pick(at.x, at.y);
      if (row < 0) {
        if (!at.add) actions.select([]);
        return;
      }
      const label = stage.traffic.frame.label(row);
      if (!at.add) actions.select([label]);
      else actions.select(settings.selected.includes(label) ? settings.selected.filter((l) => l !== label) : [...settings.selected, label]);
    },

    // Select a track the server has found and bring it into view.
    goTo(track) {
      state.placed = true;
      view.lookAt(track.lat_deg, track.lon_deg, Math.max(view.zoom, CLOSE_ZOOM));
      actions.select([track.track]);
    },

    // The next or previous aircraft in view that passes the filters, from left to right.
    step(direction) {
      const traffic = stage.traffic, moved = traffic.moved(performance.now());
      const rows = [];
      for (let i = 0; i < traffic.count; i++) {
        if (!traffic.passes[i]) continue;
        const [mx, my] = traffic.at(i, moved);
        const x = view.screenX(mx), y = view.screenY(my);
        if (x >= 0 && y >= 0 && x <= view.width && y <= view.height) rows.push({ label: traffic.frame.label(i), x });
      }
      if (!rows.length) return;
      rows.sort((a, b) => a.x - b.x || (a.label < b.label ? -1 : 1));
      const at = rows.findIndex((row) => row.label === settings.primary);
      const to = at < 0 ? (direction > 0 ? 0 : rows.length - 1) : (at + direction + rows.length) % rows.length;
      actions.select([rows[to].label]);
      document.getElementById("spoken").textContent = `${traffic.frame.name(traffic.frame.find(rows[to].label))} selected`;
    },

    follow() {
      const row = stage.traffic.frame.find(settings.primary);
      if (row < 0) return;
      state.placed = true;
      view.lookAt(stage.traffic.frame.lat(row), stage.traffic.frame.lon(row));
    },

    // The map beside the elements shows where they are.
    elementsPlace() {
      const row = stage.traffic.frame.find(settings.primary);
      if (row >= 0) view.lookAt(stage.traffic.frame.lat(row), stage.traffic.frame.lon(row), Math.max(view.zoom, CLOSE_ZOOM));
    },

    toggleElements() {
      if (!settings.primary) return;
      settings.set({ view: settings.view === "elements" ? "map" : "elements" });
    },

    showAll() {
      const extent = stage.traffic.extent();
      settings.set({ follow: false });
      if (extent) view.fit(...extent);
    },

    panel(name) {
      settings.set({ panel: settings.panel === name ? "" : name });
    },

    ruler() {
      const row = stage.traffic.frame.find(settings.primary);
      const from = row >= 0 ? { lat: stage.traffic.frame.lat(row), lon: stage.traffic.frame.lon(row) } : { lat: view.lat, lon: view.lon };
      stage.ruler = stage.ruler ? null : { from, to: null };
      stage.invalidate();
    },

    // Where the cursor's bearing and distance are counted from: the selected aircraft, else the first radar.
    cursorFrom() {
      const row = stage.traffic.frame.find(settings.primary);
      if (row >= 0) return { lat: stage.traffic.frame.lat(row), lon: stage.traffic.frame.lon(row), name: stage.traffic.frame.name(row) };
      const site = stage.sensors.find((sensor) => sensor.lat_deg != null);
      return site ? { lat: site.lat_deg, lon: site.lon_deg, name: site.id } : null;
    },

    escape() {
      if (stage.ruler) actions.ruler();
      else if (settings.view === "elements") settings.set({ view: "map" });
      else if (settings.panel) settings.set({ panel: "" });
      else actions.select([]);
    },

    // -- replay ------------------------------------------------------------------------------------------------------
    isReplay: () => state.hello?.kind === "replay",
    at: () => (state.hello?.kind === "replay" ? stage.traffic.frame.time : null),
    atQuery: () => (state.hello?.kind === "replay" ? `?at=${stage.traffic.frame.time}` : ""),

    play(on, speed = settings.speed) {
      if (!actions.isReplay()) return false;
      settings.set({ paused: !on, speed, ...(on ? {} : { t: Math.round(stage.traffic.frame.time * 10) / 10 }) });
      link.play(on, speed);
      return true;
    },

    jump(time) {
      if (!actions.isReplay()) return false;
      settings.set({ t: Math.round(time * 10) / 10 });
      link.seek(time);
      stage.trails.hurry();
      return true;
    },

    // After a connection: the replay goes where the address says.
    restoreReplay() {
      if (!actions.isReplay()) return;
      if (settings.t > 0) link.seek(settings.t);
      link.play(!settings.paused, settings.speed);
    },

    keys(search) {
      const set = (changes) => () => settings.set(changes());
      return {
        "/": () => search.focus(),
        n: () => actions.step(1), p: () => actions.step(-1),
        Escape: () => actions.escape(),
        e: () => actions.toggleElements(),
        o: () => settings.primary && settings.toggle("follow"),
        i: () => settings.primary && settings.toggle("isolate"),
        0: () => actions.showAll(),
        m: () => actions.ruler(),
        t: () => settings.toggle("table"),
        s: () => actions.panel("sensors"), f: () => actions.panel("filters"), d: () => actions.panel("display"), "?": () => actions.panel("help"),
        l: set(() => ({ labels: (settings.labels + 1) % 3 })),
        v: set(() => ({ vector: next(VECTORS, settings.vector) })),
        h: set(() => ({ trail: next(TRAILS, settings.trail) })),
        c: set(() => ({ color: next(COLOURS, settings.color) })),
        g: () => settings.toggle("grid"),
        r: () => settings.toggle("rings"),
        x: set(() => ({ theme: stage.colours.dark ? "light" : "dark" })),
        " ": () => actions.play(settings.paused),
        ",": () => actions.jump(stage.traffic.frame.time - STEP_S),
        ".": () => actions.jump(stage.traffic.frame.time + STEP_S),
      };
    },
  };
  return actions;
}
