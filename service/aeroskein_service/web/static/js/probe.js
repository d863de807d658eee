// `window.__view`: what the page shows, in numbers, for tests and for the curious. Nothing in the page reads it.

export function exposeView({ settings, view, stage, link, banner, details, state }) {
  window.__view = {
    get ready() { return state.hello !== null && stage.traffic.frame.frame > 0 && stage.draws > 0; },
    get kind() { return state.hello?.kind ?? null; },
    get connected() { return link.state === "open"; },
    get connects() { return link.connects; },
    get webgl() { return stage.webgl; },
    get frame() { return stage.traffic.frame.frame; },
    get time() { return stage.traffic.frame.time; },
    get frames() { return state.frames; },
    get drawn() { return state.drawn; },
    get skipped() { return stage.traffic.frame.skipped; },
    get total() { return stage.traffic.frame.total; },
    get count() { return stage.traffic.count; },
    get passed() { return stage.traffic.passed; },
    get bytes() { return stage.traffic.frame.bytes; },
    get resting() { return !view.moving && !stage.waiting; }, // nothing is to be drawn but what time brings
    get draws() { return stage.draws; },
    get drawMs() { return stage.medianDraw(); },
    get parts() { return { ...stage.parts }; },
    get drawTimes() { return [...stage.times]; },
    get ages() { return [...state.ages]; },
    get labels() { return stage.labels.drawn; },
    get mapArcs() { return stage.base.arcs; },
    get trails() { return stage.trails.trails.size; },
    get layers() { return stage.base.userLayers.map((layer) => layer.name); },
    get selected() { return settings.selected; },
    get details() { return details.whole; },
    get elements() { return state.elements?.numbers() ?? null; },
    get replay() { return state.replay?.numbers() ?? null; },
    get table() { return state.table?.numbers() ?? null; },
    get sensors() { return stage.sensors.map((sensor) => sensor.id); },
    get words() { return state.words; },
    get banner() { return { kind: banner.kind, text: banner.text }; },
    get faults() { return [...state.faults]; },
    get centre() { return { lat: view.lat, lon: view.lon, zoom: view.zoom }; },
    get query() { return settings.query(); },
    // Where a track is in the picture and on the map's canvas.
    track(label) {
      const frame = stage.traffic.frame, row = frame.find(label);
      if (row < 0) return null;
      const [x, y] = stage.traffic.at(row, stage.traffic.moved(performance.now()));
      return {
        label: frame.label(row), callsign: frame.callsign(row), code: frame.codeText(row), lat: frame.lat(row), lon: frame.lon(row),
        altitude: frame.altitude(row), speed: frame.speed(row), angle: frame.angle(row), sigma: frame.sigma(row),
        status: frame.status(row), source: stage.traffic.source[row], passes: stage.traffic.passes[row] === 1,
        sensors: frame.sensors(row), x: view.screenX(x), y: view.screenY(y),
      };
    },
    get tracks() {
      return Array.from({ length: stage.traffic.count }, (_, i) => stage.traffic.frame.label(i));
    },
  };
}
