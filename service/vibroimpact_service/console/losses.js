// What a driven structure without losses is told, with a button that gives it some.

import { button } from "./dom.js";
import { clearFaults } from "./fields.js";
import { setStructure, state } from "./state.js";
import { FORMS } from "./structures.js";

/** @param {string} without what it means that there is no damping @returns {(HTMLElement | string)[]} nothing where there is damping */
export function losses(without) {
  const { damping, matrices, form } = state.structure;
  if (damping || (matrices && matrices.C)) return [];
  return [`${without} `, ...(FORMS[form].damped ? [
    button("Give it 2 % damping and restitution 0.8", () => {
      state.structure.damping = 0.02;
      state.structure.stops.forEach((stop) => { stop.restitution = Math.min(stop.restitution, 0.8); });
      clearFaults();
      setStructure({ ...state.structure });
      dispatchEvent(new Event("structure-filled"));
    }, { class: "quiet" })] : [])];
}
