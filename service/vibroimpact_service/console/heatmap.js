// A quantity over a plane: colours behind the axes of a curve, with a scale beside it.

import { Curve } from "./curve.js";
import { make } from "./dom.js";
import { shown } from "./numbers.js";

/** From dark to light, told apart by readers who do not see all colours. */
const COLOURS = [[48, 18, 84], [62, 73, 137], [38, 130, 142], [81, 186, 114], [220, 226, 75]];

/** @param {number} share 0 to 1 @returns {number[]} */
function mapped(share) {
  const place = Math.min(Math.max(share, 0), 1) * (COLOURS.length - 1);
  const at = Math.min(Math.floor(place), COLOURS.length - 2);
  return COLOURS[at].map((value, i) => Math.round(value + (place - at) * (COLOURS[at + 1][i] - value)));
}

export class Heatmap {
  /**
   * @param {HTMLElement} root
   * @param {{x: string, y: string, value: string, label: string, zoom?: import("./zoom.js").Zoom}} options
   */
  constructor(root, options) {
    this.options = options;
    this.scale = make("div", { class: "scale" });
    const holder = make("div");
    root.replaceChildren(holder, this.scale);
    this.curve = new Curve(holder, { x: options.x, y: options.y, height: 420, grid: false, label: options.label, zoom: options.zoom, series: [{ label: "", colour: "line" }] });
    /** @type {(x: number, y: number) => void} */ this.onPick = () => {};
    /** @type {(x: number, y: number) => void} */ this.onHover = () => {};
    this.curve.onPick = (x, y) => this.onPick(x, y);
    this.curve.onHover = (_, x, y) => this.onHover(x, y);
  }

  destroy() {
    this.curve.destroy();
  }

  /**
   * Each cell is centred at its values.
   * @param {number[]} xs ascending
   * @param {number[]} ys ascending
   * @param {(number | null)[][]} values [y][x]; null stays empty
   */
  show(xs, ys, values) {
    const used = values.flat().filter((value) => value !== null && Number.isFinite(value)).map(Number).sort((a, b) => a - b);
    // The largest percent, beside poles, would leave one colour for all others.
    const [low, high] = used.length ? [used[0], used[Math.min(used.length - 1, Math.floor(0.985 * used.length))]] : [0, 1];
    const image = make("canvas", { width: xs.length, height: ys.length });
    const context = /** @type {CanvasRenderingContext2D} */ (image.getContext("2d"));
    const pixels = context.createImageData(xs.length, ys.length);
    values.forEach((row, j) => row.forEach((value, i) => {
      if (value === null || !Number.isFinite(value)) return;
      const [r, g, b] = mapped((value - low) / (high - low || 1));
      pixels.data.set([r, g, b, 255], 4 * ((ys.length - 1 - j) * xs.length + i));
    }));
    context.putImageData(pixels, 0, 0);
    this.curve.image = image;
    /** @param {number[]} list @returns {[number, number]} */
    const edges = (list) => {
      const half = (list[list.length - 1] - list[0]) / Math.max(1, list.length - 1) / 2 || 0.5;
      return [list[0] - half, list[list.length - 1] + half];
    };
    this.curve.extent = edges(xs);
    this.curve.range = edges(ys);
    this.curve.values = { label: this.options.value, rows: ys.flatMap((y, j) => xs.map((x, i) => [x, y, values[j][i]])) };
    this.curve.show([[xs[0], xs[xs.length - 1]], [null, null]]);
    const bar = make("canvas", { width: 128, height: 1, class: "bar", "aria-hidden": "true" });
    const barContext = /** @type {CanvasRenderingContext2D} */ (bar.getContext("2d"));
    for (let i = 0; i < 128; i += 1) {
      const [r, g, b] = mapped(i / 127);
      barContext.fillStyle = `rgb(${r} ${g} ${b})`;
      barContext.fillRect(i, 0, 1, 1);
    }
    this.scale.replaceChildren(make("span", {}, `${this.options.value}: `), make("span", {}, shown(low, 3)), bar, make("span", {}, shown(high, 3)));
  }
}
