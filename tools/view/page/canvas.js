// Canvases at the resolution of the screen.

const MOST = 3; // device pixels per CSS pixel; more are not visible

export const pixelRatio = () => Math.min(MOST, devicePixelRatio || 1);

// Sets the canvas to its displayed size in device pixels and clears it.
export function sharpCanvas(canvas) {
  const ratio = pixelRatio();
  const width = Math.round(canvas.clientWidth * ratio);
  const height = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const context = canvas.getContext("2d");
  context.clearRect(0, 0, width, height);
  return { context, ratio, width, height };
}
