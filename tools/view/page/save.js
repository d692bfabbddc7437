// Saves pictures and values as files made in the browser.

import { css } from "./range.js";

function download(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

const stamp = (date) => date.toISOString().replaceAll(":", "").replace(/\.\d+/, "");
const fileName = (name, frame, what) => `${name}-${stamp(frame.at)}-${frame.id}-${what}`;

// The displayed picture with a caption line below it.
export function pictureWithCaption({ picture, frame, name, camera, range, unit, colours }) {
  const source = picture.canvas;
  const r = picture.ratio;
  const bar = Math.round(40 * r);
  const canvas = Object.assign(document.createElement("canvas"), { width: source.width, height: source.height + bar });
  const context = canvas.getContext("2d", { alpha: false });
  context.fillStyle = "#ffffff";
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.drawImage(source, 0, 0);
  if (picture.mode === "divider") {
    context.fillStyle = "#ffffff";
    context.fillRect(picture.split * source.width - r, 0, 2 * r, source.height);
  }
  context.textBaseline = "middle";
  context.font = `${13 * r}px system-ui, "DejaVu Sans", sans-serif`;
  context.fillStyle = "#222222";
  const middle = source.height + bar / 2;
  const high = unit.words(range.high, unit.kelvin ? 1 : 0);
  const low = unit.words(range.low, unit.kelvin ? 1 : 0);
  context.textAlign = "right";
  context.fillText(high, canvas.width - 10 * r, middle);
  let x = canvas.width - 18 * r - context.measureText(high).width;
  const length = Math.min(160 * r, canvas.width * 0.2);
  for (let i = 0; i < 256; ++i) {
    context.fillStyle = css(colours[i]);
    context.fillRect(x - length + i / 256 * length, middle - 6 * r, length / 256 + 1, 12 * r);
  }
  x -= length + 8 * r;
  context.fillStyle = "#222222";
  context.fillText(low, x, middle);
  x -= context.measureText(low).width + 12 * r;
  context.textAlign = "left";
  const time = frame.at.toISOString().replace("T", " ").replace("Z", " UTC");
  context.fillText(`${name}  ${time}  frame ${frame.id}  ${camera}`, 10 * r, middle, x - 10 * r);
  return canvas;
}

export function savePicture(parts) {
  return new Promise((done) => pictureWithCaption(parts).toBlob((blob) => {
    download(blob, `${fileName(parts.name, parts.frame, parts.picture.mode)}.png`);
    done();
  }, "image/png"));
}

export async function savePlane16({ frame, name, plane }) {
  const what = plane === "raw" ? "blurred" : "deblurred";
  const words = { Description: `${what}, frame ${frame.id}, ${frame.at.toISOString()}` };
  if (frame.kelvin) words.Comment = `kelvin = ${frame.scale} * value + ${frame.offset}`;
  download(await png16(frame[plane], frame.width, frame.height, words), `${fileName(name, frame, plane)}-16bit.png`);
}

export function saveCsv({ frame, name, plane }) {
  const lines = [];
  for (let y = 0; y < frame.height; ++y) {
    const row = Array.from(frame[plane].subarray(y * frame.width, (y + 1) * frame.width));
    lines.push((frame.kelvin ? row.map((count) => (count * frame.scale + frame.offset).toFixed(3)) : row).join(","));
  }
  const what = `${plane}-${frame.kelvin ? "kelvin" : "counts"}.csv`;
  download(new Blob([lines.join("\n"), "\n"], { type: "text/csv" }), fileName(name, frame, what));
}

// A 16-bit grey PNG with texts; canvases make only 8-bit ones.
async function png16(counts, width, height, words) {
  const rows = new DataView(new ArrayBuffer(height * (1 + 2 * width)));  // each row begins with its filter type: none
  for (let y = 0, at = 0; y < height; ++y) {
    ++at;
    for (let x = 0; x < width; ++x, at += 2) rows.setUint16(at, counts[y * width + x]);
  }
  const packed = new Response(new Blob([rows.buffer]).stream().pipeThrough(new CompressionStream("deflate")));
  const head = new DataView(new ArrayBuffer(13));
  head.setUint32(0, width);
  head.setUint32(4, height);
  head.setUint8(8, 16);
  const text = new TextEncoder();
  return new Blob([
    Uint8Array.of(137, 80, 78, 71, 13, 10, 26, 10),
    chunk("IHDR", new Uint8Array(head.buffer)),
    ...Object.entries(words).map(([key, value]) => chunk("tEXt", text.encode(`${key}\0${value}`))),
    chunk("IDAT", new Uint8Array(await packed.arrayBuffer())),
    chunk("IEND", new Uint8Array(0)),
  ], { type: "image/png" });
}

const CRC = Uint32Array.from({ length: 256 }, (_, n) => {
  for (let bit = 0; bit < 8; ++bit) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
  return n;
});

function chunk(type, data) {
  const bytes = new Uint8Array(12 + data.length);
  const view = new DataView(bytes.buffer);
  view.setUint32(0, data.length);
  bytes.set(new TextEncoder().encode(type), 4);
  bytes.set(data, 8);
  let crc = 0xffffffff;
  for (const byte of bytes.subarray(4, 8 + data.length)) crc = CRC[(crc ^ byte) & 255] ^ (crc >>> 8);
  view.setUint32(8 + data.length, (crc ^ 0xffffffff) >>> 0);
  return bytes;
}
