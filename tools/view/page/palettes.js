// Palettes of evenly rising lightness, which also work in grey.

const STOPS = {
  iron: [[0, 0x00000a], [0.18, 0x300570], [0.38, 0x8c088f], [0.55, 0xd6384f],
         [0.72, 0xf57a1a], [0.88, 0xfccc40], [1, 0xffffeb]],
  "white-hot": [[0, 0x000000], [1, 0xffffff]],
  "black-hot": [[0, 0xffffff], [1, 0x000000]],
  // Cividis: looks the same with and without red-green colour blindness.
  cividis: [[0, 0x00224e], [0.11, 0x123570], [0.22, 0x3b496c], [0.33, 0x575d6d], [0.44, 0x707173], [0.55, 0x8a8678],
            [0.67, 0xa59c74], [0.78, 0xc3b369], [0.89, 0xe1cc55], [1, 0xfee838]],
};

export const PALETTES = Object.keys(STOPS);

// 256 colours in the format of canvas pixels: 0xAABBGGRR.
export function coloursOf(palette) {
  const stops = STOPS[palette];
  return Uint32Array.from({ length: 256 }, (_, i) => {
    const level = i / 255;
    const upper = Math.max(1, stops.findIndex(([at]) => level <= at));
    const [a, from] = stops[upper - 1];
    const [b, to] = stops[upper];
    const w = (level - a) / (b - a);
    const mix = (shift) => Math.round((from >> shift & 255) * (1 - w) + (to >> shift & 255) * w);
    return (255 << 24 | mix(0) << 16 | mix(8) << 8 | mix(16)) >>> 0;
  });
}

// A colour for each count: up to `low` the first, from `high` on the last.
export function fillTable(table, colours, low, high) {
  const step = 256 / Math.max(1, high - low);
  for (let count = 0; count < table.length; ++count) {
    table[count] = colours[Math.min(255, Math.max(0, (count - low) * step | 0))];
  }
}
