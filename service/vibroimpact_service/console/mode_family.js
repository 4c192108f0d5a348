// What the results of a family of impact modes show: bands, stability, frequency over energy.

import { LINES } from "./branch_curves.js";
import { Curve } from "./curve.js";
import { make } from "./dom.js";
import { help, inShort } from "./help.js";
import { labelled } from "./units.js";
import { NEUTRAL } from "./words.js";

/** @typedef {import("./curve.js").Band} Band */

/** Dashes of bands that are those of the computed frequencies only. */
const ESTIMATED = [2, 2];

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
    ...bands.bands.flatMap((/** @type {any} */ each) => [{ ...span(each), colour: "band" }, { ...span(each), colour: "accent", row: 0, ...(each.certified ? {} : { dash: ESTIMATED }) }]),
    ...(bands.stability || []).map((/** @type {any} */ each) => ({ ...span(each), row: 1, ...styleOf(each) })),
  ];
}

/** @param {any} grid @returns {Band[]} */
function sampled({ exists, frequency: { Omega } }) {
  /** @type {Band[]} */
  const ranges = [];
  for (let i = 0; i < exists.length; i += 1) {
    if (!exists[i]) continue;
    if (exists[i - 1]) ranges[ranges.length - 1].stop = Omega[i];
    else ranges.push({ start: Omega[i], stop: Omega[i], colour: "accent", row: 0, dash: ESTIMATED });
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

/** @param {any} each range of the bands @returns {{colour: string, dash?: number[]}} as branches of driven motions have it */
function styleOf(each) {
  const { colour, dash } = isNeutral(each) ? LINES.neutral : LINES.unstable;
  return { colour, dash };
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
    x: labelled("Ω", "Omega"), y: labelled("energy", "energy"), height: 300, log: true, upright: true, label: "Energy of the admissible impact modes, across, over their frequency, upwards.",
    series: [bands ? { label: "neutral", ...LINES.neutral } : { label: "impact mode", colour: "accent", width: 2.6 }, { label: "unstable", ...LINES.unstable }],
  });
  const ranges = ((bands && bands.stability) || []).filter(isNeutral);
  const neutral = Omega.map((/** @type {number} */ x) => !bands || ranges.some((/** @type {any} */ each) => each.start <= x && x <= each.stop));
  curve.extent = [Omega[0], Omega[Omega.length - 1]];
  curve.range = [Math.min(...used) / 1.5, Math.max(...used) * 1.5];
  curve.show([Omega, energy.map((value, i) => (neutral[i] || neutral[i - 1] ? value : null)), energy.map((value, i) => (neutral[i] ? null : value))]);
  return curve;
}

/** @param {string[]} names of the stops that are struck @returns {HTMLElement[]} */
export function legend(names) {
  /** @param {string} kind @param {string} text @param {HTMLElement} [more] */
  const item = (kind, text, more) => make("li", {}, make("span", { class: `key ${kind}`, "aria-hidden": "true" }), text, more);
  return [
    ...(names.length > 1 ? names.map((name, c) => item(`stop-${c % 4}`, name)) : [item("thick", "impact mode")]),
    item("thin", "phantom", help("phantom")), item("band", "exists (certified)", help("band")), item("sampled", "at computed frequencies"),
    item("line-neutral", "neutral", help("stability")), item("line-unstable", "unstable"), item("natural", "natural frequency", help("omega"))];
}

/** @returns {HTMLElement} a line on what is shown */
export function introduction() {
  return make("p", { class: "hint" }, `Impact mode: ${lower(inShort("mode"))}. Phantom: ${lower(inShort("phantom"))}.`);
}

/** @param {string} text */
function lower(text) {
  return text[0].toLowerCase() + text.slice(1);
}
