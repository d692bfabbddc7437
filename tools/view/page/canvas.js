// Canvases at the screen's own resolution.

const MOST = 3; // more device pixels for a point than this are not seen

export const pixelRatio = () => Math.min(MOST, devicePixelRatio || 1);

// Makes the canvas as fine as the screen where it is shown, and empties it.
export function sharpCanvas(canvas) {
  const ratio = pixelRatio();
  const width = Math.round(canvas.clientWidth * ratio);
  const height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, width, height);
  return { context, ratio, width, height };
}
