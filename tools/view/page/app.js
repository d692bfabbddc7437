// Wires the page: frames to the picture, status to the figures, keys and buttons to both.

import { ARROW_FRAMES } from "./arrows.js";
import { askForNuc, followFrames, followStatus, followTrace } from "./feed.js";
import { bothUnits, FLAGS, Unit } from "./frame.js";
import { duration, Shown, showStatus } from "./numbers.js";
import { coloursOf, PALETTES } from "./palettes.js";
import { Picture } from "./picture.js";
import { Range } from "./range.js";
import { saveCsv, savePicture, savePlane16 } from "./save.js";
import { Trace } from "./trace.js";

const $ = (id) => document.getElementById(id);
const MODES = ["divider", "both", "raw", "sharp"];
const RANGES = ["auto", "frame", "fixed"];
const THEMES = ["auto", "light", "dark"];

// The token is in a cookie now; it should not stay in the address.
if (location.search) history.replaceState(null, "", location.pathname);

// Choices are kept in this browser if it allows that.
function recall() {
  try { return JSON.parse(localStorage.getItem("bolo")) ?? {}; } catch { return {}; }
}
function keep(changes) {
  Object.assign(kept, changes);
  try { localStorage.setItem("bolo", JSON.stringify(kept)); } catch { /* for this visit only */ }
}
const narrow = matchMedia("(max-width: 620px)").matches;
const usual = { palette: "iron", mode: narrow ? "both" : "divider", celsius: true, theme: "auto", span: "0.5", arrows: false };
const kept = { ...usual, ...recall() };

let frame = null;
let unit = null;
let colours = coloursOf("iron");
let paused = false;
let trouble = null;
let status = null;
let dirty = false;

const shown = new Shown();
const picture = new Picture({
  stage: $("stage"), canvas: $("picture"), divider: $("divider"),
  changed: (what) => {
    if (what === "pin") newPin();
    const zoomed = picture.zoom > 1.005;
    if (what === "zoom") $("zoom-fit").textContent = zoomed ? `${Math.round(picture.zoom * 100)} %` : "fit";
    draw();
  },
});
const range = new Range({
  canvas: $("scale-picture"), low: $("low"), high: $("high"), lowThumb: $("low-thumb"), highThumb: $("high-thumb"),
  changed: () => { check("ranges", range.mode); draw(); },
});
const swatches = document.querySelectorAll("#trace .swatch");
const axis = document.querySelector("#trace .label");
const trace = new Trace({ canvas: $("trace-picture"), raw: swatches[0], sharp: swatches[1], axis });

function draw() {
  if (!dirty) requestAnimationFrame(paint);
  dirty = true;
}

function paint() {
  dirty = false;
  if (!frame) return;
  picture.colour(colours, range.low, range.high);
  picture.paint();
  range.paint(colours, getComputedStyle(document.body).color);
  const { cursor } = picture;
  const at = cursor && cursor.y * frame.width + cursor.x;
  $("cursor-place").textContent = cursor ? `${cursor.x}, ${cursor.y}` : "–";
  $("cursor-raw").textContent = cursor ? bothUnits(frame, frame.raw[at]) : "–";
  $("cursor-sharp").textContent = cursor ? bothUnits(frame, frame.sharp[at]) : "–";
}

function newFrame(next) {
  const first = !frame || frame.width !== next.width || frame.height !== next.height;
  frame = next;
  unit = new Unit(frame, kept.celsius);
  $("unit").textContent = unit.name;
  picture.show(frame);
  range.follow(frame, unit);
  if (first || (picture.pin && (picture.pin.x >= frame.width || picture.pin.y >= frame.height))) {
    picture.setPin({ x: Math.floor(frame.width * 0.62), y: Math.floor(frame.height * 0.6) });
  }
  shown.add(frame);
  draw();
}

function newPin() {
  trace.clear();
  $("trace-title").textContent = `Pixel ${picture.pin.x}, ${picture.pin.y}`;
  $("trace-raw").textContent = $("trace-sharp").textContent = "–";
}

function newSamples(samples, fresh) {
  trace.add(samples, fresh);
  if (!unit) return;
  trace.paint(unit);
  const last = trace.last();
  $("trace-raw").textContent = last ? unit.words(last.raw) : "–";
  $("trace-sharp").textContent = last ? unit.words(last.sharp) : "–";
}

// ---- state ----

// The first fault on the way from the page to the camera; nothing when frames arrive.
function obstacle() {
  if (trouble) return ["gone", "No answer from bolo view", trouble];
  if (!status) return ["gone", "Connecting", ""];
  const { stream, obstacle } = status.view;
  const camera = status.camera?.state;
  if (stream === "gone") return ["gone", "The daemon is gone", obstacle || `waiting for ${status.name}`];
  if (camera === "lost") return ["silent", "The camera is lost", "the daemon opens it again"];
  if (stream === "silent") return ["silent", "No frames", `the camera is ${camera ?? "silent"}; waiting`];
  return null;
}

function showState() {
  const wrong = obstacle();
  const correcting = status?.camera?.state === "correcting" || (frame && frame.flags & FLAGS.nuc);
  $("pill").dataset.state = wrong ? wrong[0] : paused ? "paused" : "live";
  $("pill").textContent = wrong ? wrong[1].toLowerCase() : paused ? "paused" : correcting ? "correcting" : "live";
  $("notice").hidden = !wrong;
  if (wrong) {
    $("notice").children[0].textContent = wrong[1];
    $("notice").children[1].textContent = wrong[2];
  }
  document.title = `${status?.name ?? "Bolo"} – ${$("pill").textContent}`;
}

// Shows the share of recent frames that the daemon had no time to solve fully.
function showEffort() {
  const share = shown.hurried();
  $("effort").hidden = !share;
  if (!share) return;
  const of = (name) => `${Math.round(100 * shown.hurried(FLAGS[name]))} % `;
  $("effort").textContent = `${Math.ceil(100 * share)} % not fully solved`;
  $("effort").title = `The computer is too busy for this solver. Of the frames of the last two seconds: ${of("reduced")}by a ` +
    `cheaper solver, ${of("inverse")}by the inverse filter, ${of("raw")}not deblurred`;
}

function newStatus(next) {
  const before = status;
  status = next;
  showStatus(status, kept.celsius);
  shown.show();
  showEffort();
  $("nuc").disabled = !status.view.nuc || status.view.nuc_asking;
  const answered = before?.view.nuc_asking && !status.view.nuc_asking;
  if (answered) say(status.view.nuc_trouble || "The camera corrects its pixels");
  if (before && before.view.followed !== status.view.followed) say("The daemon was started anew");
  showState();
}

function newTrouble(words) {
  if (words === trouble) return;
  trouble = words;
  showState();
}

let toastEnds = 0;
function say(words) {
  $("toast").textContent = words;
  $("toast").classList.add("shown");
  clearTimeout(toastEnds);
  toastEnds = setTimeout(() => $("toast").classList.remove("shown"), 4000);
}

// ---- choices ----

function check(group, value) {
  for (const button of $(group).children) {
    button.setAttribute("aria-checked", button.dataset.value === value);
    button.tabIndex = button.dataset.value === value ? 0 : -1;
  }
}

function chooseMode(mode) { keep({ mode }); check("modes", mode); picture.setMode(mode); draw(); }
function chooseRange(mode) {
  range.mode = mode;
  check("ranges", mode);
  if (frame) range.follow(frame, unit);
  draw();
}
function chooseSpan(span) { keep({ span }); check("spans", span); trace.span_s = Number(span); trace.paint(); }
function choosePalette(palette) {
  keep({ palette });
  $("palette").value = palette;
  colours = coloursOf(palette);
  draw();
}
function chooseTheme(theme) {
  keep({ theme });
  if (theme === "auto") delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = theme;
  $("theme").textContent = { auto: "◐", light: "☀", dark: "☾" }[theme];
  $("theme").setAttribute("aria-label", `Theme: ${theme}`);
  $("theme").title = `Theme: ${theme === "auto" ? "as the system" : theme} (T)`;
  draw();
  trace.paint();
}
function chooseUnit(celsius) {
  keep({ celsius });
  if (frame) {
    unit = new Unit(frame, celsius);
    range.unit = unit;
    $("unit").textContent = unit.name;
    trace.paint(unit);
  }
  draw();
}
function chooseArrows(arrows) {
  keep({ arrows });
  picture.arrows = arrows;
  $("arrows").setAttribute("aria-pressed", arrows);
  draw();
}
// On a click: says what the arrows mean, or why there are none.
function toggleArrows() {
  chooseArrows(!kept.arrows);
  if (!kept.arrows || !frame) return;
  if (frame.motion) say(`Arrows: the way within ${ARROW_FRAMES} frames`);
  else say(status?.motion ? "The motion of this frame is not known" : 'No motion here: [deblur] solver = "motion" estimates it while it keeps up');
}
function choosePause(value) {
  paused = value;
  $("pause").setAttribute("aria-pressed", paused);
  showState();
}

async function requestNuc() {
  if ($("nuc").disabled) return;
  $("nuc").disabled = true;
  try {
    await askForNuc();
    if (status) status.view.nuc_asking = true;
    say("The camera is asked to correct its pixels");
  } catch (error) {
    say(error.message);
  }
}

async function save(what) {
  $("save").open = false;
  if (!frame) return;
  const name = status?.name ?? "bolo";
  const plane = what.startsWith("raw") ? "raw" : "sharp";
  const camera = status?.camera_model ?? "";
  if (what === "picture") await savePicture({ picture, frame, name, camera, range, unit, colours });
  else if (what.endsWith("16")) await savePlane16({ frame, name, plane });
  else saveCsv({ frame, name, plane });
  say("Saved to your downloads");
}

const next = (list, value) => list[(list.indexOf(value) + 1) % list.length];

for (const [group, choose] of [["modes", chooseMode], ["ranges", chooseRange], ["spans", chooseSpan]]) {
  const buttons = [...$(group).children];
  buttons.forEach((button, i) => {
    button.addEventListener("click", () => choose(button.dataset.value));
    button.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      if (!step) return;
      event.stopPropagation();
      const other = buttons[(i + step + buttons.length) % buttons.length];
      other.click();
      other.focus();
    });
  });
}
for (const palette of PALETTES) {
  $("palette").add(new Option(palette === "cividis" ? "cividis (colour-blind safe)" : palette, palette));
}
$("palette").addEventListener("change", () => choosePalette($("palette").value));
$("zoom-in").addEventListener("click", () => picture.zoomBy(1.5));
$("zoom-out").addEventListener("click", () => picture.zoomBy(1 / 1.5));
$("zoom-fit").addEventListener("click", () => picture.fit());
$("arrows").addEventListener("click", toggleArrows);
$("pause").addEventListener("click", () => choosePause(!paused));
$("nuc").addEventListener("click", requestNuc);
$("unit").addEventListener("click", () => chooseUnit(!kept.celsius));
$("theme").addEventListener("click", () => chooseTheme(next(THEMES, kept.theme)));
$("help-open").addEventListener("click", () => $("help").showModal());
$("save").addEventListener("click", (event) => { if (event.target.dataset.save) save(event.target.dataset.save); });
document.addEventListener("pointerdown", (event) => { if (!$("save").contains(event.target)) $("save").open = false; });

// ---- keys ----

const KEYS = [
  ["Space", "pause", () => choosePause(!paused)],
  ["D", "divider, both, blurred, deblurred", () => chooseMode(next(MODES, picture.mode))],
  ["R", "range: auto, of each frame, fixed", () => chooseRange(next(RANGES, range.mode))],
  ["P", "next palette", () => choosePalette(next(PALETTES, kept.palette))],
  ["+", "zoom in", () => picture.zoomBy(1.5)],
  ["-", "zoom out", () => picture.zoomBy(1 / 1.5)],
  ["0", "whole picture", () => picture.fit()],
  ["[", "divider to the left", () => { picture.setSplit(picture.split - 0.02); draw(); }],
  ["]", "divider to the right", () => { picture.setSplit(picture.split + 0.02); draw(); }],
  ["M", "arrows: how the scene moves", toggleArrows],
  ["S", "save the picture as seen", () => save("picture")],
  ["N", "have the camera correct its pixels", requestNuc],
  ["U", "°C or K", () => chooseUnit(!kept.celsius)],
  ["T", "theme: as the system, light, dark", () => chooseTheme(next(THEMES, kept.theme))],
  ["?", "these keys", () => $("help").showModal()],
];
const PICTURE_KEYS = [
  ["← → ↑ ↓", "on the picture: move the cursor, with Shift by ten"],
  ["Enter", "on the picture: pin the pixel"],
];
for (const [key, words] of [...KEYS, ...PICTURE_KEYS]) {
  const term = document.createElement("dt");
  term.append(Object.assign(document.createElement("kbd"), { textContent: key }));
  $("keys").append(term, Object.assign(document.createElement("dd"), { textContent: words }));
}

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || $("help").open) return;
  if (event.key === "Escape") $("save").open = false;
  const inField = event.target.matches("input, select");
  if (inField || (event.key === " " && event.target.matches("button, summary"))) return;
  const key = event.key === " " ? "Space" : event.key === "=" ? "+" : event.key.toUpperCase();
  const found = KEYS.find(([name]) => name === key);
  if (!found) return;
  event.preventDefault();
  found[2]();
});

const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
$("picture").addEventListener("keydown", (event) => {
  if (!frame) return;
  const cursor = picture.cursor ?? picture.pin;
  if (event.key === "Enter") picture.setPin({ x: cursor.x, y: cursor.y });
  const arrow = ARROWS[event.key];
  if (!arrow) return;
  event.preventDefault();
  const step = event.shiftKey ? 10 : 1;
  const within = (value, size) => Math.min(size - 1, Math.max(0, value));
  const x = within(cursor.x + arrow[0] * step, frame.width);
  const y = within(cursor.y + arrow[1] * step, frame.height);
  picture.setCursor({ x, y, byKeys: true });
});
$("divider").addEventListener("keydown", (event) => {
  const arrow = ARROWS[event.key];
  if (!arrow) return;
  event.preventDefault();
  picture.setSplit(picture.split + (arrow[0] - arrow[1]) * (event.shiftKey ? 0.1 : 0.01));
  draw();
});

chooseTheme(kept.theme);
choosePalette(kept.palette);
chooseMode(kept.mode);
chooseSpan(kept.span);
check("ranges", range.mode);
chooseArrows(kept.arrows);
showState();
followFrames({ onFrame: newFrame, onTrouble: newTrouble, stopped: () => paused });
followStatus({ onStatus: newStatus });
followTrace({ pixel: () => picture.pin, onSamples: newSamples, stopped: () => paused });
