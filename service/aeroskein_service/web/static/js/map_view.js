// Where the map looks: centre and zoom, pixels from places and back, and the hand on mouse, wheel, touch and keyboard.

import { latOf, lonOf, mercatorX, mercatorY, unitsPerMetre, wrapLon, wrapped } from "./projection.js";

const TILE = 256; // pixels of the world at zoom 0, as everywhere on the web
const ZOOM_MAX = 19;
const CLICK_PX = 4; // a press that moves less is a click
const KEY_PX = 90;

export class MapView {
  // `element` takes the events; `onChange()` is called when the view has changed, `onRest()` a moment after the last change.
  constructor(element, { onChange, onRest, onClick, onHover }) {
    this._element = element;
    this._onChange = onChange;
    this._onRest = onRest;
    this._onClick = onClick;
    this._onHover = onHover;
    this._restTimer = 0;
    this._pointers = new Map();
    this.cx = 0.5;
    this.cy = 0.5;
    this.zoom = 2;
    this.width = 1;
    this.height = 1;
    this.moving = false;
    this._listen();
  }

  // -- geometry ------------------------------------------------------------------------------------------------------
  get zoom() { return this._zoom; }
  set zoom(value) {
    this._zoom = value;
    this.scale = TILE * 2 ** value; // pixels of the world; read in loops over all aircraft
  }

  get lat() { return latOf(this.cy); }
  get lon() { return wrapLon(lonOf(this.cx)); }

  screenX(x) { return wrapped(x - this.cx) * this.scale + this.width / 2; }
  screenY(y) { return (y - this.cy) * this.scale + this.height / 2; }

  toScreen(lat, lon) {
    return [this.screenX(mercatorX(lon)), this.screenY(mercatorY(lat))];
  }

  toPlace(px, py) {
    const x = this.cx + (px - this.width / 2) / this.scale;
    const y = this.cy + (py - this.height / 2) / this.scale;
    return { lat: latOf(Math.max(0, Math.min(1, y))), lon: wrapLon(lonOf(x)) };
  }

  get metresPerPixel() {
    return 1 / (this.scale * unitsPerMetre(this.lat));
  }

  // lat_min, lon_min, lat_max, lon_max with some margin, so that a small move shows nothing new; null for the whole world.
  box(margin = 0.15) {
    const w = (this.width / this.scale) * (1 + 2 * margin);
    if (w >= 0.95) return null;
    const h = (this.height / this.scale) * (1 + 2 * margin);
    const south = latOf(Math.min(1, this.cy + h / 2)), north = latOf(Math.max(0, this.cy - h / 2));
    return [south, wrapLon(lonOf(this.cx - w / 2)), north, wrapLon(lonOf(this.cx + w / 2))];
  }

  // -- moving --------------------------------------------------------------------------------------------------------
  resize(width, height) {
    this.width = width;
    this.height = height;
    this._settle();
  }

  lookAt(lat, lon, zoom = this.zoom) {
    this.cx = mercatorX(lon);
    this.cy = mercatorY(lat);
    this.zoom = zoom;
    this._settle();
  }

  // Show a box of places with room around it.
  fit(latMin, lonMin, latMax, lonMax) {
    const w = Math.max(Math.abs(mercatorX(lonMax) - mercatorX(lonMin)), 1e-5);
    const h = Math.max(Math.abs(mercatorY(latMin) - mercatorY(latMax)), 1e-5);
    const zoom = Math.log2(Math.min((this.width * 0.8) / w, (this.height * 0.8) / h) / TILE);
    this.lookAt((latMin + latMax) / 2, (lonMin + lonMax) / 2, Math.min(zoom, 14));
  }

  pan(dx, dy) {
    this.cx += dx / this.scale;
    this.cy += dy / this.scale;
    this._settle();
  }

  zoomBy(steps, px = this.width / 2, py = this.height / 2) {
    const before = this.scale;
    this.zoom = Math.max(this._zoomMin(), Math.min(ZOOM_MAX, this.zoom + steps));
    const k = 1 / before - 1 / this.scale;
    this.cx += (px - this.width / 2) * k;
    this.cy += (py - this.height / 2) * k;
    this._settle();
  }

  _zoomMin() {
    return Math.log2(Math.max(this.width, 300) / TILE);
  }

  _settle() {
    this.zoom = Math.max(this._zoomMin(), Math.min(ZOOM_MAX, this.zoom));
    this.cx -= Math.floor(this.cx);
    const half = this.height / 2 / this.scale;
    this.cy = half >= 0.5 ? 0.5 : Math.max(half, Math.min(1 - half, this.cy));
    this._onChange();
    clearTimeout(this._restTimer);
    this._restTimer = setTimeout(() => this._onRest(), 150);
  }

  // -- hands ---------------------------------------------------------------------------------------------------------
  _listen() {
    const on = (name, handler, options) => this._element.addEventListener(name, handler, options);
    on("wheel", (event) => {
      event.preventDefault();
      const pixels = event.deltaMode === 1 ? event.deltaY * 20 : event.deltaY;
      this.zoomBy(Math.max(-1, Math.min(1, -pixels / 240)), event.offsetX, event.offsetY);
    }, { passive: false });
    on("pointerdown", (event) => this._press(event));
    on("pointermove", (event) => this._move(event));
    on("pointerup", (event) => this._release(event));
    on("pointercancel", (event) => this._pointers.delete(event.pointerId));
    on("pointerleave", () => this._onHover(null));
    on("dblclick", (event) => this.zoomBy(1, event.offsetX, event.offsetY));
    on("keydown", (event) => this._key(event));
  }

  _press(event) {
    this._element.setPointerCapture(event.pointerId);
    this._element.focus({ preventScroll: true });
    this._pointers.set(event.pointerId, { x: event.offsetX, y: event.offsetY, x0: event.offsetX, y0: event.offsetY, far: false });
  }

  _move(event) {
    const finger = this._pointers.get(event.pointerId);
    if (!finger) {
      this._onHover({ x: event.offsetX, y: event.offsetY });
      return;
    }
    const dx = event.offsetX - finger.x, dy = event.offsetY - finger.y;
    finger.far ||= Math.hypot(event.offsetX - finger.x0, event.offsetY - finger.y0) > CLICK_PX;
    if (!finger.far) return;
    if (this._pointers.size === 2) {
      const other = [...this._pointers.values()].find((p) => p !== finger);
      const before = Math.hypot(finger.x - other.x, finger.y - other.y);
      const after = Math.hypot(event.offsetX - other.x, event.offsetY - other.y);
      if (before > 0 && after > 0) this.zoomBy(Math.log2(after / before), (event.offsetX + other.x) / 2, (event.offsetY + other.y) / 2);
    } else {
      this.pan(-dx, -dy);
    }
    finger.x = event.offsetX;
    finger.y = event.offsetY;
  }

  _release(event) {
    const finger = this._pointers.get(event.pointerId);
    this._pointers.delete(event.pointerId);
    if (finger && !finger.far) this._onClick({ x: event.offsetX, y: event.offsetY, add: event.shiftKey || event.ctrlKey || event.metaKey });
  }

  _key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const move = {
      ArrowLeft: () => this.pan(-KEY_PX, 0), ArrowRight: () => this.pan(KEY_PX, 0),
      ArrowUp: () => this.pan(0, -KEY_PX), ArrowDown: () => this.pan(0, KEY_PX),
      "+": () => this.zoomBy(0.5), "=": () => this.zoomBy(0.5), "-": () => this.zoomBy(-0.5), _: () => this.zoomBy(-0.5),
    }[event.key];
    if (move) {
      event.preventDefault();
      move();
    }
  }
}
