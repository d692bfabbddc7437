// Parses a frame of /api/frame and converts its counts.

const KELVIN = 0;
export const FLAGS = { gap: 1, warmUp: 2, nuc: 4, saturated: 8, jitter: 16, reduced: 32, inverse: 64, raw: 128 };

export function parseFrame(buffer) {
  const head = new DataView(buffer);
  if (head.getUint32(0, true) !== 0x464c4f42) throw new Error("not a frame");
  const width = head.getUint32(8, true);
  const height = head.getUint32(12, true);
  const bytes = head.getUint16(4, true);
  return {
    kelvin: head.getUint16(6, true) === KELVIN,
    width, height,
    scale: head.getFloat64(16, true),
    offset: head.getFloat64(24, true),
    epoch: Number(head.getBigUint64(32, true)),
    number: Number(head.getBigUint64(40, true)),
    id: Number(head.getBigUint64(48, true)),
    age_ms: head.getFloat64(64, true),
    flags: head.getUint32(72, true),
    rowStep: head.getUint32(76, true),
    raw: new Uint16Array(buffer, bytes, width * height),
    sharp: new Uint16Array(buffer, bytes + 2 * width * height, width * height),
    utc_ms: Number(head.getBigInt64(88, true) / 1000n) / 1000, // 0: unknown
    motion: motionOf(buffer, bytes + 4 * width * height, head.getUint32(80, true), head.getUint32(84, true)),
    at: new Date(),
  };
}

// x, y (px per frame) and confidence of each block of 8x8 pixels; null: unknown for this frame.
function motionOf(buffer, begin, across, down) {
  return across > 0 ? { across, down, values: new Float32Array(buffer, begin, 3 * across * down) } : null;
}

const ZERO_CELSIUS = 273.15;

// Converts counts to the displayed unit and back.
export class Unit {
  constructor(frame, celsius) {
    this.kelvin = frame.kelvin;
    this.scale = frame.kelvin ? frame.scale : 1;
    this.offset = frame.kelvin ? frame.offset - (celsius ? ZERO_CELSIUS : 0) : 0;
    this.name = frame.kelvin ? (celsius ? "°C" : "K") : "counts";
    this.digits = frame.kelvin ? 2 : 0;
  }
  value(count) { return count * this.scale + this.offset; }
  count(value) { return (value - this.offset) / this.scale; }
  span(kelvin) { return this.kelvin ? kelvin / this.scale : kelvin * 100; }
  words(count, digits = this.digits) { return `${this.value(count).toFixed(digits)} ${this.name}`; }
}

// A value at one place, in both units.
export function bothUnits(frame, count) {
  if (!frame.kelvin) return `${count} counts`;
  const kelvin = count * frame.scale + frame.offset;
  return `${(kelvin - ZERO_CELSIUS).toFixed(2)} °C  ${kelvin.toFixed(2)} K`;
}
