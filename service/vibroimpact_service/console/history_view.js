// A motion from an initial state: played, with its impacts and its horizon of trust, and beside it
// the same with soft limiters.

import { compute } from "./api.js";
import { BaseView } from "./base_view.js";
import { Clicks } from "./clicks.js";
import { Curve } from "./curve.js";
import { button, download, make, settled } from "./dom.js";
import { choiceField, numberField, switchField } from "./fields.js";
import { numbersOf } from "./figure.js";
import { help } from "./help.js";
import { atTimes, loadFields } from "./loads.js";
import { spread } from "./motion_card.js";
import { rangeOfModes, time, velocity } from "./natural.js";
import { interpolated, shown } from "./numbers.js";
import { Player, calm } from "./player.js";
import { ofMotion, ratesPart } from "./rates.js";
import { Shape } from "./shape.js";
import { wholeRange } from "./ranges.js";
import { setFields, state } from "./state.js";
import { coordinateName, geometryOf, neededDofs, size, systemDocument, yields } from "./structures.js";
import { axisOf, labelled, withUnit } from "./units.js";
import { stopName } from "./words.js";
import { onTheme, shapeColours } from "./theme.js";

/** @returns {Record<string, any>} */
function fields() {
  const { stops } = state.structure;
  const first = stops[0];
  const start = state.fields.state ? "state" : state.fields.mode ? "mode" : "coordinate";
  return {
    start, mode: null, periods: 12, duration: null, dof: first ? first.dof : 0, x: 0, v: velocity(1.5), soft: false, exponent: 17, stiffness: 10, scale: 0.97,
    load: [], coordinate: first ? first.dof : 0, ...state.fields, ...(yields(state.structure) ? { soft: false } : {}),
  };
}

/** @returns {number} */
function duration() {
  const now = fields();
  if (now.duration) return now.duration;
  return now.start === "mode" && now.mode ? (now.periods * 2 * Math.PI) / now.mode : time(12.6);
}

/** @param {(number | null)[]} values @returns {number} */
function largest(values) {
  return values.reduce((/** @type {number} */ most, each) => Math.max(most, each ?? 0), 0);
}

export class HistoryView extends BaseView {
  /** @param {HTMLElement} root */
  constructor(root) {
    super(root, { name: "history", title: "Time history", help: help("horizon") });
    /** With soft stops. @type {any} */ this.soft = null;
    /** @type {Curve | null} */ this.curve = null;
    /** @type {{shape: Shape, rows: ArrayLike<number>[], impacts: any, x: Float64Array}[]} */ this.moving = [];
    /** State in which the motion between soft stops, or stops with a stiffness, begins. @type {any} */ this.beginning = null;
    this.begun = false;
    this.clicks = new Clicks();
    this.play = button("Play", () => this.player.toggle(), { class: "play primary" });
    this.scrub = make("input", { type: "range", min: 0, max: 1, step: 0.0005, value: 0, "aria-label": "Time" });
    this.speed = make("select", { "aria-label": "Speed" }, ...[["40", "slow"], ["15", "normal"], ["5", "fast"]].map(([value, text]) => make("option", { value, selected: value === "15" }, text)));
    this.time = make("output", { class: "time" }, "t = 0");
    this.sound = switchField("sound of impacts", false, (on) => this.clicks.enable(on), { name: "sound" });
    this.shapes = make("div", { class: "shapes" });
    // Kept curves stand beside the figure.
    this.kept.before(this.shapes, make("div", { class: "controls" }, this.play, this.scrub, this.speed, this.time, this.sound));
    this.legend = make("ul", { class: "legend" });
    this.force = make("div", { class: "forces" });
    /** Forces of the stops that have a stiffness. @type {Curve | null} */ this.forces = null;
    this.figure.after(this.force);
    this.rates = ratesPart(() => this.#differentiated());
    this.askRates = settled(250, () => this.rates.update());
    this.section.append(this.legend, this.rates.element);
    this.player = new Player((place, from) => this.#frame(place, from), { seconds: 15, again: false });
    this.player.onState = () => { this.play.textContent = this.player.playing ? "Pause" : "Play"; this.askRates(); };
    this.scrub.addEventListener("input", () => this.#seek(Number(this.scrub.value)));
    this.speed.addEventListener("change", () => { this.player.seconds = Number(this.speed.value); });
    this.watch = new ResizeObserver(() => this.#frame(this.player.place, this.player.place));
    this.watch.observe(this.shapes);
    this.stopTheme = onTheme(() => {
      for (const each of this.moving) each.shape.colours = shapeColours();
      this.#frame(this.player.place, this.player.place);
    });
  }

  destroy() {
    super.destroy();
    this.player.pause();
    this.clicks.enable(false);
    if (this.forces) this.forces.destroy();
    this.watch.disconnect();
    this.stopTheme();
  }

  controls() {
    const now = fields();
    const starts = /** @type {[string, string][]} */ ([["mode", "an impact mode"], ["coordinate", "one coordinate moved"], ...(now.state ? [["state", "the state seen before"]] : [])]);
    return [
      choiceField("Start from", starts, now.start, (value) => this.reshape({ start: value, ...(value === "mode" && !now.mode ? { mode: Number(((rangeOfModes()[0] + 2 * rangeOfModes()[1]) / 3).toPrecision(3)) } : {}) }), { pointer: "/initial", name: "start" }),
      ...(now.start === "mode" ? [
        numberField("Ω of the mode", now.mode, this.set("mode"), { pointer: "/initial/impact_mode/Omega", min: 0, name: "mode" }),
        numberField("periods", now.periods, (value) => this.change({ duration: undefined, periods: value }), { min: 0, name: "periods" })]
        : now.start === "coordinate" ? [
          numberField("coordinate", now.dof, this.set("dof"), { min: 0, whole: true, pointer: "/initial/x", name: "dof" }),
          numberField("displacement", now.x, this.set("x"), { name: "x" }), numberField("velocity", now.v, this.set("v"), { pointer: "/initial/v", name: "v" })] : []),
      ...(now.start === "mode" ? [] : [numberField("until t", duration(), this.set("duration"), { pointer: "/t_end", min: 0, name: "duration" })]),
      numberField("shown coordinate", now.coordinate, (value) => { setFields({ coordinate: value }, { silent: true }); this.draw(); }, { min: 0, whole: true, name: "coordinate" }),
      ...(yields(state.structure) ? [] : [switchField("soft stops beside", now.soft, (value) => this.reshape({ soft: value }), { name: "soft" })]),
      ...(now.soft ? [
        numberField("exponent", now.exponent, this.set("exponent"), { pointer: "/limiter/exponent", min: 1, name: "exponent" }),
        numberField("force at the gap", now.stiffness, this.set("stiffness"), { pointer: "/limiter/stiffness", min: 0, name: "stiffness" }),
        numberField("scale of gaps", now.scale, this.set("scale"), { pointer: "/limiter/scale", min: 0, name: "scale" })] : []),
      loadFields(now.load, "frequency", this),
    ];
  }

  requests() {
    const now = fields();
    const n = size(state.structure);
    const dofs = n > 100 ? [...new Set([...neededDofs(state.structure, 100), now.coordinate])].sort((a, b) => a - b) : undefined;
    const t_end = duration();
    const count = dofs ? dofs.length : n;
    const num = Math.max(200, Math.min(3001, Math.floor(150_000 / Math.max(1, count))));
    const request = {
      system: systemDocument(state.structure), initial: (yields(state.structure) && now.start === "mode" && this.beginning) || this.#initial(n), t_end, t: { num }, ...(dofs ? { dofs } : {}),
      ...atTimes(now.load), outputs: ["x", "impacts", "contacts", ...(yields(state.structure) ? ["force"] : [])],
    };
    const limiter = { law: "power", exponent: now.exponent, stiffness: now.stiffness, scale: now.scale };
    return [
      { title: "Rigid", kind: "time-history", request },
      ...(now.soft && this.beginning ? [{ title: "Soft", kind: "time-history", request: { ...request, initial: this.beginning, limiter, tolerance: 1e-6, outputs: ["x"] } }] : []),
    ];
  }

  /**
   * Learn the state in which the motion between soft stops, or stops with a stiffness, begins: impact
   * modes are motions between rigid ones.
   * @param {AbortSignal} signal
   */
  async #begin(signal) {
    const now = fields();
    const initial = this.#initial(size(state.structure));
    this.beginning = now.soft ? initial : null;
    if (now.start !== "mode" || !(now.soft || yields(state.structure))) return;
    const first = await compute("time-history", { system: systemDocument(state.structure, false), initial, t_end: duration(), t: [0], outputs: ["x", "v"] }, { signal });
    this.beginning = { x: first.x[0], v: first.v[0] };
  }

  /** @param {number} n */
  #initial(n) {
    const now = fields();
    if (now.start === "mode") {
      const active = state.structure.stops.map((stop, i) => (stop.active ? i : -1)).filter((i) => i >= 0);
      return { impact_mode: { Omega: now.mode, ...(active.length && active.length < state.structure.stops.length ? { active } : {}) } };
    }
    if (now.start === "state") return now.state;
    const [x, v] = [new Array(n).fill(0), new Array(n).fill(0)];
    if (now.dof < n) [x[now.dof], v[now.dof]] = [now.x, now.v];
    return { x, v };
  }

  /** @param {AbortSignal} signal @param {import("./base_view.js").OnJob} onJob */
  async work(signal, onJob) {
    await this.#begin(signal);
    const [rigid, soft] = this.requests();
    const [result, beside] = await Promise.all([
      compute(rigid.kind, rigid.request, { signal, onJob }), soft ? compute(soft.kind, soft.request, { signal }) : null]);
    this.soft = beside;
    this.accept(result, (beside && beside.neglected) || []);
    this.draw();
    this.#show();
    this.askRates();
    if (!this.begun && !calm()) this.player.play();
    this.begun = true;
  }

  draw() {
    const { result: rigid, soft } = this;
    if (!rigid) return;
    const { coordinate } = fields();
    const column = Math.max(0, rigid.dof.indexOf(coordinate));
    const x = rigid.x.map((/** @type {number[]} */ row) => row[column]);
    if (this.drawing) this.drawing.destroy();
    const holder = make("div");
    this.figure.replaceChildren(holder);
    const until = rigid.error.predictable_until;
    const end = rigid.t[rigid.t.length - 1];
    const { contacts } = rigid;
    const [count, rests] = [rigid.impacts.time.length, contacts ? contacts.start.length : 0];
    const compliant = yields(state.structure);
    const met = compliant ? `${rests} contacts` : `${count} impacts`;
    this.curve = this.drawing = new Curve(holder, {
      x: labelled("time t", "time"), y: axisOf(rigid.dof[column]), height: 260, strip: 1, zoom: this.zoom,
      label: `Displacement of ${coordinateName(state.structure, rigid.dof[column])} over time with ${met}${until < end ? `, predictable until t = ${shown(until, 4)}` : ""}.`,
      series: [{ label: "rigid", colour: "accent", width: 1.6 }, { label: "soft", colour: "soft-curve", width: 1.3, dash: [5, 3] }],
    });
    this.curve.levels = state.structure.stops.filter((stop) => stop.dof === coordinate && stop.relativeTo === null)
      .flatMap(({ lower, upper }) => [upper, lower === null ? null : -lower]).filter((at) => at !== null).map((at) => ({ at: /** @type {number} */ (at), colour: "stop", width: 1.5 }));
    this.curve.bands = [
      ...rigid.impacts.time.map((/** @type {number} */ time) => ({ start: time, stop: time, colour: "stop", row: 0 })),
      ...(compliant ? contacts.start.map((/** @type {number} */ start, /** @type {number} */ i) => ({ start, stop: contacts.stop[i] ?? end, colour: "stop", row: 0 })) : []),
      ...(until < end ? [{ start: until, stop: end, colour: "alarm" }] : [])];
    this.curve.extent = [0, end];
    const beside = soft ? soft.x.map((/** @type {number[]} */ row) => row[column]) : [];
    this.curve.range = wholeRange([...x, ...beside, ...this.curve.levels.map((level) => level.at)]);
    this.curve.onPick = (at) => this.#seek(at / end);
    this.curve.show([rigid.t, x, soft ? beside : x.map(() => null)]);
    this.#drawForce();
    const trust = until < end
      ? `Beyond t = ${shown(until, 4)} double precision cannot tell where the structure is: deviations grow ${shown(rigid.error.condition, 2)} times.`
      : "Every digit shown can be trusted to the end.";
    const felt = compliant && rests ? `, the largest force ${withUnit(shown(largest(contacts.peak_force), 5), "force")}, the deepest indentation ${withUnit(shown(largest(contacts.indentation), 5), "length")}` : "";
    this.readout.textContent = `${met}${felt}. ${trust}`;
  }

  /** @returns {import("./rates.js").Asked | null} the motion at the time of the cursor; null at its beginning, and while it plays */
  #differentiated() {
    const { result, player } = this;
    if (!result || player.playing || !player.place) return null;
    const dof = result.dof[Math.max(0, result.dof.indexOf(fields().coordinate))];
    return ofMotion(this.requests()[0].request, state.structure.stops, { t: player.place * result.t[result.t.length - 1], dof, label: axisOf(dof) });
  }

  detail() {
    const now = fields();
    if (now.start === "mode") return `from the impact mode at Ω = ${shown(now.mode, 6)}`;
    return now.start === "coordinate" ? `from coordinate ${now.dof} with displacement ${shown(now.x, 4)}, velocity ${shown(now.v, 4)}` : "from the state seen before";
  }

  others() {
    return [this.forces];
  }

  /** The forces of stops with a stiffness, below the displacement. */
  #drawForce() {
    if (this.forces) this.forces.destroy();
    this.forces = null;
    this.force.replaceChildren();
    const { t, force, contacts } = this.result;
    if (!force) return;
    const holder = make("div");
    this.force.append(holder);
    const { stops } = state.structure;
    const peak = largest(contacts.peak_force);
    this.forces = new Curve(holder, {
      x: labelled("time t", "time"), y: labelled("force of the stops", "force"), height: 180,
      label: `Force of the stops over time: ${contacts.start.length} contacts, the largest force ${withUnit(shown(peak, 4), "force")}.`,
      series: stops.map((stop, i) => ({ label: stopName(stop, i), colour: `curve-${(i % 4) + 1}`, width: 1.6 })),
    });
    const columns = stops.map((_, i) => force.map((/** @type {number[]} */ row) => row[i]));
    this.forces.extent = [0, t[t.length - 1]];
    // Peaks lie between the times of the curve.
    this.forces.range = wholeRange([0, peak]);
    this.forces.onPick = (at) => this.#seek(at / t[t.length - 1]);
    this.forces.show([t, ...columns]);
    this.force.append(button("Save the forces as CSV", () => this.forces && download("forces.csv", new Blob([numbersOf(this.forces)], { type: "text/csv" })), { class: "quiet" }));
  }

  #show() {
    const geometry = geometryOf(state.structure);
    const compliant = yields(state.structure);
    // Motions that meet a stop with a stiffness have no derivatives.
    this.rates.element.hidden = compliant;
    const kinds = [["thick", compliant ? "stops with stiffness" : "rigid stops"], ...(this.soft ? [["soft", "soft stops"]] : []), ["tick", compliant ? "contact" : "impact"], ["horizon", "beyond the horizon of trust"]];
    this.legend.replaceChildren(...kinds.map(([kind, text]) => make("li", {}, make("span", { class: `key ${kind}`, "aria-hidden": "true" }), text)));
    const results = [[compliant ? "stops with stiffness" : "rigid stops", this.result], ...(this.soft ? [["soft stops", this.soft]] : [])];
    this.shapes.replaceChildren();
    this.moving = results.map(([name, result]) => {
      const canvas = make("canvas", { class: "shape", role: "img", "aria-label": `The structure with ${name} at the time of the cursor` });
      this.shapes.append(make("figure", {}, canvas, make("figcaption", { class: "hint" }, name)));
      const kept = { ...geometry, drawn: geometry.drawn.filter((dof) => result.dof.includes(dof)) };
      const rows = spread(result.x, result.dof, geometry.n);
      const shape = new Shape(canvas, kept, state.structure.stops, shapeColours());
      shape.fit(rows);
      shape.envelope = null;
      return { shape, rows, impacts: result.impacts, x: new Float64Array(geometry.n) };
    });
    const reach = Math.max(...this.moving.map(({ shape }) => shape.reach));
    for (const { shape } of this.moving) shape.reach = reach;
    this.#frame(this.player.place, this.player.place);
  }

  /** @param {number} place */
  #seek(place) {
    this.player.pause();
    this.player.seek(place);
    this.askRates();
  }

  /** @param {number} place @param {number} from */
  #frame(place, from) {
    const { result: rigid } = this;
    if (!rigid || !this.curve) return;
    const end = rigid.t[rigid.t.length - 1];
    const t = place * end;
    const { impacts, contacts } = rigid;
    const { time, constraint, side, velocity } = impacts;
    const glow = Math.max(end * 0.004, 1e-9);
    /** @type {import("./shape.js").Mark[]} */
    const marks = [];
    time.forEach((/** @type {number} */ at, /** @type {number} */ i) => {
      if (Math.abs(at - t) < glow) marks.push({ stop: constraint[i], side: side[i] });
      if (this.player.playing && at > from * end && at <= t) this.clicks.click(Math.abs(velocity[i]));
    });
    if (this.forces) {
      // While it lasts, a contact is seen.
      contacts.start.forEach((/** @type {number} */ start, /** @type {number} */ i) => {
        if (start <= t && t <= (contacts.stop[i] ?? end)) marks.push({ stop: contacts.constraint[i], side: contacts.side[i] });
      });
      this.forces.point(t);
    }
    this.moving.forEach(({ shape, rows, x }, i) => {
      shape.chosen = fields().coordinate;
      shape.draw(interpolated(rows, place * (rows.length - 1), x), i ? [] : marks);
    });
    this.curve.point(t);
    this.scrub.value = String(place);
    this.time.textContent = `t = ${shown(t, 4)}`;
  }
}
