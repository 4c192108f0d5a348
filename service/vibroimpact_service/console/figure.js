// A curve as SVG, PNG and numbers: what leaves the page, stands beside another one, or is printed.

import { make } from "./dom.js";
import { symbol } from "./symbols.js";
import { colour } from "./theme.js";
import { linearTicks, logTicks } from "./ticks.js";

/** @typedef {import("./curve.js").Curve} Curve */

const SVG = "http://www.w3.org/2000/svg";
const FONT = "12px system-ui, sans-serif";
/** Height of the line of text below a picture. */
const CAPTION = 24;

/**
 * @param {string} tag @param {Record<string, string | number>} attributes @param {...(Node | string)} children
 * @returns {SVGElement}
 */
function draw(tag, attributes, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...children);
  return element;
}

/** @param {number} x @returns {number} to a hundredth of a pixel */
function near(x) {
  return Math.round(100 * x) / 100;
}

/** As much of a canvas as `symbol` draws on. */
class Pen {
  /** @param {SVGElement} into */
  constructor(into) {
    this.into = into;
    this.path = "";
    this.strokeStyle = this.fillStyle = "";
    this.lineWidth = 1;
  }

  beginPath() { this.path = ""; }

  /** @param {number} x @param {number} y */
  moveTo(x, y) { this.path += `M${near(x)} ${near(y)}`; }

  /** @param {number} x @param {number} y */
  lineTo(x, y) { this.path += `L${near(x)} ${near(y)}`; }

  closePath() { this.path += "Z"; }

  /** @param {number} x @param {number} y @param {number} radius */
  arc(x, y, radius) { this.path += `M${near(x - radius)} ${near(y)}a${radius} ${radius} 0 1 0 ${2 * radius} 0a${radius} ${radius} 0 1 0 ${-2 * radius} 0Z`; }

  fill() { this.into.append(draw("path", { d: this.path, fill: this.fillStyle })); }

  stroke() { this.into.append(draw("path", { d: this.path, fill: "none", stroke: this.strokeStyle, "stroke-width": this.lineWidth })); }
}

/**
 * Return a curve, as it is shown, as an SVG.
 * @param {Curve} curve
 * @param {string} caption
 * @returns {SVGElement}
 */
export function svgOf(curve, caption) {
  const { plot, options } = curve;
  const ratio = devicePixelRatio || 1;
  const [left, top, width, height] = [plot.bbox.left, plot.bbox.top, plot.bbox.width, plot.bbox.height].map((value) => value / ratio);
  const upright = Boolean(options.upright);
  /** @param {number} x @param {number} y @returns {[number, number]} */
  const at = (x, y) => {
    const [a, b] = [plot.valToPos(x, "x"), plot.valToPos(y, "y")];
    return upright ? [left + b, top + a] : [left + a, top + b];
  };
  const clip = `clip-${Math.random().toString(36).slice(2)}`;
  const root = draw("svg", { xmlns: SVG, viewBox: `0 0 ${plot.width} ${plot.height + CAPTION}`, width: plot.width, height: plot.height + CAPTION, "font-family": "system-ui, sans-serif", "font-size": 12, role: "img", "aria-label": options.label });
  const inside = draw("g", { "clip-path": `url(#${clip})` });
  root.append(draw("rect", { width: "100%", height: "100%", fill: colour("card") }),
    draw("clipPath", { id: clip }, draw("rect", { x: left, y: top, width, height })), inside);
  if (curve.image) image(curve, inside, at);
  for (const band of curve.bands) {
    const [a, b] = [band.start, band.stop].map((x) => Math.min(Math.max(at(x, 0)[0], left), left + width));
    if (!(b >= a)) continue;
    const [y, tall] = band.row === undefined ? [top, height] : [top + height + 3 + 8 * band.row, 6];
    if (band.dash && band.dash.length) root.append(draw("line", { x1: a, x2: b, y1: y + tall / 2, y2: y + tall / 2, stroke: colour(band.colour), "stroke-width": tall, "stroke-dasharray": band.dash.join(" ") }));
    else root.append(draw("rect", { x: a, y, width: Math.max(b - a, 0.7), height: tall, fill: colour(band.colour), "fill-opacity": band.row === undefined ? 0.13 : 1 }));
  }
  axes(curve, root, { left, top, width, height }, at);
  /** @param {[number, number][][]} parts @param {string} name @param {number} thick @param {number[]} [dash] */
  const line = (parts, name, thick, dash = []) => {
    const d = parts.filter((part) => part.length > 1).map((part) => `M${part.map(([x, y]) => `${near(x)} ${near(y)}`).join("L")}`).join("");
    if (d) inside.append(draw("path", { d, fill: "none", stroke: colour(name), "stroke-width": thick, ...(dash.length ? { "stroke-dasharray": dash.join(" ") } : {}) }));
  };
  const [[low, high], [least, most]] = [curve.part("x"), curve.part("y")];
  for (const each of curve.levels) line([[at(low, each.at), at(high, each.at)]], each.colour, each.width || 1, each.dash);
  for (const each of curve.lines) line([[at(each.at, least), at(each.at, most)]], each.colour, each.width || 1, each.dash);
  options.series.forEach((series, i) => {
    /** @type {[number, number][][]} */
    const parts = [[]];
    curve.data[0].forEach((x, j) => {
      const y = (curve.data[i + 1] || [])[j];
      if (y === null || y === undefined || x === null) parts.push([]);
      else parts[parts.length - 1].push(at(x, y));
    });
    if (series.width !== 0) line(parts, series.colour, series.width || 2, series.dash);
    if (series.points) for (const [x, y] of parts.flat()) inside.append(draw("circle", { cx: near(x), cy: near(y), r: series.points / 2, fill: colour(series.open ? "card" : series.colour), stroke: colour(series.colour) }));
  });
  for (const each of curve.paths) line([each.points.map(([x, y]) => at(x, y))], each.colour, each.width, each.dash);
  const pen = new Pen(inside);
  for (const { x, y, kind, colour: name } of curve.marks) symbol(/** @type {any} */ (pen), kind || "ring", ...at(x, y), 5.5, colour(name), colour("card"));
  root.append(draw("text", { x: 8, y: plot.height + CAPTION - 8, fill: colour("soft"), "font-size": 11 }, caption));
  return root;
}

/** @param {Curve} curve @param {SVGElement} into @param {(x: number, y: number) => [number, number]} at */
function image(curve, into, at) {
  const [[x0, x1], [y0, y1]] = [curve.whole("x"), curve.whole("y")];
  const [[a, b], [c, d]] = [at(x0, y1), at(x1, y0)];
  into.append(draw("image", { x: a, y: b, width: c - a, height: d - b, preserveAspectRatio: "none", "image-rendering": "pixelated", "data-href": /** @type {HTMLCanvasElement} */ (curve.image).toDataURL() }));
}

/** @param {Curve} curve @param {SVGElement} root @param {{left: number, top: number, width: number, height: number}} box @param {(x: number, y: number) => [number, number]} at */
function axes(curve, root, { left, top, width, height }, at) {
  const { options } = curve;
  const [soft, rule] = [colour("soft"), colour("line")];
  const below = 8 * (options.strip || 0);
  for (const scale of /** @type {const} */ (["x", "y"])) {
    const upwards = (scale === "y") !== Boolean(options.upright);
    const [low, high] = curve.part(scale);
    const ticks = scale === "y" && options.log ? logTicks(low, high, upwards ? height / 26 : width / 56) : linearTicks(low, high, upwards ? height / 40 : width / 64);
    const written = curve.written(scale);
    for (const value of ticks) {
      const [x, y] = scale === "x" ? at(value, curve.part("y")[0]) : at(curve.part("x")[0], value);
      root.append(upwards ? draw("path", { d: `M${left} ${near(y)}h${width}`, stroke: rule, "stroke-width": 0.6 }) : draw("path", { d: `M${near(x)} ${top}v${height}`, stroke: rule, "stroke-width": 0.6 }),
        upwards ? draw("text", { x: left - 8, y: near(y) + 4, fill: soft, "text-anchor": "end" }, written(value)) : draw("text", { x: near(x), y: top + height + 18 + below, fill: soft, "text-anchor": "middle" }, written(value)));
    }
    root.append(upwards ? draw("text", { transform: `translate(14 ${top + height / 2}) rotate(-90)`, fill: soft, "text-anchor": "middle" }, curve.named(scale))
      : draw("text", { x: left + width / 2, y: top + height + 38 + below, fill: soft, "text-anchor": "middle" }, curve.named(scale)));
  }
}

/** @param {SVGElement} svg @returns {Blob} */
export function svgFile(svg) {
  // The page would load an image of an SVG as soon as it is one, which it is not permitted.
  return new Blob([new XMLSerializer().serializeToString(svg).replaceAll("data-href=", "href=")], { type: "image/svg+xml" });
}

/** @param {Curve} curve @param {string} caption @returns {HTMLCanvasElement} what is shown, with a line of text below */
function canvasOf(curve, caption) {
  const ratio = devicePixelRatio || 1;
  const source = /** @type {HTMLCanvasElement} */ (curve.plot.ctx.canvas);
  const canvas = make("canvas", { width: source.width, height: source.height + CAPTION * ratio, class: "picture", role: "img", "aria-label": curve.options.label });
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.fillStyle = colour("card");
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.drawImage(source, 0, 0);
  context.scale(ratio, ratio);
  context.font = FONT;
  context.fillStyle = colour("soft");
  context.fillText(caption, 8, canvas.height / ratio - 8);
  return canvas;
}

/** @param {Curve} curve @param {string} caption @returns {Promise<Blob>} */
export function pngFile(curve, caption) {
  return new Promise((resolve, reject) => { canvasOf(curve, caption).toBlob((blob) => (blob ? resolve(blob) : reject(new Error("The browser makes no picture of this size."))), "image/png"); });
}

/**
 * Return a curve as it is shown, to stand in the page: images within an SVG are not permitted there.
 * @param {Curve} curve @param {string} caption @returns {Element}
 */
export function standing(curve, caption) {
  return curve.image ? canvasOf(curve, caption) : svgOf(curve, caption);
}

/** @param {Element} picture an SVG or a canvas @returns {Element} */
export function copyOf(picture) {
  const copy = /** @type {Element} */ (picture.cloneNode(true));
  if (picture instanceof HTMLCanvasElement && copy instanceof HTMLCanvasElement && picture.width) {
    /** @type {CanvasRenderingContext2D} */ (copy.getContext("2d")).drawImage(picture, 0, 0);
  }
  return copy;
}

/** @param {(string | number | null)[][]} rows @returns {string} */
export function csv(rows) {
  /** @param {string | number | null} value */
  const cell = (value) => (typeof value === "string" && /[",\n]/.test(value) ? `"${value.replaceAll("\"", "\"\"")}"` : value === null ? "" : String(value));
  return `${rows.map((row) => row.map(cell).join(",")).join("\r\n")}\r\n`;
}

/**
 * Return the numbers of a curve: a column for each series, and below them the points of its lines.
 * @param {Curve} curve
 */
export function numbersOf({ data, options, paths, marks, values }) {
  if (values) return csv([[options.x, options.y, values.label], ...values.rows]);
  const series = options.series.map(({ label }, i) => ({ label, list: data[i + 1] || [] })).filter(({ list }) => list.some((value) => value !== null));
  if (!paths.length) return csv([[options.x, ...series.map(({ label }) => label)], ...data[0].map((x, j) => [x, ...series.map(({ list }) => list[j] ?? null)])]);
  return csv([["line", options.x, options.y],
    ...series.flatMap(({ label, list }) => data[0].flatMap((x, j) => (list[j] === null || list[j] === undefined ? [] : [[label, x, list[j]]]))),
    ...paths.flatMap(({ points, label = "" }, i) => points.map(([x, y]) => [`line ${i + 1}${label && ` (${label})`}`, x, y])),
    ...marks.map(({ x, y, kind = "point" }) => [kind, x, y])]);
}
