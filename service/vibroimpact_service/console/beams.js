// Beams among matrices without a geometry: planar elements whose nodes have a deflection and a rotation.

import { entries, rows } from "./matrix_forms.js";

/** @typedef {{element: number, length: number, fixed: [boolean, boolean]}} Beam length of an element and of all; which ends are clamped */

/** Relative difference up to which entries of stiffness are those of an element. */
const CLOSE = 1e-6;
/** The same where an end is compared with a clamped and with a free one. */
const END = 0.01;

/** By stiffness matrices. @type {WeakMap<any, Beam | null>} */
const KNOWN = new WeakMap();

/**
 * Return the beam whose stiffness a matrix is: equal elements with the entries −12, 6h, −6h and 2h²,
 * times EI/h³, between neighbouring nodes, whatever the units are; null where it is none.
 * @param {any} K in a form of the contract
 * @returns {Beam | null}
 */
export function beamOf(K) {
  if (!K || typeof K !== "object") return null;
  const known = KNOWN.get(K);
  if (known !== undefined) return known;
  const beam = recognised(K);
  KNOWN.set(K, beam);
  return beam;
}

/** @param {any} K @returns {Beam | null} */
function recognised(K) {
  const n = rows(K);
  if (!Number.isInteger(n) || n < 4 || n % 2 || n > 4000) return null;
  const bands = [0, 1, 2, 3].map(() => new Float64Array(n));
  for (const [i, j, value] of entries(K, n)) {
    if (j < i || !value) continue;
    if (j - i > 3) return null;
    bands[j - i][i] += value;
  }
  const [diagonal, next, second, third] = bands;
  /** @param {number} a @param {number} b @param {number} within */
  const near = (a, b, within) => Math.abs(a - b) <= within * Math.abs(b);
  const h = (-2 * third[0]) / second[0];
  for (let i = 0; i + 3 < n; i += 2) {
    const [w, slope, coupling, turn] = [second[i], third[i], next[i + 1], second[i + 1]];
    if (!(w < 0 && slope > 0) || !near(coupling, -slope, CLOSE) || !near(-2 * slope, h * w, CLOSE) || !near(6 * turn, -h * h * w, CLOSE) || third[i + 1]) return null;
  }
  const ends = [diagonal[0] / -second[0], diagonal[n - 2] / -second[n - 4]];
  const fixed = /** @type {[boolean, boolean]} */ (ends.map((ratio) => near(ratio, 2, END)));
  const elements = n / 2 - 1 + fixed.filter(Boolean).length;
  return { element: h, length: elements * h, fixed };
}
