// How the impact mode at the cursor changes with the numbers of its structure: derivatives, when asked for.

import { compute } from "./api.js";
import { make } from "./dom.js";
import { showError } from "./fields.js";
import { shown } from "./numbers.js";
import { labelled } from "./units.js";

/** @typedef {import("./structures.js").Stop} Stop */
/** @typedef {{path: string, label: string, value: number}} Parameter */

/** @param {Stop[]} stops @param {number} Omega @returns {Parameter[]} what impact modes are differentiated by */
export function parametersOf(stops, Omega) {
  const gaps = stops.flatMap(({ lower, upper }, i) => {
    if (upper !== null && upper === lower) return [{ path: `system.constraints.${i}.gap`, label: `gap of stop ${i}`, value: upper }];
    const sides = /** @type {["lower" | "upper", number | null][]} */ ([["lower", lower], ["upper", upper]]);
    return sides.flatMap(([side, value]) => (value === null ? [] : [{ path: `system.constraints.${i}.gap.${side}`, label: `${side} gap of stop ${i}`, value }]));
  });
  return [...gaps, { path: "system.K.scale", label: "all stiffness", value: 1 }, { path: "system.M.scale", label: "all mass", value: 1 }, { path: "frequency", label: "frequency Ω", value: Omega }];
}

/** @param {number | null} rate @param {number} value of the parameter @param {number} of what changes @returns {string} in percent for one percent */
function percent(rate, value, of) {
  if (rate === null || !of || !value) return "–";
  const share = (rate * value) / of;
  return `${share < 0 ? "" : "+"}${shown(share, 3)} %`;
}

/**
 * A part of the page that is computed when it is opened, and anew while it is open.
 * @param {() => {request: any, parameters: Parameter[], names: string[]} | null} asked null: there is no mode; names: of the struck stops
 */
export function ratesPart(asked) {
  const body = make("div");
  const element = make("details", { class: "rates" }, make("summary", {}, "How it changes with the structure"), body);
  let turn = 0;
  async function update() {
    if (!element.open) return;
    const mode = asked();
    turn += 1;
    const mine = turn;
    if (!mode) {
      body.replaceChildren();
      return;
    }
    try {
      const result = await compute("impact-modes", { ...mode.request, outputs: ["impulse", "energy"], derivatives: mode.parameters.map(({ path }) => path) });
      if (mine === turn) body.replaceChildren(...tableOf(result, mode));
    } catch (error) {
      showError(error);
    }
  }
  element.addEventListener("toggle", update);
  return { element, update };
}

/** @param {any} result @param {{parameters: Parameter[], names: string[]}} mode @returns {HTMLElement[]} */
function tableOf({ momentum, energy, derivative, error }, { parameters, names }) {
  const quantities = [
    ...names.map((name, c) => ({ label: labelled(names.length > 1 ? `momentum at ${name}` : "momentum", "momentum"), value: momentum[0][c], rates: derivative.momentum[0][c], errors: error.derivative.momentum[0][c] })),
    { label: labelled("energy", "energy"), value: energy[0], rates: derivative.energy[0], errors: error.derivative.energy[0] }];
  const head = make("tr", {}, ...["1 % more of", "changes", "by", "derivative and its error"].map((text) => make("th", { scope: "col" }, text)));
  const rows = parameters.flatMap(({ label, value }, i) => quantities.map(({ label: what, value: of, rates, errors }, k) => make("tr", {},
    ...(k ? [] : [make("th", { scope: "row", rowspan: quantities.length }, label)]), make("td", {}, what), make("td", {}, percent(rates[i], value, of)), make("td", {}, `${shown(rates[i], 5)}${errors ? ` ± ${shown(errors[i], 2)}` : ""} per unit`))));
  const [reason] = derivative.reason;
  return [
    make("div", { class: "scroll", tabindex: 0, role: "group", "aria-label": "Derivatives of the mode at the cursor" }, make("table", {}, make("thead", {}, head), make("tbody", {}, ...rows))),
    ...(reason.some((/** @type {string} */ each) => each !== "ok") ? [make("p", { class: "hint" }, "At this frequency no impulse brings the structure to its stops: there are no derivatives.")] : []),
    make("p", { class: "hint" }, "Derivatives of the solution itself, not differences of two. Frequencies are held while the others change."),
  ];
}
