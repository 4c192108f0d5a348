// What the page shows, kept in its address, so that a view can be sent to a colleague.

import { FORMS, LARGEST, preset } from "./structures.js";

/**
 * @typedef {{view: string, structure: import("./structures.js").Structure, fields: Record<string, any>}} State
 */

/** Characters of a geometry that is kept in the address. */
const LONGEST = 4000;

/** @type {State} */
export const state = { view: "modes", structure: preset("chain"), fields: {} };

/** @type {Set<(changed: string) => void>} */
const listeners = new Set();

/** @param {(changed: string) => void} listener called with what changed: view, structure, fields or all */
export function onChange(listener) {
  listeners.add(listener);
}

/** @returns {string} the address of what is shown */
export function address() {
  const parameters = new URLSearchParams();
  const { matrices, geometry, ...kept } = state.structure;
  // What is stored at the service is named by its id, and read again from there. Long addresses
  // get lost on their way, so that they hold no large geometry.
  const drawn = JSON.stringify(geometry || null).length < LONGEST ? { geometry } : {};
  parameters.set("structure", JSON.stringify({ ...kept, ...drawn, ...(kept.form === "stored" ? {} : { matrices }) }));
  for (const [name, value] of Object.entries(state.fields)) parameters.set(name, JSON.stringify(value));
  return `#${state.view}?${parameters}`;
}

/** Take over what the address says; what it does not say, or wrongly, keeps its value. */
export function readAddress() {
  const [view, query] = location.hash.slice(1).split("?");
  if (view) state.view = view;
  /** @type {Record<string, any>} */
  const fields = {};
  for (const [name, text] of new URLSearchParams(query || "")) {
    try {
      const value = JSON.parse(text);
      if (name === "structure") state.structure = complete(value);
      else fields[name] = value;
    } catch (error) {
      if (!(error instanceof SyntaxError)) throw error;
    }
  }
  state.fields = fields;
}

/** What of the address was not taken over, in words. */
export const note = { refused: "" };

/**
 * Say which number of a structure in an address no page can draw: its field would not take it.
 * @param {any} given @returns {string} empty: none
 */
function outside({ form, parameters, matrices }) {
  for (const { name, label, min, max, whole } of FORMS[form].parameters) {
    const value = (parameters || {})[name];
    if (value === undefined) continue;
    if (typeof value !== "number" || (max !== undefined && value > max) || (min !== undefined && value < min) || (whole && !Number.isInteger(value))) return `${label} = ${String(value).slice(0, 40)}`;
  }
  if (form !== "matrices" || !matrices) return "";
  const sizes = [matrices.M, matrices.K, ...(matrices.C ? [matrices.C] : [])].map((each) => (Array.isArray(each) && each.every((row) => Array.isArray(row) && row.length === each.length) ? each.length : 0));
  return sizes.every((each) => each === sizes[0] && each > 0 && each <= LARGEST) ? "" : "matrices that cannot be edited";
}

/** @param {any} given @returns {import("./structures.js").Structure} */
function complete(given) {
  if (!given || !Object.hasOwn(FORMS, given.form)) return state.structure;
  const base = preset(given.form);
  const wrong = outside(given);
  if (wrong) {
    note.refused = `The address has ${wrong}; the structure is shown with the usual numbers.`;
    return { ...base, stops: base.stops };
  }
  const stops = Array.isArray(given.stops) ? given.stops.map((/** @type {any} */ each) => ({ ...base.stops[0], relativeTo: null, ...each })) : base.stops;
  const loads = Array.isArray(given.loads) ? given.loads : [];
  return { ...base, ...given, parameters: { ...base.parameters, ...given.parameters }, stops, loads };
}

/**
 * Change fields of the view and say so.
 * @param {Record<string, any>} fields undefined removes one
 * @param {{silent?: boolean}} [options] silent: only the address changes
 */
export function setFields(fields, { silent = false } = {}) {
  for (const [name, value] of Object.entries(fields)) {
    if (value === undefined) delete state.fields[name];
    else state.fields[name] = value;
  }
  write(false);
  if (!silent) tell("fields");
}

/** @param {import("./structures.js").Structure} structure @param {Record<string, any>} [fields] replace those of the view */
export function setStructure(structure, fields) {
  state.structure = structure;
  if (fields) state.fields = fields;
  write(false);
  tell("structure");
}

/** @param {string} view @param {Record<string, any>} [fields] */
export function show(view, fields = {}) {
  state.view = view;
  state.fields = fields;
  write(true);
  tell("view");
}

/** @param {string} changed */
function tell(changed) {
  for (const listener of listeners) listener(changed);
}

let written = "";
/** @type {ReturnType<typeof setTimeout> | undefined} */
let timer;

/** @param {boolean} entry whether going back leads here again */
function write(entry) {
  clearTimeout(timer);
  const now = () => {
    written = address();
    if (written !== location.hash) history[entry ? "pushState" : "replaceState"](null, "", written);
  };
  // Browsers refuse more than some hundred changes of the address in half a minute.
  if (entry) now();
  else timer = setTimeout(now, 200);
}

for (const event of ["hashchange", "popstate"]) {
  addEventListener(event, () => {
    if (location.hash === written) return;
    written = location.hash;
    readAddress();
    tell("all");
  });
}
