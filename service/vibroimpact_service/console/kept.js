// Curves that were kept to be compared with the present one, until the page is closed.

import { button, make } from "./dom.js";

/** @typedef {{picture: Element, caption: string, said: string}} Kept */

/** By the name of their view. @type {Map<string, Kept[]>} */
const kept = new Map();
/** Milliseconds after which the address of a view has been written. */
const WRITTEN = 500;
/** More than that would be too small to be read. */
const MOST = 3;

/** The view that is opened once the present one has its answer. @type {string | null} */
let next = null;

/** Open a view, keep its curve, and open another one beside it. @param {string} first @param {string} second their addresses */
export function compareWith(first, second) {
  next = second;
  location.hash = first;
}

/** Go on to the view with which the present one is to be compared, if there is one. @param {() => Promise<void>} keepThis */
export async function goOn(keepThis) {
  if (next === null) return;
  const address = next;
  next = null;
  await keepThis();
  // The address of this view is written first, which would otherwise replace the next one.
  await new Promise((resolve) => { setTimeout(resolve, WRITTEN); });
  location.hash = address;
}

/** @param {string} view @param {Kept} one */
export function keep(view, one) {
  kept.set(view, [...(kept.get(view) || []), one].slice(-MOST));
}

/** @param {string} view @returns {Kept[]} */
export function keptOf(view) {
  return kept.get(view) || [];
}

/** @param {string} view @param {() => void} changed @returns {HTMLElement[]} the kept curves, with what they are of */
export function keptFigures(view, changed) {
  return keptOf(view).map((one, i) => make("figure", { class: "kept", "aria-label": `Kept: ${one.caption}` }, one.picture,
    make("figcaption", { class: "hint" }, make("strong", {}, "Kept: "), `${one.caption}. ${one.said} `, button("Remove", () => {
      kept.set(view, keptOf(view).filter((each) => each !== one));
      changed();
    }, { class: "quiet", "aria-label": `Remove the kept curve ${i + 1}` }))));
}
