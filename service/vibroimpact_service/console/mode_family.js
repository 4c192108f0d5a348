// What the results of a family of impact modes show: bands, stability, frequency over energy.

import { Curve } from "./curve.js";
import { make } from "./dom.js";
import { NEUTRAL } from "./words.js";

/** @typedef {import("./curve.js").Band} Band */

/**
 * Return the bands behind the curve and in the strip below it: certified ones with their stability,
 * or, where they were not searched, the ranges of computed frequencies with an impact mode.
 * @param {any} grid result of impact-modes
 * @param {any} bands result of existence-bands, or null
 * @returns {Band[]}
 */
export function shading(grid, bands) {
  if (!bands) return sampled(grid);
  return [
    ...bands.bands.flatMap((/** @type {any} */ each) => [{ ...span(each), colour: "band" }, { ...span(each), colour: "accent", row: 0, hatched: !each.certified }]),
    ...(bands.stability || []).map((/** @type {any} */ each) => ({ ...span(each), colour: isNeutral(each) ? "neutral" : "unstable", row: 1, hatched: !isNeutral(each) })),
  ];
}

/** @param {any} grid @returns {Band[]} */
function sampled({ exists, frequency: { Omega } }) {
  /** @type {Band[]} */
  const ranges = [];
  for (let i = 0; i < exists.length; i += 1) {
    if (!exists[i]) continue;
    if (exists[i - 1]) ranges[ranges.length - 1].stop = Omega[i];
    else ranges.push({ start: Omega[i], stop: Omega[i], colour: "accent", row: 0, hatched: true });
  }
  return ranges;
}

/** @param {{start: number, stop: number}} each */
function span({ start, stop }) {
  return { start, stop };
}

/**
 * Whether deviations do not grow in a range of the bands. As nothing is lost they do not decay either.
 * @param {any} each
 */
function isNeutral(each) {
  return each.stable === true || each.stable === "yes";
}

/**
 * Say what becomes of deviations from modes at a frequency, as far as the bands tell.
 * @param {any} bands result of existence-bands, or null
 * @param {number} Omega
 */
export function stabilityIn(bands, Omega) {
  const range = ((bands && bands.stability) || []).find((/** @type {any} */ each) => each.start <= Omega && Omega <= each.stop);
  if (!range) return "not known";
  return isNeutral(range) ? NEUTRAL : "unstable: deviations grow";
}

/**
 * Draw the frequency over the energy of admissible modes.
 * @param {HTMLElement} root
 * @param {any} grid result of impact-modes
 * @param {any} bands result of existence-bands, or null
 * @returns {Curve | null} null where there is none
 */
export function energyCurve(root, grid, bands) {
  const { exists, frequency: { Omega } } = grid;
  /** @type {(number | null)[]} */
  const energy = grid.energy.map((/** @type {number} */ value, /** @type {number} */ i) => (exists[i] && value > 0 ? value : null));
  const used = energy.filter((value) => value !== null).map(Number);
  if (!used.length) {
    root.replaceChildren(make("p", { class: "hint" }, "There is no admissible impact mode in this range."));
    return null;
  }
  const holder = make("div");
  root.replaceChildren(holder);
  const curve = new Curve(holder, {
    x: "Ω", y: "energy (log)", height: 300, log: true, upright: true, label: "Energy of the admissible impact modes, across, over their frequency, upwards.",
    series: [{ label: bands ? "neutral" : "impact mode", colour: bands ? "neutral" : "accent", width: 2.6 }, { label: "unstable", colour: "unstable", width: 1.6, dash: [5, 3] }],
  });
  const ranges = ((bands && bands.stability) || []).filter(isNeutral);
  const neutral = Omega.map((/** @type {number} */ x) => !bands || ranges.some((/** @type {any} */ each) => each.start <= x && x <= each.stop));
  curve.extent = [Omega[0], Omega[Omega.length - 1]];
  curve.range = [Math.min(...used) / 1.5, Math.max(...used) * 1.5];
  curve.show([Omega, energy.map((value, i) => (neutral[i] || neutral[i - 1] ? value : null)), energy.map((value, i) => (neutral[i] ? null : value))]);
  return curve;
}
