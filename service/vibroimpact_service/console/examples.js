// Six examples to open, from one mass to finite elements.

import { choiceField } from "./fields.js";
import { preset, stop } from "./structures.js";

/** @typedef {{title: string, view: string, structure: () => import("./structures.js").Structure, fields?: Record<string, any>}} Example */

/** @param {string} form @param {Record<string, any>} more @returns {import("./structures.js").Structure} */
function made(form, { parameters = {}, ...more }) {
  const base = preset(form);
  return { ...base, ...more, parameters: { ...base.parameters, ...parameters } };
}

/** @type {Example[]} */
export const EXAMPLES = [
  { title: "1. One mass between two stops", view: "modes", structure: () => made("oscillator", {}) },
  {
    title: "2. One driven mass, one stop: flips and folds", view: "driven", fields: { from: 0.4, to: 3, points: 400, periods: 1, load: [{ dof: 0, amplitude: 1 }] },
    structure: () => made("oscillator", { damping: 0.05, stops: [stop(0, null, 0.2, 0.7)] }),
  },
  { title: "3. Two masses, each with a stop", view: "modes", structure: () => made("two_mass", { stops: [stop(0, 1, 1), stop(1, 0.5, 0.5)] }) },
  {
    title: "4. Impact absorber on a vibrating mass", view: "history", fields: { dof: 0, x: 0, v: 0.4, duration: 120, coordinate: 0 },
    structure: () => made("absorber", { damping: 0.005, stops: [stop(1, 0.3, 0.3, 0.6, 0)] }),
  },
  { title: "5. Chain of 13 masses, the sixth between stops", view: "modes", structure: () => made("chain", {}) },
  {
    title: "6. Finite elements: cantilever with an elastic stop", view: "history", fields: { dof: 14, x: 0, v: 3, duration: 4, coordinate: 14 },
    structure: () => made("beam", { damping: 0.01, parameters: { elements: 8 }, stops: [{ ...stop(14, null, 0.02), stiffness: 500, damping: 0.1 }] }),
  },
];

/** @param {(example: Example) => void} open @returns {HTMLElement} */
export function exampleField(open) {
  return choiceField("Open an example", [["", "choose …"], ...EXAMPLES.map(({ title }, i) => /** @type {[string, string]} */ ([String(i), title]))], "", (value) => {
    if (value !== "") open(EXAMPLES[Number(value)]);
  }, { name: "example" });
}
