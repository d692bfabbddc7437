// The picture: two planes of a frame through a palette, zoomed and panned, with a divider, a cursor and a pin.

import { paintArrows } from "./arrows.js";
import { pixelRatio } from "./canvas.js";
import { fillTable } from "./palettes.js";

const MAX_ZOOM = 40;
const GAP = 6;  // between two panes, CSS pixels
const CLICK = 5;  // a pointer that moved less counts as a click

export class Picture {
  // Calls changed(what) when "cursor", "pin", "divider" or "zoom" changes.
  constructor({ stage, canvas, divider, changed }) {
    Object.assign(this, { stage, canvas, divider, changed });
    this.context = canvas.getContext("2d", { alpha: false });
    this.planes = { raw: document.createElement("canvas"), sharp: document.createElement("canvas") };
    this.table = new Uint32Array(65536);
    this.mode = "divider";
    this.arrows = false;  // show the scene's motion
    this.split = 0.5;
    this.zoom = 1;
    this.centre = null;  // frame pixels
    this.cursor = null;  // pixel {x, y}; byKeys: draw it, as no pointer shows it
    this.pin = null;
    this.frame = null;
    this.pointers = new Map();
    this.listen();
    new ResizeObserver(() => this.resize()).observe(stage);
  }

  show(frame) {
    const other = !this.frame || this.frame.width !== frame.width || this.frame.height !== frame.height;
    this.frame = frame;
    if (other) {
      this.centre = { x: frame.width / 2, y: frame.height / 2 };
      this.zoom = 1;
      this.resize();
    }
  }

  colour(colours, low, high) { fillTable(this.table, colours, low, high); }

  // Sets the stage's height so that the picture has its full width, within bounds; the canvas is in device pixels.
  resize() {
    if (!this.frame) return;
    const width = this.stage.clientWidth;
    const one = width * this.frame.height * this.frame.rowStep / this.frame.width;
    const stacked = this.mode === "both" && this.stacked();
    const wanted = stacked ? 2 * one + GAP : this.mode === "both" ? one / 2 : one;
    const height = Math.round(Math.min(Math.max(wanted, width < 620 ? 130 : 170), Math.max(240, innerHeight * 0.66)));
    this.stage.style.setProperty("--stage-height", `${height}px`);
    this.ratio = pixelRatio();
    this.canvas.width = Math.round(width * this.ratio);
    this.canvas.height = Math.round(height * this.ratio);
    this.paint();
  }

  stacked() { return this.frame.width > 1.6 * this.frame.height * this.frame.rowStep; }

  setMode(mode) {
    this.mode = mode;
    this.divider.hidden = mode !== "divider";
    this.resize();
  }

  setSplit(split) {
    this.split = Math.min(1, Math.max(0, split));
    this.divider.style.left = `${this.split * 100}%`;
    this.divider.setAttribute("aria-valuenow", Math.round(this.split * 100));
    this.changed("divider");
  }

  // Rectangles of the canvas, in device pixels, and the plane that each shows.
  panes() {
    const { width, height } = this.canvas;
    const gap = Math.round(GAP * this.ratio);
    if (this.mode === "both" && this.stacked()) {
      const half = (height - gap) / 2;
      const pane = { x: 0, width, height: half };
      return [{ plane: "raw", y: 0, ...pane }, { plane: "sharp", y: half + gap, ...pane }];
    }
    if (this.mode === "both") {
      const half = (width - gap) / 2;
      const pane = { y: 0, width: half, height };
      return [{ plane: "raw", x: 0, ...pane }, { plane: "sharp", x: half + gap, ...pane }];
    }
    const whole = { x: 0, y: 0, width, height };
    if (this.mode !== "divider") return [{ plane: this.mode, ...whole }];
    const edge = this.split * width;
    return [{ plane: "raw", ...whole, clip: [0, edge] }, { plane: "sharp", ...whole, clip: [edge, width] }];
  }

  // Device pixels per frame pixel; at zoom 1 the whole frame fits.
  scale(pane) {
    return this.zoom * Math.min(pane.width / this.frame.width, pane.height / (this.frame.height * this.frame.rowStep));
  }

  paint() {
    if (!this.frame || !this.centre) return;
    const { context, frame } = this;
    context.fillStyle = "#0b0a0c";
    context.fillRect(0, 0, this.canvas.width, this.canvas.height);
    context.imageSmoothingEnabled = false;
    const panes = this.panes();
    for (const plane of new Set(panes.map((pane) => pane.plane))) this.render(plane);
    for (const pane of panes) {
      const [from, to] = pane.clip ?? [pane.x, pane.x + pane.width];
      const s = this.scale(pane);
      const left = pane.x + pane.width / 2 - this.centre.x * s;
      const top = pane.y + pane.height / 2 - this.centre.y * s * frame.rowStep;
      context.save();
      context.beginPath();
      context.rect(from, pane.y, to - from, pane.height);
      context.clip();
      context.drawImage(this.planes[pane.plane], left, top, frame.width * s, frame.height * s * frame.rowStep);
      if (this.arrows && frame.motion) {
        paintArrows(context, frame.motion, { left, top, across: s, down: s * frame.rowStep }, this.ratio);
      }
      if (this.pin) this.mark(this.pin, left, top, s, []);
      if (this.cursor?.byKeys) this.mark(this.cursor, left, top, s, [3 * this.ratio, 3 * this.ratio]);
      context.restore();
      this.label(pane, Math.max(from, left), Math.min(to, left + frame.width * s));
    }
  }

  render(plane) {
    const { width, height } = this.frame;
    const canvas = this.planes[plane];
    if (canvas.width !== width || canvas.height !== height || !canvas.image) {
      canvas.width = width;
      canvas.height = height;
      canvas.painter = canvas.getContext("2d", { alpha: false });
      canvas.image = canvas.painter.createImageData(width, height);
      canvas.pixels = new Uint32Array(canvas.image.data.buffer);
    }
    const { table } = this;
    const counts = this.frame[plane];
    const { pixels } = canvas;
    for (let i = 0; i < counts.length; ++i) pixels[i] = table[counts[i]];
    canvas.painter.putImageData(canvas.image, 0, 0);
  }

  mark({ x, y }, left, top, s, dash) {
    const { context } = this;
    const step = s * this.frame.rowStep;
    const size = Math.max(s, 9 * this.ratio);
    const cx = left + (x + 0.5) * s;
    const cy = top + (y + 0.5) * step;
    for (const [colour, width] of [["#000a", 4], ["#fff", 2]]) {
      context.strokeStyle = colour;
      context.lineWidth = width * this.ratio;
      context.setLineDash(colour === "#fff" ? dash : []);
      context.strokeRect(cx - size / 2, cy - size / 2, size, size);
    }
    context.setLineDash([]);
  }

  label(pane, from, to) {
    const { context, ratio } = this;
    const words = pane.plane === "raw" ? "blurred" : "deblurred";
    context.font = `600 ${13 * ratio}px system-ui, "DejaVu Sans", sans-serif`;
    const width = context.measureText(words).width + 16 * ratio;
    if (to - from < width + 12 * ratio) return;
    const right = this.mode === "divider" && pane.plane === "sharp";
    const x = right ? to - width - 8 * ratio : from + 8 * ratio;
    const y = pane.y + 8 * ratio;
    context.fillStyle = "#0b0a0cb0";
    context.beginPath();
    context.roundRect(x, y, width, 22 * ratio, 11 * ratio);
    context.fill();
    context.fillStyle = "#fff";
    context.textBaseline = "middle";
    context.fillText(words, x + 8 * ratio, y + 11.5 * ratio);
  }

  paneAt(x, y) {
    return this.panes().find((p) => x >= p.x && y >= p.y && x < p.x + p.width && y < p.y + p.height);
  }

  // The frame pixel at a position on the canvas (CSS pixels); null outside the frame.
  pixelAt(cssX, cssY) {
    if (!this.frame) return null;
    const x = cssX * this.ratio;
    const y = cssY * this.ratio;
    const pane = this.paneAt(x, y);
    if (!pane) return null;
    const s = this.scale(pane);
    const px = Math.floor((x - pane.x - pane.width / 2) / s + this.centre.x);
    const py = Math.floor((y - pane.y - pane.height / 2) / (s * this.frame.rowStep) + this.centre.y);
    return px >= 0 && py >= 0 && px < this.frame.width && py < this.frame.height ? { x: px, y: py } : null;
  }

  // Zooms about a position, or about the middle if none is given.
  zoomBy(factor, cssX, cssY) {
    if (!this.frame) return;
    const pane = this.paneAt(cssX * this.ratio, cssY * this.ratio) ?? this.panes()[0];
    const dx = cssX === undefined ? 0 : cssX * this.ratio - pane.x - pane.width / 2;
    const dy = cssY === undefined ? 0 : (cssY * this.ratio - pane.y - pane.height / 2) / this.frame.rowStep;
    const before = this.scale(pane);
    this.zoom = Math.min(MAX_ZOOM, Math.max(1, this.zoom * factor));
    const after = this.scale(pane);
    this.moveTo(this.centre.x + dx / before - dx / after, this.centre.y + dy / before - dy / after);
    this.changed("zoom");
  }

  fit() {
    this.zoom = 1;
    this.zoomBy(1);
  }

  // Limits the position so that the frame fills the pane, or is centred in it.
  moveTo(x, y) {
    const pane = this.panes()[0];
    const s = this.scale(pane);
    const within = (value, size, room) =>
      room >= size ? size / 2 : Math.min(size - room / 2, Math.max(room / 2, value));
    this.centre = {
      x: within(x, this.frame.width, pane.width / s),
      y: within(y, this.frame.height, pane.height / (s * this.frame.rowStep)),
    };
    this.stage.classList.toggle("zoomed", this.zoom > 1);
    this.paint();
  }

  setCursor(pixel) {
    this.cursor = pixel;
    this.changed("cursor");
  }

  setPin(pixel) {
    this.pin = pixel;
    this.paint();
    this.changed("pin");
  }

  listen() {
    const { canvas, divider, pointers } = this;
    const place = (event) => {
      const box = canvas.getBoundingClientRect();
      return { x: event.clientX - box.left, y: event.clientY - box.top };
    };
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const { x, y } = place(event);
      this.zoomBy(Math.exp(-event.deltaY * 0.0016), x, y);
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      const at = place(event);
      pointers.set(event.pointerId, { ...at, moved: 0 });
      if (pointers.size > 1) for (const pointer of pointers.values()) pointer.moved = CLICK;
    });
    canvas.addEventListener("pointermove", (event) => {
      const at = place(event);
      const pointer = pointers.get(event.pointerId);
      if (pointer && this.frame) this.drag(pointer, at);
      if (pointers.size < 2) this.setCursor(this.pixelAt(at.x, at.y));
    });
    const up = (event) => {
      const pointer = pointers.get(event.pointerId);
      pointers.delete(event.pointerId);
      if (!pointer || pointer.moved >= CLICK || event.type !== "pointerup") return;
      const pixel = this.pixelAt(pointer.x, pointer.y);
      if (pixel) this.setPin(pixel);
    };
    canvas.addEventListener("pointerup", up);
    canvas.addEventListener("pointercancel", up);
    canvas.addEventListener("pointerleave", (event) => { if (event.pointerType === "mouse") this.setCursor(null); });
    divider.addEventListener("pointerdown", (event) => divider.setPointerCapture(event.pointerId));
    divider.addEventListener("pointermove", (event) => {
      if (!divider.hasPointerCapture(event.pointerId)) return;
      this.setSplit(place(event).x / canvas.clientWidth);
      this.paint();
    });
    divider.addEventListener("wheel", (event) => {
      event.preventDefault();
      canvas.dispatchEvent(new WheelEvent("wheel", event));
    }, { passive: false });
  }

  // One pointer pans the picture, two zoom it about their midpoint.
  drag(pointer, at) {
    const others = [...this.pointers.values()].filter((p) => p !== pointer);
    const dx = at.x - pointer.x;
    const dy = at.y - pointer.y;
    pointer.moved += Math.hypot(dx, dy);
    if (others.length > 0) {
      const [other] = others;
      const before = Math.hypot(pointer.x - other.x, pointer.y - other.y);
      const after = Math.hypot(at.x - other.x, at.y - other.y);
      this.zoomBy(after / Math.max(1, before), (at.x + other.x) / 2, (at.y + other.y) / 2);
    } else if (this.zoom > 1 && pointer.moved >= CLICK) {
      const s = this.scale(this.panes()[0]) / this.ratio;
      this.moveTo(this.centre.x - dx / s, this.centre.y - dy / (s * this.frame.rowStep));
    }
    pointer.x = at.x;
    pointer.y = at.y;
  }
}
