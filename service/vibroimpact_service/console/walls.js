// Draws stops on a canvas: rigid ones as hatched bars, those with a stiffness on the spring that they compress.

/** Pixels of a spring that is not compressed, and its zigzags. */
const [FREE, TURNS] = [16, 3];

/** @param {{lower: number | null, upper: number | null, stiffness?: number | null}} stop @param {number} side @param {number} y displacement of its coordinate @returns {number | null} how far it is pushed in; null: rigid */
export function indentation(stop, side, y) {
  const gap = side > 0 ? stop.upper : stop.lower;
  if (gap === null || stop.stiffness === null || stop.stiffness === undefined) return null;
  return Math.max(0, side * y - gap);
}

/**
 * Draw a wall: a bar centred at (x, y) that faces the direction (u, v), with hatching behind it, or
 * behind a spring.
 * @param {CanvasRenderingContext2D} context
 * @param {string} colour
 * @param {{x: number, y: number, u: number, v: number, width: number, marked: boolean, pushed: number | null, deepest: number}} wall
 *   pushed: pixels by which it gives way, at most `deepest`; null: it is rigid
 */
export function drawWall(context, colour, { x, y, u, v, width, marked, pushed, deepest }) {
  const half = width / 2;
  const [a, b] = pushed === null ? [x, y] : [x - u * pushed, y - v * pushed];
  if (marked) {
    context.beginPath();
    context.arc(a, b, half + 7, 0, 2 * Math.PI);
    context.globalAlpha = 0.18;
    context.fillStyle = colour;
    context.fill();
    context.globalAlpha = 1;
  }
  /** @param {number[][]} points @param {number} thick */
  const line = (points, thick) => {
    context.beginPath();
    points.forEach(([right, down], i) => (i ? context.lineTo(right, down) : context.moveTo(right, down)));
    context.strokeStyle = colour;
    context.lineWidth = thick;
    context.setLineDash([]);
    context.stroke();
  };
  /** @param {number} s along the bar @param {number} back behind where it stands when nothing pushes */
  const at = (s, back) => [x - u * back - v * s, y - v * back + u * s];
  line([[a - v * half, b + u * half], [a + v * half, b - u * half]], marked ? 5 : 3.5);
  const foot = pushed === null ? 0 : deepest + FREE;
  if (pushed !== null) {
    const zigzag = Array.from({ length: 2 * TURNS }, (_, k) => at((k % 2 ? 1 : -1) * Math.min(5, half / 2), pushed + ((k + 0.5) / (2 * TURNS)) * (foot - pushed)));
    line([at(0, pushed), ...zigzag, at(0, foot)], 1.5);
    line([at(-half, foot), at(half, foot)], 1.5);
  }
  for (let s = -half; s < half - 1; s += 6) {
    const [right, down] = at(s, foot);
    line([[right, down], [right - u * 6 - v * 4, down - v * 6 + u * 4]], 1);
  }
}
