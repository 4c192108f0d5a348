// Signs of special points, told apart by their form.

/** @typedef {{points: [number, number][], open?: boolean, cross?: boolean}} Form in units of the radius; open: filled with the paper */

/** @type {Record<string, Form>} */
const FORMS = {
  fold: { points: [[0, -1.25], [1.25, 0], [0, 1.25], [-1.25, 0]], open: true },
  flip: { points: [[-0.9, -0.9], [0.9, -0.9], [0.9, 0.9], [-0.9, 0.9]] },
  symmetry: { points: [[0, -1.2], [1.1, 0.8], [-1.1, 0.8]] },
  grazing: { points: [[0, 1.2], [1.1, -0.8], [-1.1, -0.8]], open: true },
  end: { points: [[-0.9, -0.9], [0.9, 0.9], [0.9, -0.9], [-0.9, 0.9]], cross: true },
};

/**
 * Draw a sign; what has no form of its own is a ring.
 * @param {CanvasRenderingContext2D} context
 * @param {string} kind
 * @param {number} x @param {number} y @param {number} radius
 * @param {string} ink @param {string} paper
 */
export function symbol(context, kind, x, y, radius, ink, paper) {
  const form = FORMS[kind];
  context.strokeStyle = ink;
  context.lineWidth = (form ? 0.35 : 0.45) * radius;
  context.beginPath();
  if (!form) context.arc(x, y, radius, 0, 2 * Math.PI);
  else {
    form.points.forEach(([a, b], i) => {
      if (i === 0 || (form.cross && i % 2 === 0)) context.moveTo(x + a * radius, y + b * radius);
      else context.lineTo(x + a * radius, y + b * radius);
    });
    if (!form.cross) {
      context.closePath();
      context.fillStyle = form.open ? paper : ink;
      context.fill();
    }
  }
  context.stroke();
}
