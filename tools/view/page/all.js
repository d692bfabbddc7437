// All cameras side by side: the newest deblurred frame of each, with the time at which it was taken.

import { followFrames } from "./feed.js";
import { coloursOf, fillTable } from "./palettes.js";

const SAMPLE = 7;      // every n-th pixel determines the range
const ENDS = 0.005;    // share of these pixels below the range, and above it
const CALM = 0.1;      // share of the way to a new range per frame
const LEAST_SPAN = 100;  // counts

if (location.search) history.replaceState(null, "", location.pathname);  // the token is in a cookie now
const colours = coloursOf("iron");

function element(name, properties, ...children) {
  const made = Object.assign(document.createElement(name), properties);
  made.append(...children);
  return made;
}

function rangeOf(values) {
  const some = values.filter((_, i) => i % SAMPLE === 0).sort();
  const low = some[Math.floor(some.length * ENDS)];
  return { low, high: Math.max(low + LEAST_SPAN, some[Math.ceil(some.length * (1 - ENDS)) - 1]) };
}

function clock(utc_ms) {
  return utc_ms ? new Date(utc_ms).toISOString().slice(11, 23) : "time not known";
}

function addCamera(name) {
  const canvas = element("canvas", { role: "img", ariaLabel: `Live picture of ${name}` });
  const time = element("span", { className: "quiet", textContent: "connecting" });
  const caption = element("p", {}, element("strong", { textContent: name }), " ", time);
  const of = `camera/${encodeURIComponent(name)}/`;
  document.getElementById("cameras").append(element("a", { href: of, className: "camera" }, canvas, caption));
  const context = canvas.getContext("2d");
  const table = new Uint32Array(65536);
  let range = null;

  function show(frame) {
    if (canvas.width !== frame.width || canvas.height !== frame.height) {
      Object.assign(canvas, { width: frame.width, height: frame.height });
      canvas.style.aspectRatio = `${frame.width} / ${frame.height * frame.rowStep}`;
    }
    const now = rangeOf(frame.sharp);
    const ends = ["low", "high"].map((end) => (range ? range[end] + (now[end] - range[end]) * CALM : now[end]));
    range = { low: ends[0], high: ends[1] };
    fillTable(table, colours, range.low, range.high);
    const image = context.createImageData(frame.width, frame.height);
    const pixels = new Uint32Array(image.data.buffer);
    for (let i = 0; i < pixels.length; ++i) pixels[i] = table[frame.sharp[i]];
    context.putImageData(image, 0, 0);
    time.textContent = clock(frame.utc_ms);
  }
  followFrames({ of, onFrame: show, stopped: () => false,
    onTrouble: (words) => { if (words) time.textContent = words; } });
}

const names = await (await fetch("api/cameras")).json();
names.forEach(addCamera);
