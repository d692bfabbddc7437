// The figures of daemon, camera and page.

import { FLAGS } from "./frame.js";

const CAUSES = {
  incomplete: "packets missing", missing: "never came", pool_exhausted: "no free slot", queue_full: "queue full",
  bad_frame: "wrong format", driver: "driver", out_of_order: "too late",
};

const set = (id, words) => { document.getElementById(id).textContent = words; };
const rate = (hz) => hz.toFixed(1);
const count = (n) => n.toLocaleString("en").replaceAll(",", "\u202f");
const ms = (value) => value > 0 ? value.toFixed(2) : "–";

export function duration(seconds) {
  const s = Math.floor(seconds);
  const two = (n) => String(n).padStart(2, "0");
  return s < 60 ? `${s} s` : `${Math.floor(s / 3600)}:${two(Math.floor(s / 60) % 60)}:${two(s % 60)}`;
}

export function showStatus(status, celsius) {
  set("name", status.name);
  if (status.published === undefined) return;
  const known = status.interval_s > 0;
  set("received", known ? rate(status.received_hz) : "–");
  set("published", known ? rate(status.published_hz) : "–");
  set("p50", ms(status.latency_p50_ms));
  set("p99", ms(status.latency_p99_ms));
  set("deblur", ms(status.deblur_ms_per_frame));
  set("motion", status.motion ? `${Math.hypot(status.motion.x_px, status.motion.y_px).toFixed(2)} a frame` : "–");
  set("uptime", duration(status.uptime_s));
  set("restarts", count(status.restarts));
  set("gaps", count(status.gap_frames));
  set("followed", count(status.view.followed));
  const window = `window of ${status.window} frames, look-ahead ${status.lookahead}`;
  set("solver", `${status.solver}, ${window}, τ ${(status.tau_s * 1000).toPrecision(3)} ms`);
  const format = `${status.width} × ${status.height} · ${Math.round(1 / status.frame_period_s)} Hz`;
  set("camera-words", `${status.camera_model} ${status.camera_serial} · ${format}`);
  showLosses(status);
  if (status.camera) showCamera(status.camera, celsius);
  if (status.view.stream === "gone") set("state", "–");
}

function showCamera(camera, celsius) {
  set("state", camera.state);
  set("temperature", camera.temperature_k === null ? "–"
    : celsius ? `${(camera.temperature_k - 273.15).toFixed(1)} °C` : `${camera.temperature_k.toFixed(1)} K`);
  set("reopened", count(camera.reopened));
  set("nucs", count(camera.nucs));
}

function showLosses(status) {
  set("lost", count(status.lost_total));
  const list = document.getElementById("losses");
  for (const [cause, words] of Object.entries(CAUSES)) {
    let row = document.getElementById(`lost-${cause}`);
    if (!row) {
      row = document.createElement("div");
      row.id = `lost-${cause}`;
      row.title = cause;
      row.append(document.createElement("dt"), document.createElement("dd"));
      row.firstChild.textContent = words;
      list.append(row);
    }
    const hz = status.lost_hz[cause] ?? 0;
    row.className = hz > 0 ? "rising" : status.lost[cause] ? "" : "none";
    row.lastChild.textContent = count(status.lost[cause] ?? 0);
    if (hz > 0) row.lastChild.append(Object.assign(document.createElement("small"), { textContent: `${rate(hz)} /s` }));
  }
}

// Statistics of the frames shown recently.
export class Shown {
  constructor() { this.frames = []; }
  add(frame) {
    const now = performance.now();
    this.frames.push({ at: now, flags: frame.flags });
    set("frame-id", String(frame.id));
    this.age = this.age === undefined ? frame.age_ms : this.age + (frame.age_ms - this.age) * 0.05;
  }
  // Share of the last two seconds' frames with any of these flags.
  hurried(flags = FLAGS.reduced | FLAGS.inverse | FLAGS.raw) {
    return this.frames.length && this.frames.filter((frame) => frame.flags & flags).length / this.frames.length;
  }
  show() {
    const now = performance.now();
    while (this.frames.length && now - this.frames[0].at > 2000) this.frames.shift();
    set("shown", rate(this.frames.length / 2));
    set("age", this.age === undefined ? "–" : this.age.toFixed(1));
  }
}
