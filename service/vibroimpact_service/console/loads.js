// Fields of harmonic loads, in any number, and their documents.

import { button, make } from "./dom.js";
import { numberField } from "./fields.js";

/**
 * A harmonic load: amplitude cos(frequency t + phase), or, of a drive, cos(harmonic Ω t + phase).
 * @typedef {{dof: number, amplitude: number, frequency?: number, harmonic?: number, phase?: number}} Load
 */

/**
 * Return the fields of loads, each in a row of its own, with buttons that add and remove one.
 * @param {Load[]} loads
 * @param {"frequency" | "harmonic"} tempo what tells how fast they are
 * @param {import("./base_view.js").BaseView} view whose field `load` they are
 * @returns {HTMLElement}
 */
export function loadFields(loads, tempo, view) {
  /** @param {number} index @param {keyof Load} name */
  const set = (index, name) => (/** @type {number | null} */ value) => view.change({
    load: loads.map((each, i) => (i === index ? Object.assign(each, { [name]: value }) : each)),
  });
  const rows = loads.map((load, index) => {
    const at = `/load/${index}`;
    return make("div", { class: "load", role: "group", "aria-label": `Force ${index}` },
      numberField("Force on coordinate", load.dof, set(index, "dof"), { pointer: `${at}/dof`, whole: true, min: 0 }),
      numberField("amplitude", load.amplitude, set(index, "amplitude"), { pointer: `${at}/amplitude` }),
      tempo === "harmonic" ? numberField("times Ω", load.harmonic ?? 1, set(index, "harmonic"), { pointer: `${at}/harmonic`, whole: true, min: 1 })
        : numberField("its frequency", load.frequency ?? 1, set(index, "frequency"), { pointer: `${at}/frequency`, min: 0 }),
      numberField("phase", load.phase ?? 0, set(index, "phase"), { pointer: `${at}/phase` }),
      button("Remove", () => view.reshape({ load: loads.filter((_, i) => i !== index) }), { class: "quiet", "aria-label": `Remove force ${index}` }));
  });
  const last = loads[loads.length - 1] || { dof: 0, amplitude: 0.1 };
  const next = tempo === "harmonic" ? { harmonic: loads.length ? (last.harmonic ?? 1) + 1 : 1 } : { frequency: last.frequency || 1 };
  return make("div", { class: "loads", "data-pointer": "/load", tabindex: -1 }, ...rows,
    make("div", {}, button("Add a force", () => view.reshape({ load: [...loads, { dof: last.dof, amplitude: last.amplitude, phase: 0, ...next }] }), { class: "quiet" }),
      make("span", { class: "fault", id: "fault-load" })));
}

/** @param {Load[]} loads @returns {{load?: Load[]}} the part of a request of a motion in time */
export function atTimes(loads) {
  return loads.length ? { load: loads } : {};
}
