// Fetches the page's data. Frames are pulled: a slow page gets fewer of them, and nobody waits for it.

import { parseFrame } from "./frame.js";

const LEAST_MS = 1000 / 30;  // between frames
const STATUS_MS = 1000;
const TRACE_MS = 80;
const RETRY_MS = 700;

const pause = (ms) => new Promise((done) => setTimeout(done, Math.max(0, ms)));
const visible = () => document.hidden
  ? new Promise((done) => document.addEventListener("visibilitychange", done, { once: true })) : null;

async function get(path) {
  const answer = await fetch(path, { signal: AbortSignal.timeout(8000) });
  if (!answer.ok) throw new Error((await answer.text()).trim() || `answer ${answer.status}`);
  return answer;
}

// Calls onFrame(frame), and onTrouble(words) with null when trouble is over. `stopped()`: pause. `of`: address of the
// camera's answers, relative to the page.
export async function followFrames({ of = "", onFrame, onTrouble, stopped }) {
  let seen = { epoch: 0, number: 0 };
  for (;;) {
    await visible();
    if (stopped()) { await pause(100); continue; }
    const begun = performance.now();
    try {
      const answer = await get(`${of}api/frame?epoch=${seen.epoch}&after=${seen.number}`);
      if (answer.status === 200) {
        const frame = parseFrame(await answer.arrayBuffer());
        seen = frame;
        if (!stopped()) onFrame(frame);
      }
      onTrouble(null);
      await pause(LEAST_MS - (performance.now() - begun));
    } catch (error) {
      onTrouble(error.message);
      await pause(RETRY_MS);
    }
  }
}

export async function followStatus({ onStatus }) {
  for (;;) {
    await visible();
    try {
      onStatus(await (await get("api/status")).json());
    } catch { /* followFrames reports it */ }
    await pause(STATUS_MS);
  }
}

// Calls onSamples({epoch, next, t_s, raw, deblurred}, fresh) for the pixel that `pixel()` returns.
export async function followTrace({ pixel, onSamples, stopped }) {
  let of = null;
  let place = { epoch: 0, next: 0 };
  for (;;) {
    await visible();
    await pause(TRACE_MS);
    const wanted = pixel();
    if (!wanted || stopped()) continue;
    if (wanted !== of) place = { epoch: 0, next: 0 };
    of = wanted;
    try {
      const path = `api/trace?x=${of.x}&y=${of.y}&epoch=${place.epoch}&after=${place.next}`;
      const samples = await (await get(path)).json();
      if (pixel() === of) onSamples(samples, place.epoch !== samples.epoch);
      place = samples;
    } catch {
      await pause(RETRY_MS);
    }
  }
}

// Requests a NUC; its outcome is in the status.
export async function askForNuc() {
  const answer = await fetch("api/nuc", { method: "POST" });
  if (!answer.ok) throw new Error((await answer.text()).trim());
}
