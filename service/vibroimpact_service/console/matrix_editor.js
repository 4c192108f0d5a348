// A small editor of mass, stiffness and damping matrices, entry by entry; symmetric entries go together.

import { make } from "./dom.js";
import { numberField, switchField } from "./fields.js";
import { LARGEST } from "./structures.js";

/** @typedef {"M" | "K" | "C"} Name */

/**
 * @param {import("./structures.js").Structure} structure whose matrices are lists of rows
 * @param {() => void} changed
 * @returns {HTMLElement}
 */
export function matrixEditor(structure, changed) {
  const box = make("div", { class: "matrices" });
  const matrices = /** @type {{M: number[][], K: number[][], C?: number[][]}} */ (structure.matrices);

  /** @returns {Name[]} */
  function names() {
    return matrices.C ? ["M", "K", "C"] : ["M", "K"];
  }

  /** @param {number} n */
  function resize(n) {
    for (const name of names()) {
      const old = /** @type {number[][]} */ (matrices[name]);
      // New masses are coupled to their neighbours as the others are.
      matrices[name] = Array.from({ length: n }, (_, i) => Array.from({ length: n }, (_2, j) => {
        if (i < old.length && j < old.length) return old[i][j];
        if (name === "C") return 0;
        if (name === "M") return i === j ? 1 : 0;
        return i === j ? 2 : Math.abs(i - j) === 1 ? -1 : 0;
      }));
    }
    rebuild();
    changed();
  }

  function rebuild() {
    const n = matrices.K.length;
    box.replaceChildren(
      numberField("Degrees of freedom", n, (value) => resize(/** @type {number} */ (value)), { whole: true, min: 1, max: LARGEST }),
      table("M", "Mass"), table("K", "Stiffness"),
      switchField("Damping matrix C", matrices.C !== undefined, (on) => {
        if (on) matrices.C = matrices.K.map((row) => row.map(() => 0));
        else delete matrices.C;
        rebuild();
        changed();
      }, { name: "damping-matrix" }),
      ...(matrices.C ? [table("C", "Damping")] : []),
    );
  }

  /** @param {Name} name @param {string} title */
  function table(name, title) {
    const rows = /** @type {number[][]} */ (matrices[name]);
    const body = rows.map((row, i) => make("tr", {}, ...row.map((value, j) => {
      const input = make("input", { type: "number", step: "any", "aria-label": `${name} ${i}, ${j}`, value, required: true });
      input.addEventListener("input", () => {
        dispatchEvent(new Event("input-checked"));
        if (input.value === "" || !input.checkValidity()) return;
        rows[i][j] = Number(input.value);
        rows[j][i] = Number(input.value);
        const mirror = box.querySelector(`[aria-label="${name} ${j}, ${i}"]`);
        if (mirror instanceof HTMLInputElement && mirror !== input) mirror.value = input.value;
        changed();
      });
      return make("td", {}, input);
    })));
    return make("div", { "data-pointer": `/system/${name}`, class: "scroll", tabindex: 0, role: "group", "aria-label": `${title} matrix` },
      make("table", { class: "matrix" }, make("caption", {}, `${title} ${name}`), make("tbody", {}, ...body)), make("span", { class: "fault", id: `fault-${name}` }));
  }

  rebuild();
  return box;
}
