// Counts that get the palette's first and last colour: following the scene smoothly, taken from each frame, or fixed.

import { sharpCanvas } from "./canvas.js";

const BINS = 160;
const LEAST_SPAN_K = 1.0;  // a scene of uniform temperature is not stretched to noise
const CALM_S = 0.5;  // time constant of the automatic range

export class Range {
  constructor({ canvas, low, high, lowThumb, highThumb, changed }) {
    Object.assign(this, { canvas, changed, inputs: { low, high }, thumbs: { low: lowThumb, high: highThumb } });
    this.mode = "auto";
    this.low = 0;
    this.high = 0;  // counts; equal: nothing shown yet
    this.axis = null;  // counts at the ends of the scale
    this.histogram = new Uint32Array(65536);
    this.bins = new Float64Array(BINS);
    for (const end of ["low", "high"]) this.listen(end);
  }

  // Follows a frame. Uses both planes, so that one range suits both.
  follow(frame, unit) {
    this.unit = unit;
    const { histogram } = this;
    histogram.fill(0);
    for (const count of frame.sharp) ++histogram[count];
    for (const count of frame.raw) ++histogram[count];
    const all = 2 * frame.sharp.length;
    const [first, low, high, last] = quantiles(histogram, [1, all * 0.004, all * 0.996, all]);
    const wanted = this.mode === "frame" ? widen(first, last, unit) : widen(low, high, unit);
    this.followAxis(low, high, unit);
    if (this.mode === "fixed" && this.high > this.low) return;
    const now = performance.now();
    const share = this.mode === "auto" && this.high > this.low ? 1 - Math.exp((this.last - now) / 1000 / CALM_S) : 1;
    this.last = now;
    this.low += (wanted.low - this.low) * share;
    this.high += (wanted.high - this.high) * share;
  }

  // The scale leaves a margin around the values, and moves only when necessary.
  followAxis(first, last, unit) {
    const room = Math.max(unit.span(LEAST_SPAN_K), (last - first) * 0.3);
    const chosen = this.high > this.low ? this : { low: first, high: last };
    const need = { low: Math.min(first, chosen.low), high: Math.max(last, chosen.high) };
    const fits = this.axis && need.low >= this.axis.low && need.high <= this.axis.high &&
      need.high - need.low > 0.5 * (this.axis.high - this.axis.low);
    if (!fits) this.axis = { low: Math.max(0, need.low - room), high: Math.min(65535, need.high + room) };
  }

  set(end, count) {
    const least = this.unit ? this.unit.span(0.1) : 1;
    if (end === "low") this.low = Math.max(0, Math.min(count, this.high - least));
    else this.high = Math.min(65535, Math.max(count, this.low + least));
    this.mode = "fixed";
    this.changed();
  }

  paint(colours, ink) {
    if (!this.axis) return;
    const { canvas, axis } = this;
    const { context, ratio, width, height } = sharpCanvas(canvas);
    const bar = 16 * ratio;
    this.paintHistogram(context, width, height - bar - 3 * ratio, ink);
    const x = (count) => (count - axis.low) / (axis.high - axis.low) * width;
    const gradient = context.createLinearGradient(x(this.low), 0, x(this.high), 0);
    for (let i = 0; i <= 16; ++i) gradient.addColorStop(i / 16, css(colours[Math.round(i * 255 / 16)]));
    context.fillStyle = gradient;
    context.beginPath();
    context.roundRect(0, height - bar, width, bar, 4 * ratio);
    context.globalAlpha = 0.3;
    context.fill();
    context.globalAlpha = 1;
    context.fillRect(x(this.low), height - bar, x(this.high) - x(this.low), bar);
    this.place();
  }

  paintHistogram(context, width, height, ink) {
    const { axis, bins, histogram } = this;
    bins.fill(0);
    const step = BINS / (axis.high - axis.low);
    const end = Math.min(65535, Math.floor(axis.high));
    for (let count = Math.max(0, Math.ceil(axis.low)); count <= end; ++count) {
      bins[Math.min(BINS - 1, (count - axis.low) * step | 0)] += histogram[count];
    }
    const most = Math.sqrt(Math.max(...bins)) || 1;
    context.fillStyle = ink;
    context.globalAlpha = 0.45;
    context.beginPath();
    context.moveTo(0, height);
    bins.forEach((n, i) => context.lineTo((i + 0.5) / BINS * width, height - Math.sqrt(n) / most * (height - 1)));
    context.lineTo(width, height);
    context.fill();
    context.globalAlpha = 1;
  }

  place() {
    const { axis, unit } = this;
    for (const end of ["low", "high"]) {
      const thumb = this.thumbs[end];
      const share = (this[end] - axis.low) / (axis.high - axis.low);
      thumb.style.left = `${Math.min(1, Math.max(0, share)) * 100}%`;
      const words = unit.value(this[end]).toFixed(unit.kelvin ? 1 : 0);
      thumb.setAttribute("aria-valuenow", words);
      thumb.setAttribute("aria-valuetext", `${words} ${unit.name}`);
      if (document.activeElement !== this.inputs[end]) this.inputs[end].value = words;
    }
  }

  listen(end) {
    const thumb = this.thumbs[end];
    const input = this.inputs[end];
    thumb.addEventListener("pointerdown", (event) => thumb.setPointerCapture(event.pointerId));
    thumb.addEventListener("pointermove", (event) => {
      if (!thumb.hasPointerCapture(event.pointerId) || !this.axis) return;
      const box = this.canvas.getBoundingClientRect();
      this.set(end, this.axis.low + (event.clientX - box.left) / box.width * (this.axis.high - this.axis.low));
    });
    thumb.addEventListener("keydown", (event) => {
      const sign = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 }[event.key];
      if (!sign || !this.unit) return;
      event.preventDefault();
      event.stopPropagation();
      this.set(end, this[end] + sign * this.unit.span(event.shiftKey ? 1 : 0.1));
    });
    input.addEventListener("change", () => {
      const value = Number(input.value.replace(",", "."));
      if (input.value.trim() !== "" && Number.isFinite(value) && this.unit) this.set(end, this.unit.count(value));
      else this.place();
    });
  }
}

function widen(low, high, unit) {
  const lack = Math.max(0, unit.span(LEAST_SPAN_K) - (high - low)) / 2;
  return { low: low - lack, high: high + lack };
}

// The counts below or at which these numbers of values lie.
function quantiles(histogram, ranks) {
  const found = [];
  let passed = 0;
  for (let count = 0; count < 65536 && found.length < ranks.length; ++count) {
    passed += histogram[count];
    while (found.length < ranks.length && passed >= ranks[found.length]) found.push(count);
  }
  return found;
}

export function css(colour) {
  return `rgb(${colour & 255} ${colour >> 8 & 255} ${colour >> 16 & 255})`;
}
