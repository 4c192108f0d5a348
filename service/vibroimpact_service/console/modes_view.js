// Impact modes over frequency: momentum, existence bands, stability, and the mode at the cursor.

import { compute, latest } from "./api.js";
import { BaseView } from "./base_view.js";
import { Curve } from "./curve.js";
import { button, make, settled } from "./dom.js";
import { choiceField, numberField, showError } from "./fields.js";
import { help } from "./help.js";
import { energyCurve, introduction, legend, shading, stabilityIn } from "./mode_family.js";
import { MotionCard, spread } from "./motion_card.js";
import { natural, rangeOfModes, tooLow } from "./natural.js";
import { linspace, shown, subscript } from "./numbers.js";
import { rangeWithPoles, withoutPoles } from "./ranges.js";
import { ofMode, ratesPart } from "./rates.js";
import { setFields, show, state } from "./state.js";
import { coordinateName, geometryOf, leftOut, neededDofs, size, systemDocument } from "./structures.js";
import { axisOf, frequencyInWords, labelled, withUnit } from "./units.js";
import { reasonInWords, stabilityInWords, stopName, whyPhantom } from "./words.js";

/** Degrees of freedom up to which the growth of deviations is computed while one looks. */
const GROWTH_DOFS = 60;
const COLOURS = ["curve-1", "curve-2", "curve-3", "curve-4"];
const DASHES = [[], [8, 4], [2, 3], [10, 3, 2, 3]];

/** What the address may say of this view. */
function fields() {
  const [from, to] = rangeOfModes();
  const given = state.fields;
  const filled = { from, to, points: 1500, quantity: "momentum", ...given };
  return { ...filled, Omega: given.Omega === undefined ? null : Number(given.Omega) };
}

/** @returns {number[]} indices of the stops that are struck */
function active() {
  const struck = state.structure.stops.map((stop, i) => (stop.active ? i : -1)).filter((i) => i >= 0);
  return struck.length ? struck : state.structure.stops.map((_, i) => i);
}

/** @returns {number[]} natural frequencies, as far as they are known */
function frequencies() {
  const known = natural();
  return known ? [...known.Omega] : [];
}

export class ModesView extends BaseView {
  /** @param {HTMLElement} root */
  constructor(root) {
    super(root, { name: "modes", title: "Impact modes", pause: 150, help: help("mode"), ranged: true });
    /** @type {any} */ this.bands = null;
    /** @type {any} */ this.mode = null;
    /** The range of the last answer. @type {number[] | null} */ this.range = null;
    /** @type {Curve | null} */ this.curve = null;
    /** @type {Curve | null} */ this.energy = null;
    this.slider = make("input", { type: "range", class: "cursor-slider", step: "any", "aria-label": "Frequency Ω of the cursor" });
    this.exact = make("div", { class: "exact" });
    this.verdict = make("div", { class: "verdict", "aria-live": "polite" });
    this.values = make("dl", { class: "values" });
    this.stability = make("dd");
    this.energyFigure = make("div");
    this.figure.after(make("div", { class: "slider-row" }, this.slider));
    this.stabilityNote = make("p", { class: "hint" });
    // What the bands are to say stands below the curve.
    this.legend = make("ul", { class: "legend" });
    this.section.append(this.note, this.stabilityNote, this.legend, introduction());
    const moving = make("section", { class: "card", "aria-label": "The mode at the cursor" });
    root.append(moving);
    this.card = new MotionCard(moving, { title: "The mode at the cursor", axis: "t/T" });
    this.card.onCoordinate = (dof) => setFields({ coordinate: dof }, { silent: true });
    this.rates = ratesPart(() => this.#differentiated());
    root.append(make("div", { class: "pair" },
      make("section", { class: "card", "aria-labelledby": "why-title" }, make("h2", { id: "why-title" }, "At the cursor"), this.verdict, this.values, this.rates.element,
        make("p", { class: "row" }, button("Time history from here", () => this.#history(), { class: "primary" }))),
      make("section", { class: "card", "aria-labelledby": "energy-title" }, make("h2", { id: "energy-title" }, "Frequency and energy"), this.energyFigure)));
    this.slider.addEventListener("input", () => this.#move(Number(this.slider.value)));
    this.ask = latest((/** @type {{Omega: number, moved: number}} */ place) => this.#askMode(place));
    // Of large structures it takes longer than the cursor rests while it is dragged.
    this.askGrowth = settled(250, () => this.#growth());
    this.askRates = settled(250, () => this.rates.update());
  }

  destroy() {
    super.destroy();
    this.card.destroy();
    if (this.energy) this.energy.destroy();
  }

  zoomed() {
    super.zoomed();
    if (!this.curve) return;
    const [min, max] = this.curve.part("x").map(String);
    Object.assign(this.slider, { min, max, value: String(fields().Omega ?? min) });
  }

  controls() {
    const { from, to, points, quantity } = fields();
    this.#exactField();
    return [
      numberField(labelled("Ω from", "Omega"), from, this.set("from"), { pointer: "/frequency/start", min: 0, name: "from" }),
      numberField("to", to, this.set("to"), { pointer: "/frequency/stop", min: 0, name: "to" }),
      numberField("points", points, this.set("points"), { pointer: "/frequency/num", min: 2, max: 20_000, whole: true, name: "points" }),
      this.exact,
      choiceField("Show", [["momentum", "momentum per impact, 2p/ω"], ["impulse", "impulse parameter p"]], quantity, (value) => {
        setFields({ quantity: value }, { silent: true });
        this.draw();
      }),
    ];
  }

  #exactField() {
    const { Omega } = fields();
    this.exact.replaceChildren(numberField("Ω of the cursor", Omega === null ? null : Number(Omega.toPrecision(9)), (value) => {
      if (value !== null) this.#move(value, { typed: true });
    }, { pointer: "/frequency/values", min: 0, empty: "drag", name: "Omega" }));
  }

  requests() {
    const { from, to, points } = fields();
    const system = systemDocument(state.structure, false);
    const which = active().length === state.structure.stops.length ? {} : { active: active() };
    return [
      { title: "Curve", kind: "impact-modes", request: { system, frequency: { start: from, stop: to, num: points }, ...which, outputs: ["impulse", "exists", "reason", "energy"] } },
      { title: "Bands", kind: "existence-bands", request: { system, frequency: { start: from, stop: to }, ...which, outputs: ["bands", "rejected", "stability"] } },
      ...(fields().Omega === null ? [] : [{ title: "Cursor", kind: "impact-modes", request: this.#modeRequest(/** @type {number} */ (fields().Omega)) }]),
    ];
  }

  /** @param {AbortSignal} signal @param {import("./base_view.js").OnJob} onJob */
  async work(signal, onJob) {
    const [curve, bands] = this.requests();
    this.accept(await compute(curve.kind, curve.request, { signal, onJob }), [...leftOut(state.structure), ...tooLow(fields().to)]);
    this.bands = null;
    this.draw();
    const { Omega, from, to } = fields();
    // A cursor that the address names stays, wherever it is; one that the range has left does not.
    const left = this.range !== null && String(this.range) !== String([from, to]) && Omega !== null && (Omega < from || Omega > to);
    this.range = [from, to];
    this.#move(Omega === null || left ? this.#telling() : Omega);
    if (this.dragged) return;
    const use = (/** @type {any} */ result) => {
      this.bands = result;
      if (this.curve) {
        this.curve.bands = shading(this.result, this.bands);
        this.curve.redraw();
      }
      this.#drawEnergy();
    };
    this.stabilityNote.replaceChildren();
    // Of many bands the stability takes far longer than their proof.
    const quick = await this.isQuick(bands, signal);
    const alone = { ...bands, request: { ...bands.request, outputs: ["bands", "rejected"] } };
    await this.offered(quick ? bands : alone, {
      place: this.note, act: "Search them", use,
      text: (time) => `Certified bands take about ${time}; the bands shown are those of the computed frequencies.`,
    }, signal, onJob);
    if (quick) return;
    await this.offered(bands, {
      place: this.stabilityNote, act: "Compute it", use, text: (time) => `The stability of the bands takes about ${time}.`,
    }, signal, onJob);
  }

  /** A frequency that shows an impact mode: in the middle of the widest band. */
  #telling() {
    const { exists, frequency: { Omega } } = this.result;
    let [best, length] = [Math.floor(exists.length / 2), 0];
    for (let i = 0, run = 0; i < exists.length; i += 1) {
      run = exists[i] ? run + 1 : 0;
      if (run > length) [best, length] = [i - Math.floor(run / 2), run];
    }
    return Omega[best];
  }

  draw() {
    const { result: grid } = this;
    if (!grid) return;
    const { quantity } = fields();
    const Omega = grid.frequency.Omega;
    const factor = Omega.map((/** @type {number} */ _, /** @type {number} */ i) => (quantity === "momentum" ? 2 / grid.frequency.omega[i] : 1));
    const names = grid.constraint.map((/** @type {number} */ each) => stopName(state.structure.stops[each] || { dof: each }, each));
    const series = grid.constraint.flatMap((/** @type {number} */ _, /** @type {number} */ c) => [
      { label: `${names[c]}, phantom`, colour: "phantom", width: 1, dash: DASHES[c % 4] },
      { label: names[c], colour: COLOURS[c % 4], width: 2.6, dash: DASHES[c % 4] },
    ]);
    this.legend.replaceChildren(...legend(names));
    if (this.drawing) this.drawing.destroy();
    const holder = make("div");
    this.figure.replaceChildren(holder);
    const count = grid.exists.filter(Boolean).length;
    this.curve = this.drawing = new Curve(holder, {
      x: labelled("fundamental frequency Ω", "Omega"), y: quantity === "momentum" ? labelled("momentum per impact 2p/ω", "momentum") : labelled("impulse parameter p", "force"),
      series, height: 340, strip: 2, zoom: this.zoom,
      label: `${quantity === "momentum" ? "Momentum" : "Impulse parameter"} over frequency: ${count} of ${Omega.length} frequencies have an admissible impact mode, the others are phantoms.`,
    });
    const columns = grid.constraint.map((/** @type {number} */ _, /** @type {number} */ c) => grid.impulse.map((/** @type {any} */ row, /** @type {number} */ i) => row[c] * factor[i]));
    const admissible = columns.flatMap((/** @type {number[]} */ values) => values.filter((_, i) => grid.exists[i]));
    const range = rangeWithPoles(admissible.length > 3 ? admissible : columns.flat());
    // Phantoms whose stops would have to pull are seen too.
    if (columns.flat().some((/** @type {number} */ value) => value < 0)) range[0] = Math.min(range[0], -0.3 * range[1]);
    this.curve.range = range;
    this.curve.extent = [Omega[0], Omega[Omega.length - 1]];
    this.curve.bands = shading(grid, this.bands);
    this.curve.levels = [{ at: 0, colour: "soft", width: 1 }];
    this.curve.lines = frequencies().map((at, i) => ({ at, colour: "natural", dash: [3, 4], label: `Ω${subscript(i + 1)}` }));
    this.curve.onPick = (x) => this.#move(x);
    this.curve.onHover = (index) => this.#hover(index);
    const data = columns.flatMap((/** @type {number[]} */ values) => {
      const open = withoutPoles(values, range);
      return [open.map((v, i) => (grid.exists[i] && grid.exists[i + 1] !== false && grid.exists[i - 1] !== false ? null : v)), open.map((v, i) => (grid.exists[i] ? v : null))];
    });
    this.curve.choose(fields().Omega);
    this.curve.show([Omega, ...data]);
    this.zoomed();
    this.#drawEnergy();
    this.#hover(null);
  }

  #drawEnergy() {
    if (this.energy) this.energy.destroy();
    this.energy = energyCurve(this.energyFigure, this.result, this.bands);
    if (!this.energy) return;
    this.energy.onPick = (x) => this.#move(x);
    this.energy.choose(fields().Omega);
  }

  /** @param {number | null} index */
  #hover(index) {
    const { result: grid } = this;
    if (!grid) return;
    if (index === null) {
      const count = grid.exists.filter(Boolean).length;
      this.readout.textContent = `${count} of ${grid.exists.length} frequencies have an admissible impact mode. Hover to read values, drag to move the structure.`;
      return;
    }
    const { quantity } = fields();
    const [Omega, omega] = [grid.frequency.Omega[index], grid.frequency.omega[index]];
    const values = grid.impulse[index].map((/** @type {number} */ p) => shown(quantity === "momentum" ? (2 * p) / omega : p, 5)).join(", ");
    this.readout.textContent = `Ω = ${shown(Omega, 6)} · ${quantity === "momentum" ? "2p/ω" : "p"} = ${values} · E = ${shown(grid.energy[index], 4)} · ${reasonInWords(grid.reason[index])}`;
  }

  /** @param {number} Omega @param {{typed?: boolean}} [options] */
  #move(Omega, { typed = false } = {}) {
    if (!(Omega > 0)) return;
    const moved = performance.now();
    setFields({ Omega }, { silent: true });
    this.slider.value = String(Omega);
    this.slider.setAttribute("aria-valuetext", `Ω = ${shown(Omega, 5)}`);
    if (this.curve) this.curve.choose(Omega);
    if (this.energy) this.energy.choose(Omega);
    const input = /** @type {HTMLInputElement | null} */ (this.exact.querySelector("input"));
    if (input && !typed) input.value = String(Number(Omega.toPrecision(9)));
    this.ask({ Omega, moved });
  }

  /** @param {number} Omega */
  #modeRequest(Omega) {
    const n = size(state.structure);
    const dofs = neededDofs(state.structure, 400);
    const which = active().length === state.structure.stops.length ? {} : { active: active() };
    return {
      system: systemDocument(state.structure, false), frequency: { values: [Omega] }, ...which, ...(dofs.length < n ? { dofs } : {}),
      tau: linspace(-1, 1, this.#times(Omega, dofs.length)), outputs: ["impulse", "exists", "reason", "waveform", "energy"],
    };
  }

  /** What of the mode at the cursor is differentiated. */
  #differentiated() {
    if (!this.mode) return null;
    const { tau, dofs, outputs, ...request } = this.#modeRequest(this.mode.frequency.Omega[0]);
    const { stops } = state.structure;
    return ofMode(request, stops, this.mode.constraint.map((/** @type {number} */ i) => stopName(stops[i], i)), this.mode.frequency.Omega[0]);
  }

  /** Points of a waveform: ten for each oscillation of the highest mode, as far as that is quick. @param {number} Omega @param {number} count */
  #times(Omega, count) {
    const highest = frequencies().pop() || Omega;
    const wanted = 2 * Math.ceil((5 * highest) / Omega) + 1;
    return Math.max(33, Math.min(385, wanted, 2 * Math.floor(6500 / count) + 1));
  }

  /** @param {{Omega: number, moved: number}} place moved: when the cursor came there */
  async #askMode({ Omega, moved }) {
    try {
      this.mode = await compute("impact-modes", this.#modeRequest(Omega));
    } catch (error) {
      // The structure of another view may be none of impact modes.
      if (!this.gone) this.refused("cursor", error);
      return;
    }
    if (this.gone) return;
    this.answered("cursor");
    this.#showMode();
    performance.measure("cursor", { start: moved });
    this.askGrowth();
    this.askRates();
  }

  #showMode() {
    const { mode } = this;
    // Impact modes are motions between rigid stops.
    const stops = state.structure.stops.map((each) => ({ ...each, stiffness: null }));
    const geometry = geometryOf(state.structure);
    const struck = /** @type {number[]} */ (mode.constraint);
    const rows = spread(mode.waveform[0], mode.dof, geometry.n);
    geometry.drawn = geometry.drawn.filter((dof) => mode.dof.includes(dof));
    const last = rows.length - 1;
    const first = stops[struck[0]];
    const place = this.#passed(rows);
    const { coordinate = Infinity } = state.fields;
    const upper = mode.impulse[0];
    const lower = mode.impulse_lower ? mode.impulse_lower[0] : upper;
    this.card.show({
      name: (dof) => coordinateName(state.structure, dof), axis: axisOf,
      geometry, stops, rows,
      row: (s) => (s < 0.5 ? 2 * s : 2 - 2 * s) * last,
      marks: (s) => {
        /** @type {import("./shape.js").Mark[]} */
        const marks = [];
        struck.forEach((stop, i) => {
          if (upper[i] <= 0) marks.push({ stop, side: 1, alarm: true });
          else if (Math.abs(s - 0.5) < 0.035) marks.push({ stop, side: 1 });
          if (lower[i] < 0 || (lower[i] === 0 && upper[i] < 0)) marks.push({ stop, side: -1, alarm: true });
          else if (lower[i] > 0 && Math.min(s, 1 - s) < 0.035) marks.push({ stop, side: -1 });
        });
        if (place) marks.push({ stop: place.stop, side: place.side, alarm: true });
        return marks;
      },
      coordinate: coordinate < geometry.n ? coordinate : place ? stops[place.stop].dof : first ? first.dof : 0,
      points: place ? [{ x: place.time, y: place.absolute, colour: "alarm" }] : [],
      keep: this.card.motion !== null && !this.card.player.playing,
    });
    this.#say(place);
  }

  /**
   * Where a stop is passed by most.
   * @param {ArrayLike<number>[]} rows
   */
  #passed(rows) {
    if (this.mode.reason[0] !== "penetration") return null;
    let worst = null;
    for (const [index, stop] of state.structure.stops.entries()) {
      for (const [gap, side] of /** @type {[number | null, number][]} */ ([[stop.upper, 1], [stop.lower, -1]])) {
        if (gap === null) continue;
        for (const [at, row] of rows.entries()) {
          const y = row[stop.dof] - (stop.relativeTo === null ? 0 : row[stop.relativeTo]);
          const excess = side * y - gap;
          if (worst && excess <= worst.excess) continue;
          const name = `${side > 0 ? "the upper" : "the lower"} wall of ${stopName(stop, index)}`;
          worst = { stop: index, side, excess, name, value: y, limit: side * gap, time: at / (rows.length - 1) / 2, absolute: row[stop.dof] };
        }
      }
    }
    return worst;
  }

  /** @param {any} place where a stop is passed, or null */
  #say(place) {
    const { mode } = this;
    const reason = mode.reason[0];
    const names = state.structure.stops.map(stopName);
    const certified = !mode.certified || mode.certified[0];
    const text = whyPhantom(reason, { impulses: mode.impulse[0], active: mode.constraint, names }, place, certified);
    const acts = place ? [button("Show the place", () => {
      this.card.choose(state.structure.stops[place.stop].dof);
      setFields({ coordinate: undefined }, { silent: true });
      this.card.seek(place.time);
    })] : reason === "negative_impulse" || reason === "wrong_velocity" ? [button("Show the place", () => this.card.seek(0.5))] : [];
    this.verdict.replaceChildren(
      make("p", {}, make("strong", { class: reason === "ok" ? "good" : "phantom" }, reason === "ok" ? "Admissible" : "Phantom"), ` ${certified ? "(certified)" : "(estimated)"}`),
      make("p", {}, text), ...acts);
    const omega = mode.frequency.omega[0];
    const rows = [
      ["Ω", frequencyInWords(mode.frequency.Omega[0], shown(mode.frequency.Omega[0], 8))], ["period T = 4/ω", withUnit(shown(4 / omega, 6), "time")],
      ["impulse parameter p", withUnit(mode.impulse[0].map((/** @type {number} */ p) => shown(p, 6)).join(", "), "force")],
      ["momentum per impact 2p/ω", withUnit(mode.impulse[0].map((/** @type {number} */ p) => shown((2 * p) / omega, 6)).join(", "), "momentum")],
      ["energy", withUnit(shown(mode.energy[0], 6), "energy")],
    ];
    this.stability.textContent = reason === "ok" ? stabilityIn(this.bands, mode.frequency.Omega[0]) : "–";
    this.values.replaceChildren(...rows.flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, value)]), make("dt", {}, "stability"), this.stability);
  }

  /** Ask how fast deviations from the mode at the cursor grow. */
  async #growth() {
    const { mode } = this;
    if (!mode || mode.reason[0] !== "ok" || size(state.structure) > GROWTH_DOFS) return;
    const { tau, dofs, ...request } = this.#modeRequest(mode.frequency.Omega[0]);
    try {
      const answer = await compute("impact-modes", { ...request, outputs: ["stability"] });
      if (mode === this.mode) this.stability.textContent = stabilityInWords(answer.stability[0], answer.error.stability[0], answer.neutral[0]);
    } catch (error) {
      if (!this.gone) showError(error);
    }
  }

  #history() {
    const { Omega } = fields();
    if (Omega !== null) show("history", { mode: Omega, periods: 12 });
  }
}
