// One binary frame of the WebSocket, read in place: the server's records seen through typed arrays, nothing copied.
//
// The layout is that of `records.py` and `frames.py`, little endian; docs/web.md has the table.

export const VERSION = 1;

export const STATUS = ["tentative", "confirmed", "coasting", "terminated"];
export const FLAG = {
  coasted: 1, guarded: 2, bias_uncertain: 4, adsb_unverified: 8, adsb_suspect: 16, duplicate_address: 32, on_ground: 64,
};
const RECORD_BYTES = 52;
const WORDS = RECORD_BYTES / 4;
const HALVES = RECORD_BYTES / 2;
const NO_ADDRESS = 0xffffffff;

export class Frame {
  // Raises an Error for bytes that are no frame of this version.
  constructor(buffer) {
    const head = new DataView(buffer);
    if (head.getUint8(0) !== VERSION) throw new Error(`the server sends version ${head.getUint8(0)}, this page reads ${VERSION}`);
    const start = head.getUint16(2, true);
    this.frame = head.getUint32(4, true);
    this.time = head.getFloat64(8, true); // the instant it shows, s
    this.sent = head.getFloat64(16, true); // when it was made, s
    this.total = head.getUint32(24, true);
    this.count = head.getUint32(28, true);
    this.skipped = head.getUint32(32, true);
    this.silent = head.getFloat32(36, true);
    this.playing = head.getUint8(40) !== 0;
    this.connected = head.getUint8(41) !== 0;
    this.pace = head.getFloat32(44, true); // of a replay, times real time
    if (head.getUint16(42, true) !== RECORD_BYTES || buffer.byteLength !== start + this.count * RECORD_BYTES) {
      throw new Error("the frame has another length than its head says");
    }
    this.bytes = buffer.byteLength;
    const n = this.count;
    this._u32 = new Uint32Array(buffer, start, n * WORDS);
    this._i32 = new Int32Array(buffer, start, n * WORDS);
    this._f32 = new Float32Array(buffer, start, n * WORDS);
    this._u16 = new Uint16Array(buffer, start, n * HALVES);
    this._i16 = new Int16Array(buffer, start, n * HALVES);
    this._u8 = new Uint8Array(buffer, start, n * RECORD_BYTES);
  }

  static empty() {
    const buffer = new ArrayBuffer(48);
    const head = new DataView(buffer);
    head.setUint8(0, VERSION);
    head.setUint16(2, 48, true);
    head.setUint16(42, RECORD_BYTES, true);
    return new Frame(buffer);
  }

  number(i) { return this._u32[i * WORDS]; }
  lat(i) { return this._i32[i * WORDS + 1] * 1e-7; }
  lon(i) { return this._i32[i * WORDS + 2] * 1e-7; }
  altitude(i) { return this._f32[i * WORDS + 3]; } // m, NaN where unknown
  sigma(i) { return this._f32[i * WORDS + 4]; } // m
  speed(i) { const v = this._u16[i * HALVES + 10]; return v === 0xffff ? NaN : v * 0.1; } // m/s
  angle(i) { return this._u16[i * HALVES + 11] * (360 / 65536); } // degrees
  rate(i) { const v = this._i16[i * HALVES + 12]; return v === -0x8000 ? NaN : v * 0.01; } // m/s
  age(i) { return this._i16[i * HALVES + 13] * 0.01; } // s before `time`
  sensors(i) { return this._u32[i * WORDS + 7]; }
  flags(i) { return this._u16[i * HALVES + 16]; }
  code(i) { return this._u16[i * HALVES + 17]; } // Mode A as a number, 0xffff where unknown
  status(i) { return this._u8[i * RECORD_BYTES + 36]; }
  master(i) { const v = this._u8[i * RECORD_BYTES + 37]; return v > 127 ? v - 256 : v; }
  heard(i) { return this._u8[i * RECORD_BYTES + 39]; } // s since the newest report
  named(i) { return (this._u8[i * RECORD_BYTES + 38] & 1) === 1; }
  addressNumber(i) { return this._u32[i * WORDS + 10]; }

  callsign(i) {
    const start = i * RECORD_BYTES + 44;
    let text = "";
    for (let k = start; k < start + 8 && this._u8[k] !== 0; k++) text += String.fromCharCode(this._u8[k]);
    return text.trim();
  }

  address(i) {
    const value = this.addressNumber(i);
    return value === NO_ADDRESS ? "" : hex6(value);
  }

  codeText(i) {
    const value = this.code(i);
    return value === 0xffff ? "" : value.toString(8).padStart(4, "0");
  }

  // The chunk of the track's key: address, or T and the number.
  label(i) {
    return this.named(i) ? hex6(this.addressNumber(i)) : `T${String(this.number(i)).padStart(6, "0")}`;
  }

  // What people call it.
  name(i) {
    return this.callsign(i) || this.label(i);
  }

  emergency(i) {
    const code = this.code(i);
    return code === 0o7500 || code === 0o7600 || code === 0o7700;
  }

  // The row of a track by its label, -1 where it is not in the frame.
  find(label) {
    const byNumber = /^T(\d+)$/.exec(label);
    const wanted = byNumber ? Number(byNumber[1]) : parseInt(label, 16);
    if (!Number.isFinite(wanted)) return -1;
    for (let i = 0; i < this.count; i++) {
      if (byNumber ? this.number(i) === wanted && !this.named(i) : this.addressNumber(i) === wanted && this.named(i)) return i;
    }
    return -1;
  }
}

function hex6(value) {
  return value.toString(16).toUpperCase().padStart(6, "0");
}
