// The last seconds of the pinned pixel, without skipping frames: blurred and deblurred.

import { sharpCanvas } from "./canvas.js";

const KEPT_S = 8;

export class Trace {
  // Curves and axes have the colours of the elements `raw`, `sharp` and `axis`.
  constructor({ canvas, raw, sharp, axis }) {
    Object.assign(this, { canvas, colours: { raw, sharp, axis } });
    this.span_s = KEPT_S;  // shown
    this.clear();
    new ResizeObserver(() => this.paint()).observe(canvas);
  }

  clear() {
    this.t_s = [];
    this.raw = [];
    this.sharp = [];
    this.period_s = 0;
  }

  add(samples, fresh) {
    if (fresh) this.clear();
    this.period_s = samples.period_s;
    this.t_s.push(...samples.t_s);
    this.raw.push(...samples.raw);
    this.sharp.push(...samples.deblurred);
    const newest = this.t_s.at(-1);
    let old = 0;
    while (old < this.t_s.length && (this.t_s[old] < newest - KEPT_S || this.t_s[old] > newest)) ++old;
    for (const list of [this.t_s, this.raw, this.sharp]) list.splice(0, old);
  }

  last() {
    return this.t_s.length ? { raw: this.raw.at(-1), sharp: this.sharp.at(-1) } : null;
  }

  paint(unit = this.unit) {
    if (!unit) return;
    this.unit = unit;
    const { canvas } = this;
    const { context, ratio, width, height } = sharpCanvas(canvas);
    context.font = `${12 * ratio}px system-ui, "DejaVu Sans", sans-serif`;
    const ticks = niceTicks(...this.bounds(unit), height / ratio < 200 ? 4 : 5);
    const box = { left: 52 * ratio, right: width - 12 * ratio, top: 20 * ratio, bottom: height - 36 * ratio };
    const newest = this.t_s.at(-1) ?? 0;
    const x = (t) => box.right + (t - newest) / this.span_s * (box.right - box.left);
    const y = (value) => box.bottom - (value - ticks.low) / (ticks.high - ticks.low) * (box.bottom - box.top);
    this.paintAxes(context, box, ticks, x, y, newest, ratio);
    context.save();
    context.beginPath();
    context.rect(box.left, 0, box.right - box.left + 2 * ratio, height);
    context.clip();
    this.paintCurve(context, this.raw, this.colours.raw, 1.5 * ratio, x, (count) => y(unit.value(count)));
    this.paintCurve(context, this.sharp, this.colours.sharp, 1.5 * ratio, x, (count) => y(unit.value(count)));
    context.restore();
  }

  bounds(unit) {
    let low = Infinity;
    let high = -Infinity;
    const oldest = (this.t_s.at(-1) ?? 0) - this.span_s;
    this.t_s.forEach((t, i) => {
      if (t < oldest) return;
      low = Math.min(low, this.raw[i], this.sharp[i]);
      high = Math.max(high, this.raw[i], this.sharp[i]);
    });
    if (low > high) return [unit.value(0), unit.value(0) + 1];
    const room = Math.max((high - low) * 0.06, unit.span(0.25));
    return [unit.value(low - room), unit.value(high + room)];
  }

  paintAxes(context, box, ticks, x, y, newest, ratio) {
    const colour = getComputedStyle(this.colours.axis).color;
    context.fillStyle = colour;
    context.strokeStyle = colour;
    context.lineWidth = ratio;
    context.textBaseline = "middle";
    context.textAlign = "right";
    for (const value of ticks.values) {
      const at = Math.round(y(value)) + 0.5;
      context.globalAlpha = 0.22;
      context.beginPath();
      context.moveTo(box.left, at);
      context.lineTo(box.right, at);
      context.stroke();
      context.globalAlpha = 1;
      context.fillText(value.toFixed(ticks.digits), box.left - 8 * ratio, at);
    }
    context.textAlign = "center";
    for (let i = 0; i <= 4; ++i) {
      const s = i / 4 * this.span_s;
      const at = Math.min(x(newest - s), box.right - 8 * ratio);
      context.fillText(i === 0 ? "now" : `−${s}`, at, box.bottom + 13 * ratio);
    }
    context.fillText("seconds", (box.left + box.right) / 2, box.bottom + 28 * ratio);
    context.textAlign = "left";
    context.fillText(this.unit.name, box.left - 44 * ratio, 8 * ratio);
  }

  // Lost frames are gaps in the curve.
  paintCurve(context, counts, element, width, x, y) {
    context.strokeStyle = getComputedStyle(element).color;
    context.lineWidth = width;
    context.lineJoin = "round";
    context.beginPath();
    let before = -Infinity;
    counts.forEach((count, i) => {
      const t = this.t_s[i];
      if (t - before > 1.6 * this.period_s) context.moveTo(x(t), y(count));
      else context.lineTo(x(t), y(count));
      before = t;
    });
    context.stroke();
  }
}

// Some `about` round values that cover low to high.
function niceTicks(low, high, about) {
  const rough = (high - low) / about;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= rough);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const first = Math.floor(low / step);
  const last = Math.ceil(high / step);
  const values = Array.from({ length: last - first + 1 }, (_, i) => (first + i) * step);
  return { values, digits, low: first * step, high: last * step };
}
