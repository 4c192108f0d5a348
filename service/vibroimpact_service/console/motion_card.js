// A moving structure with its waveform beside it, played, paused and scrubbed.

import { Curve } from "./curve.js";
import { button, make } from "./dom.js";
import { interpolated, linspace, shown } from "./numbers.js";
import { Player, calm } from "./player.js";
import { wholeRange } from "./ranges.js";
import { Shape } from "./shape.js";
import { onTheme, shapeColours } from "./theme.js";

/**
 * @typedef {{name?: (dof: number) => string, axis?: (dof: number) => string, geometry: import("./structures.js").Geometry, stops: import("./structures.js").Stop[], rows: ArrayLike<number>[],
 *   row: (place: number) => number, marks: (place: number) => import("./shape.js").Mark[], coordinate: number,
 *   points?: {x: number, y: number, colour: string}[], time?: (place: number) => string, keep?: boolean}} Motion
 *   rows: displacements [row][dof] in all degrees of freedom; row: the fractional row at a place between 0 and 1
 */

export class MotionCard {
  /** @param {HTMLElement} root @param {{title: string, axis: string}} options */
  constructor(root, { title, axis }) {
    this.canvas = make("canvas", { class: "shape", role: "img", "aria-label": title });
    this.play = button("Play", () => this.player.toggle(), { class: "play" });
    this.scrub = make("input", { type: "range", min: 0, max: 1, step: 0.001, value: 0, "aria-label": "Time within the period" });
    this.speed = make("select", { "aria-label": "Speed" }, ...[["6", "slow"], ["3", "normal"], ["1.2", "fast"]].map(([value, text]) => make("option", { value, selected: value === "3" }, text)));
    this.label = make("output", { class: "time" }, "");
    this.wave = make("div");
    this.caption = make("p", { class: "hint" });
    root.append(
      make("div", { class: "motion" },
        make("div", {}, make("h3", {}, title), this.canvas, make("div", { class: "controls" }, this.play, this.scrub, this.speed, this.label)),
        make("div", {}, make("h3", {}, "Waveform"), this.wave, this.caption)));
    this.curve = new Curve(this.wave, {
      x: axis, y: "displacement", height: 250, label: "Displacement over one period", series: [{ label: "x", colour: "accent", width: 2 }],
    });
    this.player = new Player((place) => this.draw(place), { seconds: 3, again: true });
    this.player.onState = () => { this.play.textContent = this.player.playing ? "Pause" : "Play"; };
    this.curve.onPick = (x) => this.seek(x);
    this.scrub.addEventListener("input", () => this.seek(Number(this.scrub.value)));
    this.speed.addEventListener("change", () => { this.player.seconds = Number(this.speed.value); });
    /** @type {Shape | null} */ this.shape = null;
    /** @type {Motion | null} */ this.motion = null;
    this.x = new Float64Array(0);
    /** @type {(dof: number) => void} */ this.onCoordinate = () => {};
    this.canvas.addEventListener("click", (event) => {
      const dof = this.shape ? this.shape.at(event.offsetX, event.offsetY) : -1;
      if (dof >= 0) this.choose(dof);
    });
    this.#turn();
    this.watch = new ResizeObserver(() => this.draw(this.player.place));
    this.watch.observe(this.canvas);
    this.stopTheme = onTheme(() => {
      if (this.shape) this.shape.colours = shapeColours();
      this.draw(this.player.place);
    });
  }

  destroy() {
    this.player.pause();
    this.watch.disconnect();
    this.stopTheme();
    this.curve.destroy();
  }

  /** @param {number} place */
  seek(place) {
    this.player.pause();
    this.player.seek(place);
  }

  /** @param {number} dof */
  choose(dof) {
    if (!this.motion) return;
    this.motion.coordinate = dof;
    this.onCoordinate(dof);
    this.#waveform(this.motion);
    this.draw(this.player.place);
  }

  /** @param {Motion} motion */
  show(motion) {
    this.motion = motion;
    const turned = this.shape ? this.shape.angles : null;
    this.shape = new Shape(this.canvas, motion.geometry, motion.stops, shapeColours());
    if (turned) this.shape.angles = turned;
    this.shape.fit(motion.rows);
    this.x = new Float64Array(motion.geometry.n);
    this.#waveform(motion);
    this.draw(this.player.place);
    if (!motion.keep && !calm()) this.player.play();
  }

  /** @param {Motion} motion */
  #waveform(motion) {
    const { rows, row, coordinate, stops } = motion;
    const places = linspace(0, 1, 241);
    const alone = rows.map((each) => [each[coordinate]]);
    const one = new Float64Array(1);
    const values = places.map((place) => interpolated(alone, row(place), one)[0]);
    const walls = stops.filter((stop) => stop.dof === coordinate && stop.relativeTo === null);
    this.curve.levels = walls.flatMap(({ lower, upper }) => [upper, lower === null ? null : -lower])
      .filter((level) => level !== null).map((at) => ({ at: /** @type {number} */ (at), colour: "stop", width: 1.5 }));
    this.curve.range = wholeRange([...values, ...this.curve.levels.map((level) => level.at)]);
    this.curve.extent = [0, 1];
    this.curve.marks = (motion.points || []);
    const name = motion.name ? motion.name(coordinate) : `coordinate ${coordinate}`;
    this.curve.options.y = motion.axis ? motion.axis(coordinate) : `x of ${name}`;
    this.curve.root.setAttribute("aria-label", `Displacement of ${name} over one period, between ${shown(Math.min(...values), 3)} and ${shown(Math.max(...values), 3)}.`);
    this.curve.show([places, values]);
    this.caption.textContent = motion.geometry.n > 1 ? `${name[0].toUpperCase()}${name.slice(1)}; click another one in the drawing. Red lines are its stops.` : "Red lines are the stops.";
  }

  /** @param {number} place */
  draw(place) {
    const { motion, shape } = this;
    if (!motion || !shape) return;
    shape.chosen = motion.coordinate;
    shape.draw(interpolated(motion.rows, motion.row(place), this.x), motion.marks(place));
    this.curve.point(place);
    this.scrub.value = String(place);
    this.label.textContent = motion.time ? motion.time(place) : `t/T ${place.toFixed(2)}`;
  }

  /** A cloud of nodes is turned by dragging. */
  #turn() {
    this.canvas.addEventListener("pointermove", (event) => {
      if (!(event.buttons & 1) || !this.shape || this.shape.geometry.layout !== "cloud") return;
      const [turn, tilt] = this.shape.angles;
      this.shape.angles = [turn + event.movementX / 120, Math.min(1.5, Math.max(-1.5, tilt + event.movementY / 120))];
      this.draw(this.player.place);
    });
  }
}

/**
 * Return displacements in all degrees of freedom, zero where they are not known.
 * @param {number[][]} rows [row][of]
 * @param {number[]} dofs
 * @param {number} n
 */
export function spread(rows, dofs, n) {
  return rows.map((row) => {
    const all = new Float64Array(n);
    dofs.forEach((dof, i) => { all[dof] = row[i]; });
    return all;
  });
}
