// Sliders that move what is shown while they are dragged.

import { make } from "./dom.js";
import { state } from "./state.js";

/** How far gaps are widened and narrowed by their slider, as a power of ten. */
const DECADES = 1;
/** Ratio of damping at the end of its slider. */
const MOST_DAMPING = 0.3;

/**
 * @param {string} label
 * @param {{min: number, max: number, value: number}} range
 * @param {(value: number) => void} move while it is dragged
 * @param {() => void} settle once it is let go
 */
function slider(label, range, move, settle) {
  const input = make("input", { type: "range", step: "any", "aria-label": label, title: label, ...range });
  input.addEventListener("input", () => {
    move(Number(input.value));
    dispatchEvent(new Event("structure-moving"));
  });
  input.addEventListener("change", settle);
  return input;
}

/** @param {HTMLElement} field @param {number} value */
function fill(field, value) {
  const input = field.querySelector("input");
  if (input) input.value = String(value);
}

/** @param {number} value */
function rounded(value) {
  return Number(value.toPrecision(3));
}

/**
 * Return a slider that widens and narrows both gaps of a stop.
 * @param {number} index @param {HTMLElement} lower @param {HTMLElement} upper their fields @param {() => void} settle
 */
export function gapSlider(index, lower, upper, settle) {
  const stop = state.structure.stops[index];
  const begun = { lower: stop.lower, upper: stop.upper };
  return slider(`Gaps of stop ${index}, to a tenth or tenfold`, { min: -DECADES, max: DECADES, value: 0 }, (power) => {
    const now = state.structure.stops[index];
    for (const [side, field] of /** @type {["lower" | "upper", HTMLElement][]} */ ([["lower", lower], ["upper", upper]])) {
      const before = begun[side];
      if (before === null) continue;
      now[side] = rounded(before * 10 ** power);
      fill(field, Number(now[side]));
    }
  }, settle);
}

/** Return a slider of the restitution of a stop. @param {number} index @param {HTMLElement} field @param {() => void} settle */
export function restitutionSlider(index, field, settle) {
  return slider(`Restitution of stop ${index}`, { min: 0, max: 1, value: state.structure.stops[index].restitution }, (value) => {
    state.structure.stops[index].restitution = Math.round(100 * value) / 100;
    fill(field, state.structure.stops[index].restitution);
  }, settle);
}

/** Return a slider of the ratio of damping. @param {HTMLElement} field @param {() => void} settle */
export function dampingSlider(field, settle) {
  return slider("Damping ratio", { min: 0, max: MOST_DAMPING, value: state.structure.damping }, (value) => {
    state.structure.damping = rounded(value);
    fill(field, state.structure.damping);
  }, settle);
}
