// How far the parts of a structure move: envelopes behind its drawing.

/** @typedef {{smallest: ArrayLike<number>, largest: ArrayLike<number>}} Envelope [dof]; of beams [place], from the clamp on */

/** Places along an element at which the envelope of a beam is taken. */
export const FINE = 5;

/**
 * Return the envelope of a beam that is clamped at its left end, cubic between its nodes.
 * @param {ArrayLike<number>[]} rows displacements [time][dof]; each rotation follows its deflection
 * @param {number[]} drawn deflections
 * @param {number} element its length
 * @returns {Envelope}
 */
export function beamEnvelope(rows, drawn, element) {
  const [smallest, largest] = [new Float64Array(FINE * drawn.length + 1), new Float64Array(FINE * drawn.length + 1)];
  for (const row of rows) {
    drawn.forEach((dof, k) => {
      const [a, s] = k ? [row[drawn[k - 1]], row[drawn[k - 1] + 1] * element] : [0, 0];
      const [b, r] = [row[dof], row[dof + 1] * element];
      for (let part = 1; part <= FINE; part += 1) {
        const t = part / FINE;
        const value = a + s * t + (3 * (b - a) - 2 * s - r) * t * t + (2 * (a - b) + s + r) * t * t * t;
        const place = FINE * k + part;
        smallest[place] = Math.min(smallest[place], value);
        largest[place] = Math.max(largest[place], value);
      }
    });
  }
  return { smallest, largest };
}
