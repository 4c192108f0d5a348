// What the views of computations have in common: a form, one computation at a time, its progress.

import { Away, ask, compute, latest } from "./api.js";
import { button, make, settled } from "./dom.js";
import { hasInvalid, showError } from "./fields.js";
import { copyOf, standing } from "./figure.js";
import { goOn, keep, keptFigures, keptOf } from "./kept.js";
import { cautions } from "./natural.js";
import { duration } from "./numbers.js";
import { progressLine, working } from "./progress.js";
import { report } from "./report.js";
import { setFields, state } from "./state.js";
import { inWords } from "./structures.js";
import { plotTools } from "./tools.js";
import { Zoom } from "./zoom.js";

/** @typedef {{title: string, kind: string, request: any}} Request */
/** @typedef {(job: import("./api.js").Job) => void} OnJob */

/** Why what is shown answers the former input. @type {Record<string, string>} */
const FORMER = {
  input: "a field has no valid value.",
  refused: "the present one was refused.",
  away: "the service does not answer to the present one.",
};

/** Milliseconds in which a curve takes the width of its place. */
const RESIZING = 150;

/** Planned seconds up to which a view follows a slider while it is dragged. */
const LIVELY = 0.4;

/** Planned seconds up to which what may take long is computed without being asked for. */
const PATIENCE = 3;

export class BaseView {
  /**
   * @param {HTMLElement} root
   * @param {{name: string, title: string, hint?: string, pause?: number, help?: HTMLElement, ranged?: boolean}} options
   *   pause: milliseconds after the last change of a field before it is computed; ranged: whether the fields
   *   `from` and `to` are the range of its curve
   */
  constructor(root, { name, title, hint, pause = 200, help, ranged }) {
    this.root = root;
    this.name = name;
    this.title = title;
    /** The part of the curve that is shown. */ this.zoom = new Zoom();
    this.zoom.changed = () => this.zoomed();
    /** Whether a slider is being dragged: only the first answer is wanted. */ this.dragged = false;
    /** @type {any} */ this.result = null;
    /** The main drawing. @type {{destroy: () => void} | null} */ this.drawing = null;
    /** @type {AbortController | null} */ this.running = null;
    /** Whether another view has taken its place: it has nothing to say any more. */ this.gone = false;
    this.form = make("div", { class: "toolbar" });
    this.note = make("p", { class: "hint" }, hint);
    this.progress = progressLine();
    this.figure = make("div", { class: "figure" });
    this.kept = make("div", { class: "beside" });
    this.tools = plotTools({
      name, curve: () => this.plotted(), caption: () => `${title}: ${this.#caption()}`, keep: () => this.#keep(), report: () => this.#report(),
      ...(ranged ? { compute: (from, to) => { this.change({ from, to }); this.toolbar(); } } : {}),
    });
    this.readout = make("p", { class: "readout" });
    this.caution = make("div", { class: "cautions", role: "status" });
    /** Says that what is shown answers the former input. */
    this.former = make("p", { class: "caution", role: "status" });
    /** Parts of the view that answer the former input, and why. @type {Map<string, string>} */ this.outdated = new Map();
    this.section = make("section", { class: "card", "aria-labelledby": `${name}-title` },
      make("h2", { id: `${name}-title` }, title, help), this.form, this.note, this.progress.element, this.caution, this.kept, this.figure, this.readout, this.tools.element);
    const follow = latest(() => this.#follow());
    this.follow = () => { follow(undefined); };
    root.append(this.former, this.section);
    this.#besides();
    this.refresh = settled(pause, () => this.compute());
  }

  destroy() {
    this.gone = true;
    this.root.classList.remove("former");
    if (this.running) this.running.abort();
    if (this.drawing) this.drawing.destroy();
  }

  update() {
    this.toolbar();
    return this.compute();
  }

  /** @returns {HTMLElement[]} the fields of the form */
  controls() {
    return [];
  }

  /** @returns {Request[]} what the view computes; the first one is its result */
  requests() {
    return [];
  }

  /** Draw the result. */
  draw() {}

  toolbar() {
    this.form.replaceChildren(...this.controls());
  }

  /**
   * Change fields of the address and compute with them.
   * @param {Record<string, any>} fields
   */
  change(fields) {
    setFields(fields, { silent: true });
    this.refresh();
  }

  /** As `change`, where other fields of the form depend on these. @param {Record<string, any>} fields */
  reshape(fields) {
    this.change(fields);
    this.toolbar();
  }

  /** @param {string} name @returns {(value: any) => void} what changes a field */
  set(name) {
    return (value) => this.change({ [name]: value });
  }

  /** @returns {import("./curve.js").Curve | null} the main curve */
  plotted() {
    if (!this.drawing) return null;
    return /** @type {any} */ ("curve" in this.drawing ? this.drawing.curve : this.drawing);
  }

  /** The part of the curve that is shown has changed. */
  zoomed() {
    this.tools.update();
  }

  /** @returns {string} what it is computed for beside the structure, in words; may be empty */
  detail() {
    return "";
  }

  /** @returns {(import("./curve.js").Curve | null)[]} curves beside the main one */
  others() {
    return [];
  }

  /** @returns {string} what is shown */
  #caption() {
    return [inWords(state.structure), this.detail()].filter(Boolean).join("; ");
  }

  async #keep() {
    const caption = this.#caption();
    const [said] = (this.readout.textContent || "").split(". ");
    // It is drawn in the size in which it will stand there.
    this.section.classList.add("compared");
    await new Promise((resolve) => { setTimeout(resolve, RESIZING); });
    const curve = this.plotted();
    if (curve && curve.plot) keep(this.name, { picture: standing(curve, ""), caption, said: `${said}.` });
    this.#besides();
  }

  #besides() {
    this.kept.replaceChildren(...keptFigures(this.name, () => this.#besides()));
    this.section.classList.toggle("compared", this.kept.childElementCount > 0);
  }

  #report() {
    const curve = this.plotted();
    if (!this.result) throw new Error("There is no result to report yet.");
    const caption = this.#caption();
    report({
      title: this.title, view: this.root, result: this.result, requests: this.requests(),
      figures: [...keptOf(this.name).map((each) => make("figure", {}, copyOf(each.picture), make("figcaption", {}, `Kept: ${each.caption}. ${each.said}`))), ...(curve && curve.plot ? [standing(curve, caption)] : []), ...this.others().flatMap((each) => (each && each.plot ? [standing(each, "")] : []))],
    });
  }

  /** Compute what is seen while a slider is dragged: one request at a time, none of them a job. */
  async #follow() {
    const [first] = this.requests();
    if (!first || hasInvalid()) return;
    const { seconds, inline, cached } = await ask("POST", `/v1/plan/${first.kind}`, first.request).catch(() => ({}));
    if (!cached && !(inline && seconds <= LIVELY)) return;
    this.dragged = true;
    try {
      await this.compute();
    } finally {
      this.dragged = false;
    }
  }

  /** Compute anew; what was under way before is given up. */
  async compute() {
    if (this.running) this.running.abort();
    // Numbers of the address are checked as typed ones are: no request is made of wrong ones.
    this.checked();
    if (hasInvalid()) return;
    this.running = new AbortController();
    const { signal } = this.running;
    const before = this.result;
    try {
      await working(this.progress, (onJob) => this.work(signal, onJob));
    } catch (error) {
      if (this.gone) return;
      // What comes after the result is left out where it is refused: nothing former is shown.
      if (this.result === before) this.refused("result", error);
      else showError(error);
    }
  }

  /** @param {AbortSignal} signal @param {OnJob} onJob */
  async work(signal, onJob) {
    const [first] = this.requests();
    if (!first) return;
    this.accept(await compute(first.kind, first.request, { signal, onJob }));
    this.draw();
  }

  /**
   * Take over the answer to the present input, and say what of the structure it neglects.
   * @param {any} result
   * @param {string[]} more sentences about what else has no effect
   */
  accept(result, more = []) {
    this.result = result;
    this.answered("result");
    this.checked();
    this.say([...cautions(), ...more, ...(result.neglected || [])]);
    this.tools.update();
    // Once it is drawn.
    requestAnimationFrame(() => goOn(() => this.#keep()));
  }

  /** @param {string[]} sentences about what of the structure has no effect */
  say(sentences) {
    this.caution.replaceChildren(...[...new Set(sentences)].map((each) => make("p", { class: "caution" }, `${each[0].toUpperCase()}${each.slice(1)}.`)));
  }

  /** Note that a part of the view answers the present input. @param {string} part */
  answered(part) {
    this.outdated.delete(part);
    this.#mark();
  }

  /** Show an error, and that a part of the view still answers the former input. @param {string} part @param {unknown} error */
  refused(part, error) {
    showError(error);
    if (error instanceof DOMException && error.name === "AbortError") return;
    this.outdated.set(part, error instanceof Away ? "away" : "refused");
    this.#mark();
  }

  /** Note whether the fields have valid values, without which nothing is computed. */
  checked() {
    if (hasInvalid()) this.outdated.set("input", "input");
    else this.outdated.delete("input");
    this.#mark();
  }

  #mark() {
    const [why] = this.outdated.values();
    const former = why !== undefined && this.result !== null;
    this.root.classList.toggle("former", former);
    this.former.textContent = former ? `What is shown is the answer to the former input: ${FORMER[why]}` : "";
  }

  /** @param {Request} request @param {AbortSignal} signal @returns {Promise<boolean>} whether the plan of a computation is quick, or its result known */
  async isQuick({ kind, request }, signal) {
    const { seconds, cached } = await ask("POST", `/v1/plan/${kind}`, request, signal);
    return cached || seconds <= PATIENCE;
  }

  /**
   * Compute what may take long: at once where the plan says that it is quick, else by a button.
   * @param {Request} request
   * @param {{place: HTMLElement, text: (time: string, seconds: number) => string, act: string, use: (result: any) => void,
   *   queued?: boolean}} offer queued: as a job, unless the result is known
   * @param {AbortSignal} signal
   * @param {OnJob} onJob
   */
  async offered({ kind, request }, { place, text, act, use, queued }, signal, onJob) {
    place.replaceChildren();
    const { seconds, cached } = await ask("POST", `/v1/plan/${kind}`, request, signal);
    /** @param {OnJob} tell */
    const now = async (tell) => use(await compute(kind, request, { signal, onJob: tell, queued: queued && !cached }));
    if (cached || seconds <= PATIENCE) {
      await now(onJob);
      return;
    }
    place.replaceChildren(text(duration(seconds), seconds), " ", button(act, () => {
      place.replaceChildren();
      working(this.progress, now).catch(showError);
    }, { class: "quiet" }));
  }
}
