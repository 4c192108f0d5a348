// Units of the structure on the page, at its axes and values.

import { state } from "./state.js";
import { axisName, coordinateName, measure } from "./structures.js";

/** @typedef {"time" | "length" | "angle" | "velocity" | "force" | "momentum" | "energy" | "Omega" | "stiffness" | "dashpot"} Quantity */

/** Units to choose from, for matrices that came without. @type {[string, {length: string, mass: string, time: string}][]} */
export const UNITS = [["m, kg, s", { length: "m", mass: "kg", time: "s" }], ["mm, t, s", { length: "mm", mass: "t", time: "s" }]];

/** Composed units with names of their own, which matrices in either of these units have. @type {Record<string, string>} */
const NAMES = { "kg m/s²": "N", "t mm/s²": "N", "kg/s²": "N/m", "t/s²": "N/mm", "kg/s": "N s/m", "t/s": "N s/mm", "kg m/s": "N s", "t mm/s": "N s", "kg m²/s²": "J", "t mm²/s²": "mJ" };

/** @param {Quantity} quantity @returns {string} empty: the structure has no units */
function unit(quantity) {
  const units = state.structure.matrices && state.structure.matrices.units;
  if (!units) return "";
  const { length, mass, time } = units;
  const composed = {
    time, length, angle: "rad", velocity: `${length}/${time}`, force: `${mass} ${length}/${time}²`, momentum: `${mass} ${length}/${time}`,
    energy: `${mass} ${length}²/${time}²`, stiffness: `${mass}/${time}²`, dashpot: `${mass}/${time}`, Omega: `rad/${time}`,
  }[quantity];
  return NAMES[composed] || composed;
}

/** @param {string} text @param {Quantity} quantity @returns {string} as "energy (J)" */
export function labelled(text, quantity) {
  const name = unit(quantity);
  return name ? `${text} (${name})` : text;
}

/** @param {number} exponent of the indentation in the force @returns {string} as "Stiffness (N/m^1.5)" */
export function stiffnessLabel(exponent) {
  if (exponent === 1 || !unit("length")) return labelled("Stiffness", "stiffness");
  return `Stiffness (${unit("force")}/${unit("length")}^${exponent})`;
}

/** @param {number} dof @returns {string} its displacement, as the label of an axis */
export function axisOf(dof) {
  return labelled(axisName(state.structure, dof), measure(state.structure, dof));
}

/** @param {string} what of it @param {number} dof @returns {string} as the label of an axis */
export function axisOfWhat(what, dof) {
  return labelled(`${what} of ${coordinateName(state.structure, dof)}`, measure(state.structure, dof));
}

/** @param {string} value @param {Quantity} quantity @returns {string} as "0.3 J" */
export function withUnit(value, quantity) {
  const name = unit(quantity);
  return name && value !== "–" ? `${value} ${name}` : value;
}

/** @returns {boolean} whether the structure counts time in seconds */
export function inSeconds() {
  return unit("time") === "s";
}

/** @param {number} Omega @param {string} value @returns {string} with its unit, and in Hz where time is in seconds */
export function frequencyInWords(Omega, value) {
  return withUnit(value, "Omega") + (inSeconds() ? ` = ${Number((Omega / (2 * Math.PI)).toPrecision(6))} Hz` : "");
}
