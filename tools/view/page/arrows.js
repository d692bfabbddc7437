// The scene's motion as arrows over the picture: each shows how far its place moves within a few frames.

const BLOCK = 8;         // pixels of the frame
const APART = 26;        // CSS pixels between arrows, at least
const FRAMES = 5;        // frames of motion that an arrow's length shows
const LEAST_SURE = 0.15; // minimum confidence to draw an arrow
const AT_REST = 0.05;    // px per frame: below it a dot

export const ARROW_FRAMES = FRAMES;

// Confidence-weighted mean motion over `step` times `step` blocks, and the mean confidence.
function cell(motion, column, row, step) {
  let x = 0, y = 0, sure = 0, blocks = 0;
  for (let r = row; r < Math.min(row + step, motion.down); ++r) {
    for (let c = column; c < Math.min(column + step, motion.across); ++c) {
      const at = 3 * (r * motion.across + c);
      const weight = motion.values[at + 2];
      x += weight * motion.values[at];
      y += weight * motion.values[at + 1];
      sure += weight;
      ++blocks;
    }
  }
  return sure > 0 ? { x: x / sure, y: y / sure, sure: sure / blocks } : null;
}

// `place`: { left, top } of the frame's corner and { across, down } of a frame pixel, in device pixels.
export function paintArrows(context, motion, place, ratio) {
  const step = Math.max(1, Math.ceil(APART * ratio / (BLOCK * place.across)));
  context.lineCap = "round";
  for (let row = 0; row < motion.down; row += step) {
    for (let column = 0; column < motion.across; column += step) {
      const v = cell(motion, column, row, step);
      if (!v || v.sure < LEAST_SURE) continue;
      const x = place.left + (column + Math.min(step, motion.across - column) / 2) * BLOCK * place.across;
      const y = place.top + (row + Math.min(step, motion.down - row) / 2) * BLOCK * place.down;
      context.globalAlpha = Math.min(1, 0.25 + 0.75 * v.sure);
      const rest = Math.hypot(v.x, v.y) < AT_REST;
      paintArrow(context, x, y, rest ? 0 : v.x * FRAMES * place.across, rest ? 0 : v.y * FRAMES * place.down, ratio);
    }
  }
  context.globalAlpha = 1;
}

// Centred at (x, y); white with a dark edge, which is visible on every palette.
function paintArrow(context, x, y, dx, dy, ratio) {
  const length = Math.hypot(dx, dy);
  const head = Math.min(6 * ratio, 0.45 * length);
  const angle = Math.atan2(dy, dx);
  const tip = { x: x + dx / 2, y: y + dy / 2 };
  for (const [colour, width] of [["#000c", 3.5], ["#fff", 1.6]]) {
    context.strokeStyle = colour;
    context.lineWidth = width * ratio;
    context.beginPath();
    context.moveTo(x - dx / 2, y - dy / 2);
    context.lineTo(tip.x, tip.y + (length === 0 ? 0.01 : 0));
    for (const side of [-0.5, 0.5]) {
      if (length === 0) break;
      context.moveTo(tip.x, tip.y);
      context.lineTo(tip.x - head * Math.cos(angle + side), tip.y - head * Math.sin(angle + side));
    }
    context.stroke();
  }
}
