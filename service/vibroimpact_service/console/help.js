// What the words of the page mean, behind question marks.

import { button, make } from "./dom.js";

/** @typedef {keyof typeof TERMS} Term */

/** Each in two sentences, with the operation of the HTTP interface that says more, and the page of the documentation. */
const TERMS = {
  mode: ["Impact mode", "A periodic motion of the undriven, undamped structure in which stops are struck again and again, twice in each period. Impact modes take the place of natural modes once the amplitude reaches the stops.", "compute_impact_modes", "theory/impact-modes"],
  phantom: ["Phantom", "A solution of the equations that is no motion of the structure: a stop would have to pull, or the structure would pass through a stop between impacts.", "compute_impact_modes", "theory/impact-modes"],
  band: ["Certified band", "A range of frequencies in which an impact mode exists at every frequency, proved and not only found at the frequencies that were computed.", "compute_existence_bands", "theory/existence-bands"],
  stability: ["Stability", "Unstable: small deviations grow from period to period. Neutral: they neither grow nor decay, as in every motion that loses no energy. Stable: they die out.", "compute_existence_bands", "theory/periodic-motions"],
  momentum: ["Momentum per impact", "What one impact exchanges between structure and stop: the integral of the contact force. With the impulse parameter p and ω = 2Ω/π it is 2p/ω.", "compute_impact_modes", "theory/impact-modes"],
  omega: ["Frequency Ω", "An angular frequency, in radians per unit of time: 2π divided by the period. In Hz it is Ω/2π.", "compute_natural_frequencies", "theory/impact-modes"],
  gap: ["Gap", "How far the coordinate can move before it meets the stop, on its lower and on its upper side; empty where there is no stop on that side.", "compute_time_history", "structures"],
  restitution: ["Restitution", "Speed after an impact over the speed before it: 1 loses no energy, 0 does not bounce. A stop with a stiffness has none; it loses energy by its damping.", "compute_time_history", "theory/time-histories"],
  struck: ["Struck", "The impact modes that are shown are those that strike all of the stops marked so. The others still limit the motion.", "compute_impact_modes", "theory/impact-modes"],
  horizon: ["Horizon of trust", "Impacts make deviations grow. Beyond this time the rounding of double precision has grown to the size of the motion, so that only its statistics mean something.", "compute_time_history", "theory/accuracy"],
  branch: ["Branch", "Motions that change continuously with the frequency of the drive. Branches turn back at folds, double their period at flips, and end where a stop is just touched (grazing).", "compute_branches", "theory/periodic-motions"],
  attractor: ["Attractor", "What motions of the driven structure settle on after a while: a periodic motion, one of two frequencies, or chaos. The initial states from which one is reached are its basin.", "compute_attractors", "theory/periodic-motions"],
  ensemble: ["Ensemble", "Motions from many initial states at once. Neighbouring cells of different colours are motions that a small change of the start makes very different.", "compute_ensemble", "theory/time-histories"],
  map: ["Map", "The family of impact modes for many values of one number of the structure, side by side.", "compute_sweep", "sweeps"],
};

let count = 0;

/**
 * Return a question mark that says what a word means.
 * @param {Term} term
 * @returns {HTMLElement}
 */
export function help(term) {
  const [title, text, operation, page] = TERMS[term];
  count += 1;
  const id = `help-${count}`;
  const note = make("div", { id, popover: "auto", class: "explained" }, make("strong", {}, title), make("p", {}, text),
    make("p", { class: "hint" }, make("a", { href: `/docs#${operation}` }, "Its request and answer"), ` · documentation: docs/${page}.md`));
  return make("span", { class: "helped" }, button("?", () => {}, { class: "help", popovertarget: id, "aria-label": `What is: ${title}` }), note);
}

/** @param {Term} term @returns {string} its first sentence */
export function inShort(term) {
  return TERMS[term][1].split(". ")[0].replace(/\.$/, "");
}
