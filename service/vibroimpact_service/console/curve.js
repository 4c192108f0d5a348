// Curves over one axis, drawn by uPlot: bands behind them, marked lines and points, curves that
// turn back, and a cursor to drag.

import { make } from "./dom.js";
import { inPower, leftOutPower, shown } from "./numbers.js";
import { symbol } from "./symbols.js";
import { colour, onTheme } from "./theme.js";
import { logTicks } from "./ticks.js";
import { Zoom, moved, scaled, within, zoomable } from "./zoom.js";

/**
 * @typedef {{label: string, colour: string, width?: number, dash?: number[], points?: number, open?: boolean,
 *   scale?: string}} Series colours are names of custom properties; points is their diameter
 * @typedef {{start: number, stop: number, colour: string, row?: number, dash?: number[]}} Band row: in the strip below, from 0
 * @typedef {{at: number, colour: string, label?: string, dash?: number[], width?: number}} Line
 * @typedef {{points: [number, number][], colour: string, width: number, dash?: number[], label?: string}} Path in units of the axes
 * @typedef {{x: number, y: number, colour: string, kind?: string}} Mark kind: what `symbol` draws
 * @typedef {{x: string, y: string, series: Series[], height?: number, log?: boolean, upright?: boolean, strip?: number, grid?: boolean,
 *   label: string, zoom?: Zoom}} Options log: the values; upright: the axis points up and the values across; zoom: the
 *   part that is shown, where it outlives the curve
 */

/** Pixels between the numbers of an axis with logarithms, across and upwards. */
const [ROOM_ACROSS, ROOM_UPWARDS] = [56, 26];

export class Curve {
  /**
   * @param {HTMLElement} root
   * @param {Options} options
   */
  constructor(root, options) {
    this.root = root;
    this.options = options;
    /** @type {(number | null)[][]} */
    this.data = [[], ...options.series.map(() => [])];
    /** @type {Band[]} */ this.bands = [];
    /** @type {Line[]} */ this.lines = [];
    /** @type {Line[]} */ this.levels = [];
    /** @type {Path[]} */ this.paths = [];
    /** @type {Mark[]} */ this.marks = [];
    /** @type {[number, number] | null} */ this.range = null;
    /** @type {[number, number] | null} */ this.extent = null;
    /** Where the cursor is, y only where it is at a point. @type {{x: number, y?: number} | null} */ this.chosen = null;
    /** An image behind the curves, over all of both ranges. @type {HTMLCanvasElement | null} */ this.image = null;
    /** What the image shows, for files of numbers. @type {{label: string, rows: (number | null)[][]} | null} */ this.values = null;
    /** @type {(x: number, y: number) => void} */ this.onPick = () => {};
    /** @type {(index: number | null, x: number, y: number) => void} */ this.onHover = () => {};
    /** @type {number | null} */ this.pointed = null;
    /** @type {any} */ this.plot = null;
    this.zoom = options.zoom || new Zoom();
    this.waiting = false;
    // What moves with every frame or every move of the pointer are elements: nothing is drawn again.
    this.marker = make("div", { class: "marker", hidden: true });
    this.cursor = make("div", { class: `marker chosen${options.upright ? " across" : ""}`, hidden: true });
    this.dot = make("div", { class: "dot", hidden: true });
    root.classList.add("curve");
    root.setAttribute("role", "img");
    root.setAttribute("aria-label", options.label);
    this.watch = new ResizeObserver(() => this.#resize());
    this.watch.observe(root);
    this.stopTheme = onTheme(() => this.render());
  }

  destroy() {
    this.watch.disconnect();
    this.stopTheme();
    if (this.plot) this.plot.destroy();
  }

  #resize() {
    const width = this.root.clientWidth;
    if (!width) return;
    if (!this.plot) this.render();
    else if (width !== this.plot.width) this.plot.setSize({ width, height: this.options.height || 300 });
  }

  /** @param {(number | null)[][]} data x, then one list for each series */
  show(data) {
    this.data = data;
    this.zoom.belongsTo("x", String(this.extent));
    this.zoom.belongsTo("y", this.options.y);
    if (this.plot) this.plot.setData(data);
    else this.render();
  }

  /** Move the time marker. @param {number | null} x */
  point(x) {
    this.pointed = x;
    if (!this.plot) return;
    const [low, high] = this.part("x");
    this.marker.hidden = x === null || x < low || x > high;
    if (x !== null) this.marker.style.transform = `translateX(${this.plot.valToPos(x, "x")}px)`;
  }

  /** Move the cursor. @param {number | null} x @param {number} [y] */
  choose(x, y) {
    this.chosen = x === null ? null : { x, y };
    if (this.plot) this.#choose();
  }

  #choose() {
    const { chosen, plot } = this;
    const [low, high] = [plot.scales.x.min, plot.scales.x.max];
    this.cursor.hidden = chosen === null || chosen.x < low || chosen.x > high;
    this.dot.hidden = this.cursor.hidden || chosen === null || chosen.y === undefined || chosen.y > plot.scales.y.max || chosen.y < plot.scales.y.min;
    if (chosen === null) return;
    const [x, y] = [plot.valToPos(chosen.x, "x"), chosen.y === undefined ? 0 : plot.valToPos(chosen.y, "y")];
    this.cursor.style.transform = this.options.upright ? `translateY(${x}px)` : `translateX(${x}px)`;
    this.dot.style.transform = `translate(${x}px, ${y}px)`;
  }

  /** @param {import("./zoom.js").Scale} scale @returns {[number, number]} all that there is */
  whole(scale) {
    return (scale === "x" ? this.extent : this.range) || [0, 1];
  }

  /** @param {import("./zoom.js").Scale} scale @returns {[number, number]} what is shown of it */
  part(scale) {
    return this.zoom[scale] || this.whole(scale);
  }

  /** @param {import("./zoom.js").Scale} scale @returns {(value: number) => string} what writes the numbers of an axis */
  written(scale) {
    const factor = 10 ** -this.#power(scale);
    return (value) => shown(value * factor, 6);
  }

  /** @param {import("./zoom.js").Scale} scale @returns {string} the label of an axis, with the power of ten that its numbers leave out */
  named(scale) {
    return inPower(this.options[scale], this.#power(scale));
  }

  /** @param {import("./zoom.js").Scale} scale */
  #power(scale) {
    return this.#log(scale) ? 0 : leftOutPower(this.part(scale));
  }

  /** Show a part of an axis. @param {import("./zoom.js").Scale} scale @param {[number, number] | null} part null: all */
  limit(scale, part) {
    this.zoom[scale] = part && within(part, this.whole(scale), scale, this.#log(scale));
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      if (this.plot) this.plot.setData(this.data);
      this.zoom.changed();
    });
  }

  /** @param {import("./zoom.js").Scale} scale @param {number} factor above 1: more is shown @param {number} [at] */
  enlarge(scale, factor, at) {
    const part = this.part(scale);
    const middle = this.#log(scale) ? Math.sqrt(part[0] * part[1]) : (part[0] + part[1]) / 2;
    this.limit(scale, scaled(part, factor, at === undefined ? middle : at, this.#log(scale)));
  }

  /** @param {import("./zoom.js").Scale} scale @param {number} share of what is shown */
  move(scale, share) {
    this.limit(scale, moved(this.part(scale), share, this.#log(scale)));
  }

  all() {
    this.limit("x", null);
    this.limit("y", null);
  }

  /** @param {import("./zoom.js").Scale} scale */
  #log(scale) {
    return scale === "y" && Boolean(this.options.log);
  }

  /** Draw bands, lines and marks anew. */
  redraw() {
    if (this.plot) this.plot.redraw(false);
  }

  render() {
    const width = this.root.clientWidth;
    if (!width) return;
    if (this.plot) this.plot.destroy();
    this.plot = new uPlot(/** @type {any} */ (this.#configuration(width)), /** @type {any} */ (this.data), this.root);
    this.plot.over.append(this.cursor, this.dot, this.marker);
    this.#drag(this.plot.over);
    zoomable(this.plot, {
      zoom: (scale, factor, at) => this.enlarge(scale, factor, at), pan: (scale, share) => this.move(scale, share), reset: () => this.all(),
      across: this.options.upright ? "y" : "x", changed: () => this.zoom.x !== null || this.zoom.y !== null,
    });
  }

  /** @param {number} width */
  #configuration(width) {
    const { options } = this;
    const strip = options.strip || 0;
    const [soft, line] = [colour("soft"), colour("line")];
    /** @param {"x" | "y"} scale */
    const axis = (scale) => ({
      scale, label: () => this.named(scale), stroke: soft, labelSize: 20, labelGap: 2, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif",
      grid: { show: options.grid !== false, stroke: line, width: 0.6 }, ticks: { stroke: line, width: 0.6, size: 4 }, gap: 4,
      values: (/** @type {any} */ _, /** @type {(number | null)[]} */ splits) => splits.map((v) => (v === null ? "" : this.written(scale)(v))),
    });
    const upright = Boolean(options.upright);
    const vertical = { ...axis(upright ? "x" : "y"), size: 62, side: 3 };
    const across = { ...axis(upright ? "y" : "x"), size: 30 + 8 * strip, gap: 4 + 8 * strip, side: 2 };
    if (upright) Object.assign(across, { space: 60 });
    if (options.log) {
      const [of, room] = upright ? [across, ROOM_ACROSS] : [vertical, ROOM_UPWARDS];
      Object.assign(of, {
        splits: (/** @type {any} */ plot, /** @type {number} */ _, /** @type {number} */ low, /** @type {number} */ high) => logTicks(low, high, Math.floor((upright ? plot.bbox.width : plot.bbox.height) / (devicePixelRatio || 1) / room)),
        filter: (/** @type {any} */ _, /** @type {number[]} */ splits) => splits,
      });
    }
    return {
      width, height: options.height || 300, padding: [14, upright && options.log ? 26 : 14, 0, 0], legend: { show: false },
      cursor: { drag: { x: false, y: false }, y: false, x: !upright, points: { show: !upright, size: 7 }, focus: { prox: 20 } },
      scales: {
        x: { time: false, ori: upright ? 1 : 0, range: () => this.part("x") },
        y: { ori: upright ? 0 : 1, ...(options.log ? { distr: 3 } : {}), range: () => this.part("y") },
      },
      axes: [upright ? vertical : across, upright ? across : vertical],
      series: [{}, ...options.series.map((each) => this.#series(each))],
      hooks: {
        drawClear: [(/** @type {any} */ plot) => this.#behind(plot)],
        // Places are known once the plot has its size and its ranges.
        draw: [(/** @type {any} */ plot) => {
          this.#before(plot);
          this.#choose();
          this.point(this.pointed);
        }],
        setCursor: [(/** @type {any} */ plot) => {
          const { left, top, idx } = plot.cursor;
          const out = left < 0;
          this.onHover(out ? null : idx, out ? NaN : plot.posToVal(left, "x"), out ? NaN : plot.posToVal(top, "y"));
        }],
      },
    };
  }

  /** @param {Series} each */
  #series(each) {
    const stroke = colour(each.colour);
    const points = { show: Boolean(each.points), size: each.points || 0, fill: each.open ? colour("card") : stroke, stroke, width: 1.2 };
    return {
      label: each.label, stroke, width: each.width === undefined ? 2 : each.width, dash: each.dash, spanGaps: false, points, pxAlign: 0,
      paths: each.width === 0 ? () => null : (/** @type {any} */ plot, /** @type {number} */ index) => ({ stroke: this.#path(plot, index) }),
    };
  }

  /** The line of a series, through each of its points: uPlot's own goes from pixel to pixel where they are many. @param {any} plot @param {number} index */
  #path(plot, index) {
    const path = new Path2D();
    const [xs, ys] = [this.data[0], this.data[index]];
    let drawn = false;
    for (let i = 0; i < xs.length; i += 1) {
      const [x, y] = [xs[i], ys[i]];
      if (x === null || y === null || y === undefined) {
        drawn = false;
        continue;
      }
      const [a, b] = [plot.valToPos(x, "x", true), plot.valToPos(y, "y", true)];
      const [right, down] = this.options.upright ? [b, a] : [a, b];
      if (drawn) path.lineTo(right, down);
      else path.moveTo(right, down);
      drawn = true;
    }
    return path;
  }

  /** @param {any} plot */
  #behind(plot) {
    const { ctx, bbox } = plot;
    const ratio = devicePixelRatio || 1;
    ctx.save();
    if (this.image) {
      ctx.imageSmoothingEnabled = false;
      ctx.beginPath();
      ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
      ctx.clip();
      const [[left, right], [low, high]] = [this.whole("x"), this.whole("y")];
      const [from, top] = [plot.valToPos(left, "x", true), plot.valToPos(high, "y", true)];
      ctx.drawImage(this.image, from, top, plot.valToPos(right, "x", true) - from, plot.valToPos(low, "y", true) - top);
    }
    // Narrow bands side by side are one area, and no darker than wide ones.
    /** @type {Map<string, Path2D>} */
    const areas = new Map();
    for (const band of this.bands) {
      const [a, b] = [band.start, band.stop].map((x) => Math.min(Math.max(plot.valToPos(x, "x", true), bbox.left), bbox.left + bbox.width));
      if (b < a) continue;
      const width = Math.max(b - a, ratio);
      if (band.row === undefined) {
        const area = areas.get(band.colour) || new Path2D();
        area.rect(a, bbox.top, width, bbox.height);
        areas.set(band.colour, area);
      } else {
        ctx.fillStyle = colour(band.colour);
        const [top, height] = [bbox.top + bbox.height + (3 + 8 * band.row) * ratio, 6 * ratio];
        for (const [from, to] of pieces(a, a + width, (band.dash || []).map((part) => part * ratio))) ctx.fillRect(from, top, to - from, height);
      }
    }
    ctx.globalAlpha = 0.13;
    for (const [name, area] of areas) {
      ctx.fillStyle = colour(name);
      ctx.fill(area);
    }
    ctx.restore();
  }

  /** @param {any} plot */
  #before(plot) {
    const { ctx, bbox } = plot;
    const ratio = devicePixelRatio || 1;
    const upright = Boolean(this.options.upright);
    ctx.save();
    ctx.font = `${11 * ratio}px system-ui, sans-serif`;
    ctx.textAlign = "center";
    /** @param {string} scale @param {Line} line @param {boolean} across */
    const rule = (scale, line, across) => {
      const at = plot.valToPos(line.at, scale, true);
      const [low, high] = across ? [bbox.top, bbox.top + bbox.height] : [bbox.left, bbox.left + bbox.width];
      if (!(at >= low - 1 && at <= high + 1)) return false;
      ctx.strokeStyle = colour(line.colour);
      ctx.lineWidth = (line.width || 1) * ratio;
      ctx.setLineDash((line.dash || []).map((part) => part * ratio));
      ctx.beginPath();
      if (across) ctx.rect(bbox.left, at, bbox.width, 0);
      else ctx.rect(at, bbox.top, 0, bbox.height);
      ctx.stroke();
      return at;
    };
    for (const level of this.levels) rule("y", level, !upright);
    let used = -Infinity;
    for (const line of this.lines) {
      const at = rule("x", line, upright);
      if (at === false || !line.label || at - used < 22 * ratio) continue;
      used = at;
      ctx.fillStyle = colour("soft");
      ctx.fillText(line.label, at, bbox.top - 4 * ratio);
    }
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    /** @param {number} x @param {number} y @returns {[number, number]} */
    const at = (x, y) => [plot.valToPos(x, "x", true), plot.valToPos(y, "y", true)];
    for (const { points, colour: name, width, dash } of this.paths) {
      ctx.setLineDash((dash || []).map((part) => part * ratio));
      ctx.beginPath();
      for (const [x, y] of points) ctx.lineTo(...at(x, y));
      ctx.strokeStyle = colour(name);
      ctx.lineWidth = width * ratio;
      ctx.stroke();
    }
    ctx.setLineDash([]);
    for (const mark of this.marks) {
      const [x, y] = at(mark.x, mark.y);
      symbol(ctx, mark.kind || "ring", upright ? y : x, upright ? x : y, 5.5 * ratio, colour(mark.colour), colour("card"));
    }
    ctx.restore();
  }

  /** @param {HTMLElement} over */
  #drag(over) {
    /** @param {PointerEvent} event */
    const pick = (event) => {
      const box = over.getBoundingClientRect();
      const across = Math.min(Math.max(event.clientX - box.left, 0), box.width);
      const down = Math.min(Math.max(event.clientY - box.top, 0), box.height);
      const [x, y] = this.options.upright ? [down, across] : [across, down];
      this.onPick(this.plot.posToVal(x, "x"), this.plot.posToVal(y, "y"));
    };
    over.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      over.setPointerCapture(event.pointerId);
      pick(event);
    });
    over.addEventListener("pointermove", (event) => {
      if (event.buttons & 1) pick(event);
    });
  }
}

/** @param {number} start @param {number} stop @param {number[]} dash @returns {[number, number][]} the dashes of a line */
function pieces(start, stop, dash) {
  if (!dash.length) return [[start, stop]];
  /** @type {[number, number][]} */
  const found = [];
  for (let [at, i] = [start, 0]; at < stop; at += dash[i % dash.length], i += 1) {
    if (i % 2 === 0) found.push([at, Math.min(at + dash[i % dash.length], stop)]);
  }
  return found;
}
