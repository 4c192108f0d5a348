// How what is seen at the cursor changes with the numbers of its structure: derivatives, when asked for.

import { compute } from "./api.js";
import { make } from "./dom.js";
import { showError } from "./fields.js";
import { shown } from "./numbers.js";
import { isSoft } from "./structures.js";
import { labelled } from "./units.js";

/** @typedef {import("./structures.js").Stop} Stop */
/** @typedef {{path: string, label: string, value: number}} Parameter */
/** @typedef {{label: string, value: number, rates: (number | null)[], errors: number[]}} Quantity by parameter */
/**
 * What is differentiated at the cursor.
 * @typedef {{kind: string, request: any, parameters: Parameter[], of: (result: any) => Quantity[], missing: (result: any) => string, note: string}} Asked
 *   missing: why there are no derivatives; empty: there are
 */

/** @param {Stop[]} stops @returns {Parameter[]} */
function gapsOf(stops) {
  return stops.flatMap(({ lower, upper }, i) => {
    if (upper !== null && upper === lower) return [{ path: `system.constraints.${i}.gap`, label: `gap of stop ${i}`, value: upper }];
    const sides = /** @type {["lower" | "upper", number | null][]} */ ([["lower", lower], ["upper", upper]]);
    return sides.flatMap(([side, value]) => (value === null ? [] : [{ path: `system.constraints.${i}.gap.${side}`, label: `${side} gap of stop ${i}`, value }]));
  });
}

/** @type {Parameter[]} */
const MATRICES = [{ path: "system.K.scale", label: "all stiffness", value: 1 }, { path: "system.M.scale", label: "all mass", value: 1 }];

/** @param {any} request @param {Stop[]} stops @param {string[]} names of the struck ones @param {number} Omega @returns {Asked} */
export function ofMode(request, stops, names, Omega) {
  return {
    kind: "impact-modes", request: { ...request, outputs: ["impulse", "energy"] },
    parameters: [...gapsOf(stops), ...MATRICES, { path: "frequency", label: "frequency Ω", value: Omega }],
    of: ({ momentum, energy, derivative, error }) => [
      ...names.map((name, c) => ({ label: labelled(names.length > 1 ? `momentum at ${name}` : "momentum", "momentum"), value: momentum[0][c], rates: derivative.momentum[0][c], errors: error.derivative.momentum[0][c] })),
      { label: labelled("energy", "energy"), value: energy[0], rates: derivative.energy[0], errors: error.derivative.energy[0] }],
    missing: ({ derivative }) => (derivative.reason[0].some((/** @type {string} */ each) => each !== "ok") ? "At this frequency no impulse brings the structure to its stops: there are no derivatives." : ""),
    note: "Frequencies are held while the others change.",
  };
}

/** @type {Record<string, string>} */
const WITHOUT = {
  event: "an impact happens at this time, where the displacement has two slopes", contact: "a coordinate has come to rest at its stop", order: "two coordinates are struck at one instant",
  grazing: "a stop is hardly touched before", unpredictable: "double precision cannot tell the motion any more", start: "the motion starts with an impact",
};

/**
 * Return what is asked of a motion between rigid stops at one time.
 * @param {any} request of the motion, to its end @param {Stop[]} stops @param {{t: number, dof: number, label: string}} seen
 * @returns {Asked}
 */
export function ofMotion(request, stops, { t, dof, label }) {
  const { system, initial, load = [] } = request;
  const damping = system.zeta ? { path: "system.zeta", value: system.zeta } : system.damping ? { path: "system.damping.ratio", value: system.damping.ratio } : system.C ? { path: "system.C.scale", value: 1 } : null;
  const moved = ["x", "v"].flatMap((name) => (initial[name] || []).flatMap((/** @type {number} */ value, /** @type {number} */ i) => (value ? [{ path: `initial.${name}.${i}`, label: `initial ${name === "x" ? "displacement" : "velocity"} of coordinate ${i}`, value }] : [])));
  return {
    kind: "time-history", request: { system, initial, ...(load.length ? { load } : {}), t_end: t, t: [t], dofs: [dof], outputs: ["x", "impacts"] },
    parameters: [...gapsOf(stops), ...stops.flatMap((each, i) => (isSoft(each) || !each.restitution ? [] : [{ path: `system.constraints.${i}.restitution`, label: `restitution of stop ${i}`, value: each.restitution }])),
      ...MATRICES, ...(damping ? [{ ...damping, label: "damping" }] : []), ...moved.slice(0, 4),
      ...load.map((/** @type {import("./loads.js").Load} */ { amplitude }, /** @type {number} */ i) => ({ path: `load.${i}.amplitude`, label: `amplitude of force ${i}`, value: amplitude }))],
    of: ({ x, impacts, derivative, error }) => {
      const rows = [{ label, value: x[0][0], rates: derivative.x[0][0], errors: error.derivative.x[0][0] }];
      const last = impacts.time.length - 1;
      if (last < 0) return rows;
      const [rates, errors] = [derivative.impacts, error.derivative.impacts];
      return [...rows,
        { label: labelled("time of the latest impact", "time"), value: impacts.time[last], rates: rates.time[last], errors: errors.time[last] },
        { label: labelled("velocity before it", "velocity"), value: impacts.velocity[last], rates: rates.velocity[last], errors: errors.velocity[last] }];
    },
    missing: ({ derivative: { reason } }) => (reason[0] === "ok" ? "" : `There are no derivatives here: ${WITHOUT[reason[0]] || reason[0]}.`),
    note: "The time of the cursor is held.",
  };
}

/** @param {number | null} rate @param {number} value of the parameter @param {number} of what changes @returns {string} in percent for one percent */
function percent(rate, value, of) {
  if (rate === null || !of || !value) return "–";
  const share = (rate * value) / of;
  return `${share < 0 ? "" : "+"}${shown(share, 3)} %`;
}

/**
 * A part of the page that is computed when it is opened, and anew while it is open.
 * @param {() => Asked | null} asked null: there is nothing to differentiate
 */
export function ratesPart(asked) {
  const body = make("div");
  const element = make("details", { class: "rates" }, make("summary", {}, "How it changes with the structure"), body);
  let turn = 0;
  async function update() {
    if (!element.open) return;
    const now = asked();
    turn += 1;
    const mine = turn;
    if (!now) {
      body.replaceChildren(make("p", { class: "hint" }, "Pause, and move the cursor to where it is to be told."));
      return;
    }
    try {
      const result = await compute(now.kind, { ...now.request, derivatives: now.parameters.map(({ path }) => path) });
      if (mine === turn) body.replaceChildren(...tableOf(result, now));
    } catch (error) {
      showError(error);
    }
  }
  element.addEventListener("toggle", update);
  return { element, update };
}

/** @param {any} result @param {Asked} asked @returns {HTMLElement[]} */
function tableOf(result, { parameters, of: quantitiesOf, missing, note }) {
  const quantities = quantitiesOf(result);
  const head = make("tr", {}, ...["1 % more of", "changes", "by", "derivative and its error"].map((text) => make("th", { scope: "col" }, text)));
  const rows = parameters.flatMap(({ label, value }, i) => quantities.map(({ label: what, value: of, rates, errors }, k) => make("tr", {},
    ...(k ? [] : [make("th", { scope: "row", rowspan: quantities.length }, label)]), make("td", {}, what), make("td", {}, percent(rates[i], value, of)), make("td", {}, `${shown(rates[i], 5)}${errors ? ` ± ${shown(errors[i], 2)}` : ""} per unit`))));
  const reason = missing(result);
  return [
    make("div", { class: "scroll", tabindex: 0, role: "group", "aria-label": "Derivatives of what is seen at the cursor" }, make("table", {}, make("thead", {}, head), make("tbody", {}, ...rows))),
    ...(reason ? [make("p", { class: "hint" }, reason)] : []),
    make("p", { class: "hint" }, `Derivatives of the solution itself, not differences of two. ${note}`),
  ];
}
