// The response of a driven, damped structure: amplitudes over the drive's frequency with branches
// and special points, and the motion at the cursor.

import { compute, latest } from "./api.js";
import { BaseView } from "./base_view.js";
import { between, branchesOf, lines, motionsOf, placesOf, specialPoints, stateOf, unwrapped } from "./branch_curves.js";
import { Curve } from "./curve.js";
import { button, make } from "./dom.js";
import { choiceField, numberField } from "./fields.js";
import { help } from "./help.js";
import { loadFields } from "./loads.js";
import { losses } from "./losses.js";
import { MotionCard, spread } from "./motion_card.js";
import { amplitude, natural, rangeOfDrive } from "./natural.js";
import { linspace, shown } from "./numbers.js";
import { setFields, show, state } from "./state.js";
import { coordinateName, geometryOf, neededDofs, size, systemDocument, yields } from "./structures.js";
import { axisOf, axisOfWhat, frequencyInWords, labelled, withUnit } from "./units.js";
import { reasonInWords, stopName } from "./words.js";

/** @typedef {import("./branch_curves.js").Motion} Motion */

const TAU = linspace(0, 1, 201);
/** Part of the period by which the velocity at its start is taken. */
const STEP = 1e-4;
const OUTPUTS = ["exists", "extremes", "energy", "stability"];
/** Longest step along a branch: fine enough to be drawn. */
const LONGEST = 0.05;
/** Planned seconds from which the page advises what would take less. */
const LONG_WAIT = 60;
/** Special points that the page lists; the others are only marked. */
const LISTED = 24;
/** Frequencies at most whose motions are marked by points where branches are drawn. */
const MARKED = 60;
/** Pixels by which a phantom is taken to lie farther from a click. */
const AVERSION = 12;

/** @type {Record<string, string>} */
const KINDS = { fold: "fold", flip: "flip (period doubling)", torus: "torus (two frequencies)", symmetry: "loss of symmetry", grazing: "grazing", end: "a limit is passed" };

/** @type {Record<string, string>} */
const IN_WORDS = {
  stable: "Stable: nearby motions settle on it.",
  neutral: "Neutral: its largest multiplier is 1 within its error, so that nearby motions neither settle on it nor leave it, as far as can be told.",
  unstable: "Unstable: nearby motions leave it.",
};

/** @returns {Record<string, any>} */
function fields() {
  const { structure } = state;
  const n = size(structure);
  const [from, to] = rangeOfDrive();
  const first = structure.stops[0];
  const dof = first ? first.dof : 0;
  const entered = structure.form !== "stored" && structure.form !== "matrices";
  const symmetric = first && first.lower === first.upper && !structure.loads.length;
  return {
    // Contacts that last are searched for at each frequency.
    from, to, points: yields(structure) ? 120 : 600, load: [{ dof: structure.form === "beam" ? n - 2 : entered ? 0 : dof, amplitude: amplitude() }], sequence: symmetric ? "symmetric" : "upper",
    stop: 0, periods: 1, switch: 1, coordinate: dof, Omega: null, ...state.fields,
  };
}

/** @param {string} text such as "0+ 0- 1+": stops and their sides in order */
function impactsOf(text) {
  return text.trim().split(/[\s,]+/).filter(Boolean).map((word) => ({ constraint: Number.parseInt(word, 10) || 0, side: word.endsWith("-") ? "lower" : "upper" }));
}

/** @returns {string} what a motion has where it meets a stop */
const met = () => (yields(state.structure) ? "contacts" : "impacts");

export class DrivenView extends BaseView {
  /** @param {HTMLElement} root */
  constructor(root) {
    super(root, { name: "driven", title: "Driven response", pause: 150, help: help("branch"), ranged: true });
    /** @type {any} */ this.branches = null;
    /** @type {Motion[]} */ this.motions = [];
    /** @type {Curve | null} */ this.curve = null;
    /** Admissible motions that meet a stop. */ this.met = 0;
    /** @type {any} */ this.motion = null;
    this.slider = make("input", { type: "range", class: "cursor-slider", step: "any", "aria-label": "Frequency Ω of the drive at the cursor" });
    this.branchNote = make("p", { class: "hint" });
    this.special = make("div");
    this.verdict = make("div", { class: "verdict", "aria-live": "polite" });
    this.values = make("dl", { class: "values" });
    this.figure.after(make("div", { class: "slider-row" }, this.slider));
    this.section.append(this.branchNote, legend(), this.special);
    const moving = make("section", { class: "card", "aria-label": "The motion at the cursor" });
    root.append(moving);
    this.card = new MotionCard(moving, { title: "The motion at the cursor", axis: "t/T, from the drive's phase 0" });
    this.card.onCoordinate = (dof) => { setFields({ coordinate: dof }, { silent: true }); this.draw(); };
    root.append(make("section", { class: "card", "aria-labelledby": "solution-title" }, make("h2", { id: "solution-title" }, "At the cursor"), this.verdict, this.values,
      make("p", { class: "row" }, button("Time history from here", () => this.#history(), { class: "primary" }),
        button("What motions settle on here", () => this.#attractors()))));
    this.slider.addEventListener("input", () => this.#move(Number(this.slider.value), state.fields.height));
    this.ask = latest((/** @type {Motion} */ motion) => this.#askMotion(motion));
  }

  destroy() {
    super.destroy();
    this.card.destroy();
  }

  zoomed() {
    super.zoomed();
    if (!this.curve) return;
    const [min, max] = this.curve.part("x").map(String);
    Object.assign(this.slider, { min, max, value: String(fields().Omega ?? min) });
  }

  controls() {
    const now = fields();
    const stops = state.structure.stops.map((stop, i) => /** @type {[string, string]} */ ([String(i), stopName(stop, i)]));
    this.note.replaceChildren(...losses("The structure has no damping: resonances have no bound."));
    return [
      numberField(labelled("Ω from", "Omega"), now.from, this.set("from"), { pointer: "/frequency/start", min: 0, name: "from" }),
      numberField("to", now.to, this.set("to"), { pointer: "/frequency/stop", min: 0, name: "to" }),
      numberField("points", now.points, this.set("points"), { pointer: "/frequency/num", min: 2, max: 20_000, whole: true, name: "points" }),
      numberField("Periods of the drive", now.periods, this.set("periods"), { pointer: "/periods", min: 1, whole: true, name: "periods" }),
      choiceField("Impacts per period", [["upper", "one, upper side"], ["lower", "one, lower side"], ["symmetric", "both sides, symmetric"], ["list", "a sequence …"]],
        now.sequence, (value) => this.reshape({ sequence: value }), { pointer: "/sequence", name: "sequence" }),
      ...(now.sequence === "list" ? [this.#sequenceField(now.list || "0+ 0-")] : stops.length > 1 ? [choiceField("of", stops, String(now.stop), (value) => this.change({ stop: Number(value) }), { name: "stop" })] : []),
      numberField("branches that begin on others", now.switch, this.set("switch"), { pointer: "/switch", min: 0, max: 100, whole: true, name: "switch" }),
      loadFields(now.load, "harmonic", this),
    ];
  }

  detail() {
    const { load, periods } = fields();
    const forces = load.map((/** @type {import("./loads.js").Load} */ { dof, amplitude: size, harmonic = 1 }) => `force ${shown(size, 4)} on coordinate ${dof}${harmonic === 1 ? "" : `, ${harmonic} times Ω`}`);
    return [...forces, ...(periods > 1 ? [`${periods} periods of the drive`] : [])].join(", ");
  }

  /** @param {string} value */
  #sequenceField(value) {
    const input = make("input", { id: "sequence-list", value, "data-pointer": "/sequence" });
    input.addEventListener("input", () => this.change({ list: input.value }));
    return make("div", { class: "field" }, make("label", { for: "sequence-list" }, "Stops and sides, as 0+ 0−"), input, make("span", { class: "fault", id: "fault-sequence" }));
  }

  /** @param {any} frequency @param {any} more */
  #request(frequency, more) {
    const now = fields();
    const stop = Math.min(now.stop, Math.max(0, state.structure.stops.length - 1));
    const sequence = now.sequence === "symmetric" ? { sequence: "symmetric", constraint: stop }
      : { sequence: now.sequence === "list" ? impactsOf(now.list || "0+ 0-") : [{ constraint: stop, side: now.sequence }] };
    return { system: systemDocument(state.structure), load: now.load, frequency, periods: now.periods, ...sequence, ...more };
  }

  requests() {
    const { from, to, points, switch: begun } = fields();
    return [
      { title: "Response", kind: "periodic-motions", request: this.#request({ start: from, stop: to, num: points }, { outputs: OUTPUTS }) },
      // The page follows branches with rigid stops alone.
      ...yields(state.structure) ? [] : [{
        title: "Branches", kind: "branches",
        request: { base: this.#request({ values: [from] }, { outputs: OUTPUTS }), path: "frequency.values.0", start: from, stop: to, switch: begun, step: LONGEST },
      }],
    ];
  }

  /** @param {AbortSignal} signal @param {import("./base_view.js").OnJob} onJob */
  async work(signal, onJob) {
    const [response, branches] = this.requests();
    this.accept(await compute(response.kind, response.request, { signal, onJob }));
    this.branches = null;
    this.draw();
    const wanted = { Omega: fields().Omega, height: state.fields.height };
    if (wanted.Omega !== null) this.#move(wanted.Omega, wanted.height);
    else this.#first();
    if (this.dragged) return;
    this.branchNote.replaceChildren();
    if (!branches) return;
    const { Omega, height } = state.fields;
    await this.offered(branches, {
      place: this.branchNote, act: "Follow them",
      text: (time, seconds) => `To follow the branches and locate their special points takes about ${time}.${seconds > LONG_WAIT ? " Fewer branches that begin on others, a narrower range, or a structure reduced to its lowest modes (vi.reduce in Python) take less." : ""}`,
      queued: true,
      use: (result) => {
        this.branches = result;
        this.draw();
        // The address may name a motion that only a branch has, unless one has gone on meanwhile.
        if (wanted.Omega !== null && state.fields.Omega === Omega && state.fields.height === height) this.#move(wanted.Omega, wanted.height);
      },
    }, signal, onJob);
  }

  /** Begin at an admissible motion with impacts, a stable one if there is one. */
  #first() {
    const there = this.motions.filter(({ exists }) => exists);
    const struck = there.filter(({ impacts }) => impacts > 0);
    const stable = struck.filter((each) => stateOf(each) === "stable");
    const list = stable.length ? stable : struck.length ? struck : there;
    if (!list.length) return;
    const { Omega, height } = list.reduce((a, b) => (b.height > a.height ? b : a));
    this.#move(Omega, height);
  }

  draw() {
    const { result, branches } = this;
    if (!result) return;
    const { coordinate, periods } = fields();
    const single = motionsOf(result, coordinate, periods);
    const followed = branches ? motionsOf(branches, coordinate, periods) : [];
    // Each frequency has the motion without impacts: a finer line than the branch of it.
    const linear = single.filter(({ impacts }) => impacts === 0);
    const struck = branches ? branchesOf(branches, followed) : [];
    const points = branches ? specialPoints(branches, struck) : [];
    const touches = struck.flatMap((each, i) => (each[0].impacts ? [] : between(points[i], linear)));
    const special = points.flatMap((each, i) => (struck[i][0].impacts ? each : between(each, linear)));
    this.motions = [...single, ...followed.filter(({ impacts }) => impacts > 0)];
    const there = this.motions.filter(({ exists }) => exists).map(({ height }) => height);
    const top = 1.15 * Math.max(...(there.length ? there : this.motions.length ? this.motions.map(({ height }) => height) : [1])) || 1;
    if (this.drawing) this.drawing.destroy();
    const holder = make("div");
    this.figure.replaceChildren(holder);
    const count = this.met = single.filter(({ exists, impacts }) => exists && impacts > 0).length;
    const known = special.filter(({ exists }) => exists);
    this.curve = this.drawing = new Curve(holder, {
      x: labelled("frequency Ω of the drive", "Omega"), y: axisOfWhat("amplitude", coordinate), height: 340, zoom: this.zoom,
      label: `Amplitude over the drive's frequency: ${count} admissible motions with ${met()}, ${linear.filter(({ exists }) => exists).length} without${branches ? `; ${known.length} special points of ${struck.length} branches` : ""}.`,
      series: [
        { label: "phantom", colour: "phantom", width: 0, points: 2 },
        { label: "stable", colour: "stable", width: 0, points: branches ? 3 : 5 }, { label: "neutral", colour: "neutral", width: 0, points: branches ? 3 : 5, open: true },
        { label: "unstable", colour: "unstable", width: 0, points: branches ? 3 : 5, open: true },
      ],
    });
    const { curve } = this;
    curve.lines = (natural()?.Omega || []).map((at) => ({ at, colour: "natural", dash: [3, 4] }));
    curve.levels = state.structure.stops.filter((stop) => stop.dof === coordinate && stop.relativeTo === null && stop.lower === stop.upper && stop.upper !== null).map((stop) => ({ at: /** @type {number} */ (stop.upper), colour: "stop", width: 1, dash: [6, 3] }));
    const Omega = result.frequency.Omega;
    curve.extent = [Omega[0], Omega[Omega.length - 1]];
    curve.range = [0, top];
    curve.paths = [
      ...lines(linear, touches).map((path) => ({ ...path, colour: path.colour === "phantom" ? "phantom" : "ink", width: Math.min(path.width, 1.6) })),
      ...struck.flatMap((each, i) => (each[0].impacts ? lines(each, points[i]) : [])),
    ];
    curve.marks = special.filter(({ exists, height }) => exists && height <= top).map(({ Omega: x, height: y, kind }) => ({ x, y, kind, colour: "ink" }));
    curve.onPick = (x, y) => this.#move(x, y);
    curve.onHover = (index, x, y) => this.#hover(index === null ? null : this.#nearest(x, y));
    // Beside branches they would hide whether the lines are dashed.
    const every = branches ? Math.ceil(Omega.length / MARKED) : 1;
    const marked = new Set();
    for (let index = 0; index < Omega.length; index += every) marked.add(Omega[index]);
    const shownHere = single.filter((each) => each.impacts > 0 && each.height < 4 * top && marked.has(each.Omega));
    curve.show([shownHere.map((each) => each.Omega), ...["phantom", "stable", "neutral", "unstable"].map((each) => shownHere.map((motion) => (stateOf(motion) === each ? motion.height : null)))]);
    this.zoomed();
    if (fields().Omega !== null) curve.choose(fields().Omega, state.fields.height);
    this.#list(known);
    this.#hover(null);
  }

  /** @param {import("./branch_curves.js").Special[]} points of admissible motions */
  #list(points) {
    const listed = points.slice(0, LISTED);
    this.special.replaceChildren(...(listed.length ? [
      make("h3", {}, "Special points"),
      make("ul", { class: "special" }, ...listed.map(({ kind, Omega, height }) => make("li", {}, button(`${KINDS[kind] || kind} Ω = ${shown(Omega, 6)}`, () => this.#move(Omega, height), { class: "quiet" })))),
      ...(points.length > LISTED ? [make("p", { class: "hint" }, `${points.length - LISTED} more are marked in the curve.`)] : [])] : []));
  }

  /** @param {number} Omega @param {number} [height] @returns {Motion | null} the motion drawn nearest to a point; the highest one where it has no height */
  #nearest(Omega, height) {
    const { from, to } = fields();
    const [across, up] = [6000 / (to - from || 1), 340 / (this.curve && this.curve.range ? this.curve.range[1] : 1)];
    let best = null;
    let least = Infinity;
    for (const motion of this.motions) {
      const above = height === undefined ? -motion.height : Math.abs(motion.height - height);
      // One who moves along the frequency shall get there, however steep the branch is.
      const distance = Math.hypot(across * (motion.Omega - Omega), height === undefined ? 0 : up * above) + (motion.exists ? 0 : AVERSION) + (height === undefined ? 1e-3 * up * above : 0);
      if (distance < least) [best, least] = [motion, distance];
    }
    return best;
  }

  /** @param {Motion | null} motion */
  #hover(motion) {
    if (motion === null) {
      const followed = this.branches ? new Set(this.branches.solution.branch).size : 0;
      this.readout.textContent = `${this.result.solution.Omega.length} solutions, ${this.met || "none"} of them admissible with ${met()}${followed ? `; ${followed} branch${followed > 1 ? "es" : ""}` : ""}. Click one to see it move.`;
      return;
    }
    const { Omega, height, impacts, exists, stability, reason } = motion;
    this.readout.textContent = `Ω = ${shown(Omega, 6)} · amplitude ${shown(height, 5)} · ${impacts} ${met()} · ${exists ? `largest multiplier ${shown(stability, 4)}` : reasonInWords(reason)}`;
  }

  /** @param {number} Omega @param {number} [height] */
  #move(Omega, height) {
    const motion = this.#nearest(Omega, height);
    if (!motion) return;
    setFields({ Omega: motion.Omega, height: motion.height }, { silent: true });
    this.slider.value = String(motion.Omega);
    this.slider.setAttribute("aria-valuetext", `Ω = ${shown(motion.Omega, 5)}, amplitude ${shown(motion.height, 4)}`);
    if (this.curve) this.curve.choose(motion.Omega, motion.height);
    this.ask(motion);
  }

  /** @param {Motion} motion */
  async #askMotion(motion) {
    const n = size(state.structure);
    // The state at phase 0, from which a time history can begin, has all of a small structure.
    const some = n > 200 ? { dofs: neededDofs(state.structure, 200) } : {};
    // Several impacts are looked for from those of the branch: they cannot be missed.
    const begun = motion.phases ? { sequence: motion.sequence, start: { phases: unwrapped(motion.phases, motion.periods) } } : {};
    const more = { tau: [...TAU, STEP, 1 - STEP], periods: motion.periods, ...some, ...begun, outputs: ["exists", "extremes", "energy", "multipliers", "waveform"] };
    const { constraint, ...request } = this.#request({ values: [motion.Omega] }, more);
    try {
      this.#showMotion(await compute("periodic-motions", { ...request, ...(begun.sequence || constraint === undefined ? {} : { constraint }) }), motion);
      this.answered("cursor");
    } catch (error) {
      this.refused("cursor", error);
    }
  }

  /** @param {any} answer @param {Motion} motion which is one of its solutions */
  #showMotion(answer, motion) {
    const { solution } = answer;
    const { coordinate } = fields();
    const { periods } = motion;
    /** @param {Motion} each */
    const far = (each) => Math.abs(each.height - motion.height) + (each.impacts === motion.impacts ? 0 : 1e6);
    const best = motionsOf(answer, coordinate, periods).reduce((chosen, each, i, all) => (far(each) < far(all[chosen]) ? i : chosen), 0);
    const geometry = geometryOf(state.structure);
    geometry.drawn = geometry.drawn.filter((each) => answer.dof.includes(each));
    const all = spread(answer.waveform[best], answer.dof, geometry.n);
    const rows = all.slice(0, TAU.length);
    const T = (2 * Math.PI * periods) / solution.Omega[best];
    const x = Array.from(all[0]);
    this.motion = { x, v: x.map((_, i) => (all[TAU.length][i] - all[TAU.length + 1][i]) / (2 * STEP * T)), Omega: solution.Omega[best], T };
    const impact = yields(state.structure) ? answer.contact : answer.impact;
    const struck = impact.solution.map((/** @type {number} */ _, /** @type {number} */ i) => i).filter((/** @type {number} */ i) => impact.solution[i] === best)
      .map((/** @type {number} */ i) => ({ phase: impact.phase[i], stop: impact.constraint[i], side: impact.side[i], momentum: impact.momentum ? impact.momentum[i] : impact.impulse[i], duration: impact.duration ? impact.duration[i] : 0, force: impact.peak_force ? impact.peak_force[i] : null, depth: impact.indentation ? impact.indentation[i] : null }));
    const places = placesOf(struck, periods, ({ stop, side }, place) => {
      const { dof, relativeTo, lower, upper } = state.structure.stops[stop];
      const row = rows[Math.round(place * (TAU.length - 1))];
      return Math.abs(row[dof] - (relativeTo === null ? 0 : row[relativeTo]) - (side > 0 ? Number(upper) : -Number(lower)));
    });
    const impacts = struck.map((/** @type {any} */ each, /** @type {number} */ i) => ({ ...each, place: places[i] }));
    const good = solution.exists[best];
    const failed = good || solution.witness[best] === null ? null : ((solution.witness[best] % 1) + 1) % 1;
    this.card.show({
      name: (dof) => coordinateName(state.structure, dof), axis: axisOf,
      geometry, stops: state.structure.stops, rows, row: (s) => s * (TAU.length - 1), coordinate,
      // A contact is seen while it lasts.
      marks: (s) => impacts.filter((/** @type {any} */ { place, duration }) => ((s - place + 1) % 1) * T < duration || Math.min(Math.abs(s - place), 1 - Math.abs(s - place)) < (duration ? 0 : 0.025)),
      points: failed === null || coordinate >= geometry.n ? [] : [{ x: failed, y: rows[Math.round(failed * (TAU.length - 1))][coordinate], colour: "alarm" }],
      keep: this.card.motion !== null && !this.card.player.playing,
    });
    this.verdict.replaceChildren(
      make("p", {}, make("strong", { class: good ? "good" : "phantom" }, good ? "Admissible" : "Phantom"), ` ${solution.certified[best] ? "(certified)" : "(estimated)"}`),
      make("p", {}, good ? IN_WORDS[stateOf({ exists: true, stability: solution.stability[best], neutral: solution.neutral[best] })] : `${reasonInWords(solution.reason[best])}${failed === null ? "" : `, at t/T = ${shown(failed, 3)}`}.`),
      ...(failed === null ? [] : [button("Show the place", () => this.card.seek(failed))]));
    const entries = [
      ["Ω of the drive", frequencyInWords(solution.Omega[best], shown(solution.Omega[best], 8))], ["period T", `${withUnit(shown(T, 6), "time")}${periods > 1 ? `, ${periods} of the drive` : ""}`], [`${met()} per period`, impacts.length],
      ["momentum of each", withUnit(impacts.map((/** @type {any} */ each) => shown(each.momentum, 5)).join(", ") || "–", "momentum")],
      ...(yields(state.structure) && impacts.length ? [
        ["contact time of each", withUnit(impacts.map((/** @type {any} */ each) => shown(each.duration, 5)).join(", "), "time")],
        ["largest force of each", withUnit(impacts.map((/** @type {any} */ each) => shown(each.force, 5)).join(", "), "force")],
        ["deepest indentation of each", withUnit(impacts.map((/** @type {any} */ each) => shown(each.depth, 5)).join(", "), "length")]] : []),
      ["largest multiplier", shown(solution.stability[best], 6)], ["near", solution.bifurcation[best]],
      ["work of the load per period", withUnit(shown(solution.work[best], 6), "energy")], ["energy lost per period", withUnit(shown(solution.energy_lost[best], 6), "energy")],
    ];
    this.values.replaceChildren(...entries.flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, value)]));
  }

  #attractors() {
    const { Omega, load } = fields();
    if (Omega !== null) show("attractors", { Omega, load });
  }

  #history() {
    if (!this.motion) return;
    const { x, v, T, Omega } = this.motion;
    show("history", {
      state: { x, v }, duration: 20 * T,
      load: fields().load.map((/** @type {import("./loads.js").Load} */ { dof, amplitude, harmonic = 1, phase = 0 }) => ({ dof, amplitude, frequency: harmonic * Omega, phase })),
    });
  }
}

function legend() {
  /** @param {string} kind @param {string} text */
  const item = (kind, text) => make("li", {}, make("span", { class: `key ${kind}`, "aria-hidden": "true" }), text);
  /** @param {string} sign @param {string} text */
  const mark = (sign, text) => make("li", {}, make("span", { class: "sign", "aria-hidden": "true" }, sign), text);
  return make("ul", { class: "legend" },
    item("line-stable", "stable, with impacts or contacts"), item("line-neutral", "neutral"), item("line-unstable", "unstable"), item("line-phantom", "phantom"), item("line-linear", "without impacts or contacts"), item("natural", "natural frequency"),
    mark("◇", "fold"), mark("■", "flip"), mark("▲", "loss of symmetry"), mark("▽", "grazing"), mark("×", "a limit is passed"), mark("○", "torus"));
}
