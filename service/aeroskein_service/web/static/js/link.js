// The connection to the server: frames and words come in, wishes go out, and it comes back by itself when it breaks.

import { Frame } from "./frame.js";

const AGAIN_MS = [500, 1000, 2000, 5000];
const VIEW_MS = 120; // wishes about the map's extent are sent this often at most

export class Link {
  // `handlers`: frame(Frame), words(object), state("open" | "closed" | "refused"), fault(Error).
  constructor(handlers, url = `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws`) {
    this._handlers = handlers;
    this._url = url;
    this._tries = 0;
    this._view = null;
    this._viewTimer = 0;
    this.state = "closed";
    this.connects = 0;
    this._open();
  }

  _open() {
    const socket = new WebSocket(this._url);
    socket.binaryType = "arraybuffer";
    this._socket = socket;
    socket.onopen = () => {
      this._tries = 0;
      this.connects += 1;
      this._say("open");
      if (this._view) this._send(this._view);
    };
    socket.onmessage = (event) => {
      try {
        if (typeof event.data === "string") this._handlers.words(JSON.parse(event.data));
        else this._handlers.frame(new Frame(event.data));
      } catch (error) {
        this._handlers.fault(error);
      }
    };
    socket.onclose = () => {
      this._say("closed");
      const wait = AGAIN_MS[Math.min(this._tries++, AGAIN_MS.length - 1)];
      setTimeout(() => this._open(), wait);
    };
  }

  _say(state) {
    if (state === this.state) return;
    this.state = state;
    this._handlers.state(state);
  }

  _send(message) {
    if (this._socket.readyState === WebSocket.OPEN) this._socket.send(JSON.stringify(message));
  }

  // A frame has been drawn; the server may send the next.
  shown(frame) {
    this._send({ type: "shown", frame });
  }

  // What the map shows; null asks for everything.
  look(box, pinned) {
    this._view = { type: "view", box, pinned };
    if (this._viewTimer) return;
    this._viewTimer = setTimeout(() => {
      this._viewTimer = 0;
      this._send(this._view);
    }, VIEW_MS);
  }

  seek(time) {
    this._send({ type: "seek", time_s: time });
  }

  play(on, speed) {
    this._send({ type: "play", on, speed });
  }
}
