// A quantity of impact modes over frequency and one number of the structure.

import { BaseView } from "./base_view.js";
import { choiceField, numberField } from "./fields.js";
import { Heatmap } from "./heatmap.js";
import { help } from "./help.js";
import { rangeOfModes } from "./natural.js";
import { nearest, shown } from "./numbers.js";
import { show, state } from "./state.js";
import { FORMS, leftOut, systemDocument } from "./structures.js";
import { labelled } from "./units.js";
import { reasonInWords } from "./words.js";

/** @typedef {import("./structures.js").Structure} Structure */

/** @type {Record<string, string>} */
const QUANTITIES = { momentum: "momentum per impact 2p/ω", energy: "energy", stability: "growth of deviations per half period" };

/**
 * The numbers that can vary: where they stand in the request, and how one is set.
 * @returns {{path: string, label: string, value: number, set: (structure: Structure, value: number) => void}[]}
 */
function choices() {
  const { structure } = state;
  const stops = structure.stops.flatMap((stop, i) => {
    if (stop.upper !== null && stop.upper === stop.lower) {
      return [{ path: `system.constraints.${i}.gap`, label: `gap of stop ${i}`, value: stop.upper, set: (/** @type {Structure} */ to, /** @type {number} */ value) => { Object.assign(to.stops[i], { lower: value, upper: value }); } }];
    }
    return /** @type {("lower" | "upper")[]} */ (["lower", "upper"]).filter((side) => stop[side] !== null).map((side) => ({
      path: `system.constraints.${i}.gap.${side}`, label: `${side} gap of stop ${i}`, value: /** @type {number} */ (stop[side]),
      set: (/** @type {Structure} */ to, /** @type {number} */ value) => { to.stops[i][side] = value; },
    }));
  });
  const entered = systemDocument(structure, false).preset ? FORMS[structure.form].parameters.filter(({ whole }) => !whole) : [];
  const parameters = entered.map(({ name, label }) => ({
    path: `system.${name}`, label, value: structure.parameters[name], set: (/** @type {Structure} */ to, /** @type {number} */ value) => { to.parameters[name] = value; },
  }));
  return [...stops, ...parameters];
}

function fields() {
  const list = choices();
  // One gap alone only scales the motion: another number tells more.
  const telling = list.find(({ path }) => ["system.stiffness", "system.coupling", "system.mu"].includes(path)) || list[0];
  const path = list.some((each) => each.path === state.fields.path) ? state.fields.path : telling ? telling.path : "";
  const choice = list.find((each) => each.path === path);
  const value = choice ? Math.abs(choice.value) || 1 : 1;
  const low = path === "system.mu" ? 1.05 * value : 0.25 * value;
  const [from, to] = rangeOfModes();
  return { low, high: 2 * value, rows: 80, from, to, points: 240, quantity: "momentum", ...state.fields, path, choice };
}

export class MapView extends BaseView {
  /** @param {HTMLElement} root */
  constructor(root) {
    super(root, { name: "map", help: help("map"), title: "Map of impact modes", hint: "Empty where there is no admissible impact mode. Click a point to see it move." });
  }

  controls() {
    const now = fields();
    return [
      choiceField("Vary", choices().map(({ path, label }) => [path, label]), now.path, (path) => this.reshape({ path, low: undefined, high: undefined }), { pointer: "/axes/0/path", name: "path" }),
      numberField("from", now.low, this.set("low"), { pointer: "/axes/0/start", name: "low" }), numberField("to", now.high, this.set("high"), { pointer: "/axes/0/stop", name: "high" }),
      numberField("rows", now.rows, this.set("rows"), { pointer: "/axes/0/num", whole: true, min: 2, max: 400, name: "rows" }),
      numberField(labelled("Ω from", "Omega"), now.from, this.set("from"), { pointer: "/frequency/start", name: "from" }), numberField("to", now.to, this.set("to"), { pointer: "/frequency/stop", name: "to" }),
      numberField("columns", now.points, this.set("points"), { pointer: "/frequency/num", whole: true, min: 2, max: 1000, name: "points" }),
      choiceField("Show", Object.entries(QUANTITIES), now.quantity, this.set("quantity"), { name: "quantity" }),
    ];
  }

  requests() {
    const now = fields();
    if (!now.path) return [];
    const output = now.quantity === "momentum" ? "impulse" : now.quantity;
    return [{
      title: "Sweep", kind: "sweep",
      request: {
        kind: "impact-modes",
        base: { system: systemDocument(state.structure, false), frequency: { start: now.from, stop: now.to, num: now.points }, outputs: [output, "exists", "reason"] },
        axes: [{ path: now.path, name: "varied", start: now.low, stop: now.high, num: now.rows }],
      },
    }];
  }

  /** @param {any} result */
  accept(result) {
    super.accept(result, leftOut(state.structure));
  }

  draw() {
    const { result } = this;
    if (!result) return;
    const { quantity, choice } = fields();
    const Omega = result.frequency.Omega;
    const rows = result.axes.varied;
    /** @param {number} j @param {number} i */
    const value = (j, i) => {
      if (quantity !== "momentum") return result[quantity][j][i];
      return (2 * result.impulse[j][i].reduce((/** @type {number} */ a, /** @type {number} */ b) => Math.max(a, b))) / result.frequency.omega[i];
    };
    const values = rows.map((/** @type {number} */ _, /** @type {number} */ j) => Omega.map((/** @type {number} */ _2, /** @type {number} */ i) => (result.exists[j] && result.exists[j][i] && result.certified[j][i] ? value(j, i) : null)));
    if (this.drawing) this.drawing.destroy();
    const name = choice ? choice.label : "";
    const map = new Heatmap(this.figure, { x: labelled("fundamental frequency Ω", "Omega"), y: name, value: QUANTITIES[quantity], zoom: this.zoom, label: `${QUANTITIES[quantity]} over frequency and ${name}; empty where no impact mode is admissible.` });
    this.drawing = map;
    map.show(Omega, rows, values);
    map.onHover = (x, y) => {
      if (Number.isNaN(x)) {
        const count = values.flat().filter((/** @type {number | null} */ each) => each !== null).length;
        this.readout.textContent = `${count} of ${rows.length * Omega.length} points have an admissible impact mode.`;
        return;
      }
      const [i, j] = [nearest(Omega, x), nearest(rows, y)];
      const text = values[j][i] === null ? reasonInWords(result.reason[j][i]) : `${QUANTITIES[quantity]} = ${shown(values[j][i], 5)}`;
      this.readout.textContent = `Ω = ${shown(Omega[i], 5)}, ${name} = ${shown(rows[j], 4)}: ${text}`;
    };
    map.onHover(NaN, NaN);
    map.onPick = (x, y) => {
      if (choice) choice.set(state.structure, Number(rows[nearest(rows, y)].toPrecision(6)));
      const { from, to } = fields();
      show("modes", { from, to, Omega: Omega[nearest(Omega, x)] });
      dispatchEvent(new Event("structure-filled"));
    };
  }
}
