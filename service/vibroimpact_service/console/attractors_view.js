// What the motions of a driven structure settle on: a section of each attractor, and from which
// initial states it is reached.

import { BaseView } from "./base_view.js";
import { Curve } from "./curve.js";
import { button, download, make } from "./dom.js";
import { choiceField, numberField } from "./fields.js";
import { numbersOf } from "./figure.js";
import { help } from "./help.js";
import { loadFields } from "./loads.js";
import { losses } from "./losses.js";
import { amplitude, isWide, lowest, velocity } from "./natural.js";
import { linspace, shown } from "./numbers.js";
import { setFields, show, state } from "./state.js";
import { coordinateName, only, size, systemDocument } from "./structures.js";
import { axisOfWhat, labelled } from "./units.js";

/** Degrees of freedom up to which the states of attractors are asked for whole, so that a time history can begin there. */
const WHOLE = 100;
/** Colours of attractors; further ones begin again. */
const COLOURS = ["curve-1", "soft-curve", "curve-2", "curve-3", "curve-4", "alarm"];
/** Pixels of a point of a periodic attractor, and of others. */
const [LARGE, SMALL] = [8, 2.5];
/** Pixels of the basins, less what stays between their dots. */
const SIDE = 300;

/** @returns {Record<string, any>} */
function fields() {
  const { stops } = state.structure;
  const first = stops[0];
  const dof = first ? first.dof : 0;
  const reach = Math.max(Math.abs((first && first.upper) ?? 0), Math.abs((first && first.lower) ?? 0)) || 1;
  return {
    Omega: Number((1.2 * (lowest() || 1)).toPrecision(3)), load: [{ dof, amplitude: amplitude() }], dof,
    from: first && first.lower !== null ? -first.lower : -reach, to: first && first.upper !== null ? first.upper : reach, v: velocity(1),
    cells: isWide() ? 5 : 9, settle: 100, observe: 200, points: 400, section: "phase", ...state.fields,
  };
}

/** @param {any} row nature and period of an attractor @returns {string} */
function inWords({ nature, period }) {
  if (nature !== "periodic") return nature.replace("-", " ");
  return period === 1 ? "periodic, as the drive" : `periodic, ${period} periods of the drive`;
}

/** @param {[number, number][]} points @param {number[]} belongs the attractor of each @param {number} count of attractors @returns {(number | null)[][]} their columns by attractor, across in order */
function columns(points, belongs, count) {
  const order = points.map((_, i) => i).sort((a, b) => points[a][0] - points[b][0]);
  return [order.map((i) => points[i][0]), ...Array.from({ length: count }, (_, k) => order.map((i) => (belongs[i] === k ? points[i][1] : null)))];
}

/** @param {number[]} values @returns {[number, number]} from the least to the largest, with a margin */
function around(values) {
  const [low, high] = values.reduce(([a, b], each) => [Math.min(a, each), Math.max(b, each)], [Infinity, -Infinity]);
  if (low > high) return [-1, 1];
  const margin = 0.06 * (high - low) || 0.1 * Math.abs(high) || 1;
  return [low - margin, high + margin];
}

export class AttractorsView extends BaseView {
  /** @param {HTMLElement} root */
  constructor(root) {
    super(root, { name: "attractors", title: "Attractors", pause: 400, help: help("attractor") });
    this.offer = make("p", { class: "hint" });
    this.note.after(this.offer);
    this.table = make("div");
    this.basins = make("div", { class: "figure" });
    /** @type {Curve | null} */ this.map = null;
    this.section.append(this.table, this.basins);
  }

  destroy() {
    super.destroy();
    if (this.map) this.map.destroy();
  }

  controls() {
    const now = fields();
    this.note.replaceChildren("Motions begin at a grid of displacements and velocities of one coordinate, all others at rest, and are looked at once they have settled. ", ...losses("The structure has no damping: only its stops can make motions settle."));
    return [
      numberField(labelled("Ω of the drive", "Omega"), now.Omega, this.set("Omega"), { pointer: "/frequency", min: 0, name: "Omega" }),
      numberField("Coordinate", now.dof, this.set("dof"), { whole: true, min: 0, name: "dof" }),
      numberField("displacement from", now.from, this.set("from"), { pointer: "/initial/x", name: "from" }), numberField("to", now.to, this.set("to"), { name: "to" }),
      numberField("velocity ±", now.v, this.set("v"), { min: 0, pointer: "/initial/v", name: "v" }),
      numberField("states a side", now.cells, this.set("cells"), { whole: true, min: 1, max: 61, name: "cells" }),
      numberField("periods left out", now.settle, this.set("settle"), { pointer: "/settle", whole: true, min: 0, name: "settle" }),
      numberField("periods observed", now.observe, this.set("observe"), { pointer: "/observe", whole: true, min: 32, name: "observe" }),
      choiceField("Section", [["phase", "states at the drive's phase 0"], ["impacts", "impacts"]], now.section, this.set("section"), { pointer: "/section", name: "section" }),
      loadFields(now.load, "harmonic", this),
    ];
  }

  /** @returns {[number, number][]} displacements and velocities at which motions begin */
  #starts() {
    const { from, to, v, cells } = fields();
    // Not on the stops themselves, where a motion could start behind them by rounding.
    const inside = 1e-9 * (to - from);
    const [xs, vs] = [linspace(from + inside, to - inside, cells), linspace(-v, v, cells)];
    return vs.flatMap((each) => xs.map((x) => /** @type {[number, number]} */ ([x, each])));
  }

  requests() {
    const { Omega, load, dof, settle, observe, points, section } = fields();
    const n = size(state.structure);
    const starts = this.#starts();
    return [{
      title: "Attractors", kind: "attractors",
      request: {
        system: systemDocument(state.structure), frequency: { values: [Omega] }, load,
        initial: { x: starts.map(([x]) => only(n, dof, x)), v: starts.map(([, v]) => only(n, dof, v)) },
        settle, observe, points, section, ...(n > WHOLE ? { dofs: [Math.min(dof, n - 1)] } : {}),
      },
    }];
  }

  detail() {
    const { Omega, load } = fields();
    return [`Ω = ${shown(Omega, 6)}`, ...load.map((/** @type {import("./loads.js").Load} */ { dof, amplitude: force }) => `force ${shown(force, 4)} on coordinate ${dof}`)].join(", ");
  }

  /** @param {AbortSignal} signal @param {import("./base_view.js").OnJob} onJob */
  async work(signal, onJob) {
    const [request] = this.requests();
    await this.offered(request, {
      place: this.offer, act: "Compute them", text: (time) => `These motions take about ${time}; what is shown then is their answer.`,
      use: (result) => {
        this.accept(result);
        this.draw();
      },
    }, signal, onJob);
    // What waits to be asked for has no answer yet.
    if (this.offer.hasChildNodes()) this.#clear();
  }

  #clear() {
    this.result = null;
    for (const each of [this.figure, this.table, this.basins]) each.replaceChildren();
    this.readout.textContent = "";
  }

  draw() {
    const { result } = this;
    if (!result) return;
    if (this.drawing) this.drawing.destroy();
    const holder = make("div");
    this.figure.replaceChildren(holder);
    const { section, attractor } = result;
    const { dof } = fields();
    const column = Math.max(0, result.dof.indexOf(dof));
    const atPhase = section.x !== undefined;
    /** @type {[number, number][]} */
    const points = section.attractor.map((/** @type {number} */ _, /** @type {number} */ i) => (atPhase ? [section.x[i][column], section.v[i][column]] : [section.phase[i], section.velocity[i]]));
    const words = this.#rows().map(inWords);
    const curve = new Curve(holder, {
      x: atPhase ? axisOfWhat("displacement at phase 0", result.dof[column]) : "phase of the drive (rad)", y: labelled(atPhase ? "velocity at phase 0" : "velocity before the impact", "velocity"), height: 360, zoom: this.zoom,
      label: `Section of ${attractor.nature.length} attractors: ${words.join("; ")}.`,
      series: attractor.nature.map((/** @type {string} */ nature, /** @type {number} */ k) => ({ label: `attractor ${k}`, colour: this.#colour(k), width: 0, points: nature === "periodic" ? LARGE : SMALL })),
    });
    this.drawing = curve;
    curve.extent = around(points.map(([x]) => x));
    curve.range = around(points.map(([, y]) => y));
    curve.show(columns(points, section.attractor, words.length));
    const { attractor: belongs } = result.settled;
    const undecided = [...new Set((result.error.undecided || []).map((/** @type {string} */ each) => each.replace(/^motions? [^:]*: /, "")))];
    // All undecided motions are one row.
    const open = attractor.nature.indexOf("undecided");
    const [found, left] = [words.length - (open < 0 ? 0 : 1), open < 0 ? 0 : attractor.motions[open]];
    this.readout.textContent = `${belongs.length - left} of ${belongs.length} motions settle on ${found} ${found === 1 ? "attractor" : "attractors"}${left ? `; ${left} are undecided: ${undecided[0]}` : ""}.`;
    this.#list(words);
    this.#drawBasins(words);
  }

  /** @param {number} k @returns {string} */
  #colour(k) {
    return COLOURS[k % COLOURS.length];
  }

  /** @returns {any[]} nature and period of each attractor */
  #rows() {
    const { nature, period } = this.result.attractor;
    return nature.map((/** @type {string} */ each, /** @type {number} */ k) => ({ nature: each, period: period[k] }));
  }

  /** @param {string[]} words */
  #list(words) {
    const { attractor, error } = this.result;
    const heads = ["Attractor", "Motions", "Share of all such states", "Impacts per period of the drive", "Lyapunov exponent", "Largest multiplier", "Acts"];
    const rows = words.map((text, k) => {
      const key = make("span", { class: "key dot-key", "aria-hidden": "true" });
      key.style.color = `var(--${this.#colour(k)})`;
      const share = (/** @type {number} */ part) => `${shown(100 * part, 2)}`;
      const worst = error.attractor.exponent[k];
      const values = [attractor.motions[k], `${share(attractor.fraction_low[k])} to ${share(attractor.fraction_high[k])} %`, shown(attractor.impact_rate[k], 4),
        `${shown(attractor.exponent[k], 3)}${worst ? ` ± ${shown(worst, 1)}` : ""}`, shown(attractor.stability[k], 4)];
      const whole = attractor.x[k].length === size(state.structure);
      return make("tr", {}, make("th", { scope: "row" }, key, `${k}: ${text}`), ...values.map((each, i) => make("td", { "data-head": heads[i + 1] }, each)),
        make("td", {}, whole && button("Time history", () => this.#history(attractor.x[k], attractor.v[k]), { class: "quiet", "aria-label": `Time history on attractor ${k}` })));
    });
    this.table.replaceChildren(make("div", { class: "scroll", tabindex: 0, role: "group", "aria-label": "Table of attractors" },
      make("table", {}, make("thead", {}, make("tr", {}, ...heads.map((text) => make("th", { scope: "col" }, text)))), make("tbody", {}, ...rows))));
  }

  /** From which initial states each attractor is reached. @param {string[]} words */
  #drawBasins(words) {
    if (this.map) this.map.destroy();
    const { dof, cells } = fields();
    const starts = this.#starts();
    const { attractor: belongs, status } = this.result.settled;
    const holder = make("div");
    this.map = new Curve(holder, {
      x: axisOfWhat("initial displacement", dof), y: labelled("initial velocity", "velocity"), height: 360,
      label: `Basins: the attractors that ${starts.length} motions settle on, over initial displacement and velocity of ${coordinateName(state.structure, dof)}.`,
      series: words.map((_, k) => ({ label: `attractor ${k}`, colour: this.#colour(k), width: 0, points: Math.min(14, Math.max(3, SIDE / cells - 2)) })),
    });
    const { map } = this;
    const said = make("p", { class: "readout" }, "Each dot is an initial state. Click one to see its time history.");
    this.basins.replaceChildren(make("h3", {}, "Basins"), holder, said, button("Save the basins as CSV", () => download("basins.csv", new Blob([numbersOf(map)], { type: "text/csv" })), { class: "quiet" }));
    map.extent = around(starts.map(([x]) => x));
    map.range = around(starts.map(([, v]) => v));
    /** @param {number} x @param {number} v @returns {number} the start nearest to a place */
    const near = (x, v) => {
      const [across, up] = [map.part("x"), map.part("y")].map(([low, high]) => high - low);
      const far = starts.map(([a, b]) => Math.hypot((a - x) / across, (b - v) / up));
      return far.indexOf(Math.min(...far));
    };
    map.onHover = (_, x, v) => {
      if (Number.isNaN(x)) return;
      const i = near(x, v);
      said.textContent = `x = ${shown(starts[i][0], 4)}, v = ${shown(starts[i][1], 4)}: ${status[i] === "ok" ? `attractor ${belongs[i]}, ${words[belongs[i]]}` : status[i].replaceAll("_", " ")}`;
    };
    map.onPick = (x, v) => {
      const [at, speed] = starts[near(x, v)];
      const n = size(state.structure);
      this.#history(only(n, dof, at), only(n, dof, speed));
    };
    map.show(columns(starts, belongs, words.length));
  }

  others() {
    return [this.map];
  }

  /** @param {number[]} x @param {number[]} v */
  #history(x, v) {
    const { Omega, load, dof } = fields();
    show("history", {
      state: { x, v }, duration: Number(((20 * 2 * Math.PI) / Omega).toPrecision(6)), coordinate: dof,
      load: load.map((/** @type {import("./loads.js").Load} */ { dof: on, amplitude: force, harmonic = 1, phase = 0 }) => ({ dof: on, amplitude: force, frequency: harmonic * Omega, phase })),
    });
  }
}
