// The natural frequencies of the structure on the page, and the ranges, times and forces that fit it.

import { ask, send } from "./api.js";
import { shown } from "./numbers.js";
import { state } from "./state.js";
import { FORMS, size, systemDocument } from "./structures.js";

/**
 * Natural frequencies, ascending, and the static flexibility of the first stop's coordinate by their modes.
 * @typedef {{Omega: number[], all: boolean, flexibility: number | null}} Natural
 */

/** Modes that the page asks for. */
const MOST = 60;
/** Ratio of the last natural frequency to the first above which the motion is that of the first modes. */
const WIDE = 30;
/** Milliseconds after which the views do not wait any more; what comes later is announced by an event. */
const PATIENCE = 2000;

let asked = "";
/** What of the structure is permitted but seldom meant. @type {string[]} */
let said = [];
/** @type {Natural | null} */
let known = null;

/** @returns {Natural | null} of the present structure; null where they are not known (yet) */
export function natural() {
  return known;
}

/** @returns {string[]} what of the present structure is permitted but seldom meant, as far as it is known */
export function cautions() {
  const { damping } = state.structure;
  const ratio = damping >= 1 && FORMS[state.structure.form].damped ? [`the damping ratio is ${rounded(100 * damping)} % of the critical one: free motions do not oscillate`] : [];
  return [...ratio, ...said];
}

/** Learn the natural frequencies of the present structure, unless they are known. */
export async function learn() {
  const { structure } = state;
  const n = size(structure);
  const [first] = structure.stops;
  const place = first && first.dof < n && (first.relativeTo === null || first.relativeTo < n) ? [{ ...first, lower: 1, upper: 1 }] : [];
  const system = systemDocument({ ...structure, stops: place, loads: [], damping: 0 });
  const request = { system, count: Math.min(n, MOST), outputs: place.length ? ["Omega", "participation"] : ["Omega"] };
  const key = JSON.stringify(request);
  if (!n || key === asked) return;
  [asked, known, said] = [key, null, []];
  const later = { late: false };
  const finding = find(request).then((answer) => {
    if (key !== asked) return;
    known = answer.Omega.length ? { ...answer, all: answer.Omega.length === n } : null;
    said = answer.cautions;
    if (later.late && (known || said.length)) dispatchEvent(new Event("natural-known"));
  }, () => { if (key === asked) asked = ""; }); // the views say what is wrong with the structure
  await Promise.race([finding, new Promise((resolve) => { setTimeout(resolve, PATIENCE); })]);
  later.late = true;
}

/** @param {any} request @returns {Promise<{Omega: number[], flexibility: number | null, cautions: string[]}>} */
async function find(request) {
  const answer = await send("POST", "/v1/compute/natural-frequencies", request);
  let result = await answer.json();
  if (answer.status === 202) {
    while (!result.final) result = await ask("GET", `/v1/jobs/${result.id}?wait=20`);
    result = await ask("GET", `/v1/jobs/${result.id}/result`);
  }
  const { Omega, participation } = result;
  let flexibility = 0;
  Omega.forEach((/** @type {number} */ each, /** @type {number} */ j) => {
    if (participation && each > 0) flexibility += (participation[j][0] / each) ** 2;
  });
  return { Omega: Omega.filter((/** @type {number} */ each) => each > 0), flexibility: flexibility || null, cautions: result.cautions || [] };
}

/** @returns {number | null} the first natural frequency; null where it is not known */
export function lowest() {
  return known ? known.Omega[0] : null;
}

/** @returns {number} the frequency on which motions between stops rest: the last one, or the first of a wide spectrum */
function reference() {
  if (!known) return 1;
  const [first, last] = [known.Omega[0], known.Omega[known.Omega.length - 1]];
  return isWide() ? first : last;
}

/** @returns {boolean} whether the last natural frequency is far above the first, as of beams: motions between stops then rest on the first modes */
export function isWide() {
  return known !== null && (!known.all || known.Omega[known.Omega.length - 1] > WIDE * known.Omega[0]);
}

/** @param {number} value @param {number} [digits] */
function rounded(value, digits = 3) {
  return Number(value.toPrecision(digits));
}

/** @returns {[number, number]} where impact modes are shown first */
export function rangeOfModes() {
  const { modes, wide } = FORMS[state.structure.form];
  const [low, high] = isWide() ? wide : modes;
  return [rounded(low * reference()), rounded(high * reference())];
}

/** @returns {[number, number]} where driven responses are shown first */
export function rangeOfDrive() {
  const [low, high] = FORMS[state.structure.form].driven;
  const first = lowest() || 1;
  return [rounded(low * first), rounded(high * first)];
}

/** @returns {number} the gap of the first stop */
function gap() {
  const [first] = state.structure.stops;
  return first ? Math.abs(first.upper || first.lower || 1) : 1;
}

/**
 * Return a velocity of one coordinate: that of a motion of the size of the gap, times a number. Of a
 * structure with a wide spectrum one coordinate alone carries little mass, and moves the others little.
 * @param {number} share
 */
export function velocity(share) {
  return rounded((isWide() ? 5 : 1) * share * gap() * reference(), 2);
}

/** @param {number} periods @returns {number} so many periods of the motion on which those between stops rest */
export function time(periods) {
  return rounded((periods * 2 * Math.PI) / reference(), 2);
}

/** @returns {number} amplitude of a force by which a resonance with some damping reaches the first stop */
export function amplitude() {
  const { form, parameters: p } = state.structure;
  if (form !== "stored" && form !== "matrices") {
    const stiffness = form === "chain" ? p.stiffness : form === "beam" ? p.EI / p.length ** 3 : (p.Omega0 || 1) ** 2;
    return rounded(0.05 * stiffness, 2);
  }
  return known && known.flexibility ? rounded((0.25 * gap()) / known.flexibility, 1) : 0.05;
}

/** @param {number} to end of a range @returns {string[]} that all of it lies where there are hardly impact modes, if it does */
export function tooLow(to) {
  const first = lowest();
  if (first === null || to > 0.9 * first) return [];
  return [`all of these frequencies lie below the first natural frequency, Ω₁ = ${shown(first, 4)}, where the stop is hardly reached without resonances of high harmonics`];
}
