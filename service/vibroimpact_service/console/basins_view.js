// Motions from many initial states of one coordinate, as a map of what becomes of them.

import { BaseView } from "./base_view.js";
import { choiceField, numberField } from "./fields.js";
import { Heatmap } from "./heatmap.js";
import { help } from "./help.js";
import { atTimes, loadFields } from "./loads.js";
import { isWide, time, velocity } from "./natural.js";
import { linspace, nearest, shown } from "./numbers.js";
import { setFields, show, state } from "./state.js";
import { only, size, systemDocument } from "./structures.js";
import { axisOfWhat, labelled } from "./units.js";

/** @type {Record<string, {label: string, of: (result: any, i: number, column: number) => number}>} */
const QUANTITIES = {
  impacts: { label: "impacts until the end", of: (result, i) => result.count.impacts[i] },
  x: { label: "displacement at the end", of: (result, i, column) => result.x[i][0][column] },
  v: { label: "velocity at the end", of: (result, i, column) => result.v[i][0][column] },
  horizon: { label: "time until which it can be predicted", of: (result, i) => result.error.predictable_until[i] },
};

/** @returns {Record<string, any>} */
function fields() {
  const first = state.structure.stops[0];
  const gap = first ? Math.abs(first.upper || first.lower || 1) : 1;
  return { dof: first ? first.dof : 0, x: gap, v: velocity(2), cells: isWide() ? 21 : 61, t_end: time(9.5), quantity: "impacts", load: [], ...state.fields };
}

export class BasinsView extends BaseView {
  /** @param {HTMLElement} root */
  constructor(root) {
    super(root, {
      name: "basins", help: help("ensemble"), title: "Ensemble of initial states", hint: "Each cell is a motion that starts there, all other coordinates at rest. Click one to see its time history.",
    });
  }

  controls() {
    const now = fields();
    return [
      numberField("Coordinate", now.dof, this.set("dof"), { whole: true, min: 0, name: "dof" }),
      numberField("displacement ±", now.x, this.set("x"), { min: 0, pointer: "/initial/x", name: "x" }),
      numberField("velocity ±", now.v, this.set("v"), { min: 0, pointer: "/initial/v", name: "v" }),
      numberField("cells a side", now.cells, this.set("cells"), { whole: true, min: 2, max: 301, name: "cells" }),
      numberField("until t", now.t_end, this.set("t_end"), { min: 0, pointer: "/t_end", name: "t_end" }),
      choiceField("Show", Object.entries(QUANTITIES).map(([name, { label }]) => [name, label]), now.quantity, (value) => { setFields({ quantity: value }, { silent: true }); this.draw(); }, { name: "quantity" }),
      loadFields(now.load, "frequency", this),
    ];
  }

  #axes() {
    const { x, v, cells } = fields();
    // Not on the stops themselves, where a motion could start behind them by rounding.
    return { xs: linspace(-x, x, cells).map((each) => each * (1 - 1e-9)), vs: linspace(-v, v, cells) };
  }

  requests() {
    const { dof, t_end, load } = fields();
    const n = size(state.structure);
    const { xs, vs } = this.#axes();
    const pairs = vs.flatMap((v) => xs.map((x) => [x, v]));
    return [{
      title: "Ensemble", kind: "ensemble",
      request: {
        system: systemDocument(state.structure), t_end, t: [t_end], ...atTimes(load),
        initial: { x: pairs.map(([x]) => only(n, dof, x)), v: pairs.map(([, v]) => only(n, dof, v)) },
        dofs: [Math.min(dof, n - 1)], outputs: ["x", "v"],
      },
    }];
  }

  draw() {
    const { result } = this;
    if (!result) return;
    const { quantity, dof } = fields();
    const { label, of } = QUANTITIES[quantity] || QUANTITIES.impacts;
    const { xs, vs } = this.#axes();
    const values = vs.map((_, j) => xs.map((_2, i) => {
      const index = j * xs.length + i;
      return result.status[index] === "ok" ? of(result, index, 0) : null;
    }));
    if (this.drawing) this.drawing.destroy();
    const map = new Heatmap(this.figure, { x: axisOfWhat("initial displacement", dof), y: labelled("initial velocity", "velocity"), value: label, zoom: this.zoom, label: `${label} of ${xs.length * vs.length} motions, over initial displacement and velocity.` });
    this.drawing = map;
    map.show(xs, vs, values);
    map.onHover = (x, y) => {
      if (Number.isNaN(x)) this.readout.textContent = `${xs.length * vs.length} motions.`;
      else {
        const [i, j] = [nearest(xs, x), nearest(vs, y)];
        this.readout.textContent = `x = ${shown(xs[i], 4)}, v = ${shown(vs[j], 4)}: ${values[j][i] === null ? result.status[j * xs.length + i].replaceAll("_", " ") : `${shown(values[j][i], 5)} ${label}`}`;
      }
    };
    map.onHover(NaN, NaN);
    map.onPick = (x, y) => {
      const n = size(state.structure);
      const { t_end, load } = fields();
      show("history", { state: { x: only(n, dof, xs[nearest(xs, x)]), v: only(n, dof, vs[nearest(vs, y)]) }, duration: t_end, load, coordinate: dof });
    };
  }
}
