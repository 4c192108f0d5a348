// Zoom and pan of a curve by the wheel, by dragging its axes or with Shift, and by buttons.

/** @typedef {"x" | "y"} Scale */
/** @typedef {[number, number]} Range */

/** Milliseconds after a page was scrolled in which the wheel goes on scrolling it over a curve. */
const SCROLLING = 400;
/** A hundredfold of all is as far as values are zoomed out, a millionth as far as anything is zoomed in. */
const [FARTHEST, NEAREST] = [100, 1e-6];

let scrolled = -Infinity;
addEventListener("scroll", () => { scrolled = performance.now(); }, { passive: true });

/** What part of a curve is shown; null: all of it. Views keep it while their curves are drawn anew. */
export class Zoom {
  constructor() {
    /** @type {Range | null} */ this.x = null;
    /** @type {Range | null} */ this.y = null;
    /** @type {() => void} */ this.changed = () => {};
    /** What it is a part of. @type {Record<Scale, string>} */ this.of = { x: "", y: "" };
  }

  /** Forget a part of other axes. @param {Scale} scale @param {string} whole */
  belongsTo(scale, whole) {
    if (this.of[scale] !== whole) this[scale] = null;
    this.of[scale] = whole;
  }
}

/**
 * Return a range widened or narrowed around a value that keeps its place.
 * @param {Range} range @param {number} factor above 1: more is shown @param {number} at @param {boolean} log
 * @returns {Range}
 */
export function scaled(range, factor, at, log) {
  const [low, high, middle] = [...range, at].map((value) => (log ? Math.log(value) : value));
  const ends = [low, high].map((value) => middle + factor * (value - middle));
  return /** @type {Range} */ (log ? ends.map(Math.exp) : ends);
}

/**
 * Return a range moved by a share of its length.
 * @param {Range} range @param {number} share @param {boolean} log
 * @returns {Range}
 */
export function moved(range, share, log) {
  const [low, high] = range.map((value) => (log ? Math.log(value) : value));
  const ends = [low, high].map((value) => value + share * (high - low));
  return /** @type {Range} */ (log ? ends.map(Math.exp) : ends);
}

/**
 * Return a part of the whole: none below a millionth; along x none beyond the whole.
 * @param {Range} part @param {Range} whole @param {Scale} scale @param {boolean} log
 * @returns {Range | null} null: all of it
 */
export function within(part, whole, scale, log) {
  const [a, b, low, high] = [...part, ...whole].map((value) => (log ? Math.log(value) : value));
  if (![a, b].every(Number.isFinite)) return null;
  const [length, all] = [b - a, high - low];
  if (length < NEAREST * all || length > FARTHEST * all) return part[0] < part[1] && length > all ? null : scaled(part, (NEAREST * all) / length, (part[0] + part[1]) / 2, false);
  if (scale === "y") return part;
  if (length >= all * (1 - 1e-9)) return null;
  const shift = a < low ? low - a : b > high ? high - b : 0;
  return shift ? moved(part, shift / length, log) : part;
}

/**
 * Let the wheel and the pointer zoom and pan a curve. Over the curve, the wheel zooms across and, with
 * Shift, upwards; dragging with Shift or the middle button pans. Beside it, both act on that axis.
 * @param {any} plot of uPlot
 * @param {{zoom: (scale: Scale, factor: number, at: number) => void, pan: (scale: Scale, share: number) => void,
 *   reset: () => void, across: Scale, changed: () => boolean}} act across: the scale of the horizontal axis
 */
export function zoomable(plot, { zoom, pan, reset, across, changed }) {
  const { over, root } = plot;
  const upwards = across === "x" ? "y" : "x";
  /** @param {MouseEvent} event @returns {Scale | "both"} */
  const under = (event) => {
    const box = over.getBoundingClientRect();
    if (event.clientX < box.left) return upwards;
    return event.clientY > box.bottom ? across : "both";
  };
  root.addEventListener("wheel", (/** @type {WheelEvent} */ event) => {
    const turn = event.deltaY || event.deltaX;
    // The page scrolls on where it is being scrolled, and where there is nothing more to be seen.
    if (!turn || event.ctrlKey || performance.now() - scrolled < SCROLLING || (turn > 0 && !changed())) return;
    event.preventDefault();
    const place = under(event);
    const scale = place === "both" ? (event.shiftKey ? upwards : across) : place;
    const box = over.getBoundingClientRect();
    const pixels = scale === across ? event.clientX - box.left : event.clientY - box.top;
    zoom(scale, Math.exp(Math.max(-0.4, Math.min(0.4, 0.002 * turn))), plot.posToVal(pixels, scale));
  }, { passive: false });
  /** @type {{place: Scale | "both", x: number, y: number} | null} */
  let dragged = null;
  root.addEventListener("pointerdown", (/** @type {PointerEvent} */ event) => {
    const place = under(event);
    if (place === "both" && !event.shiftKey && event.button !== 1) return;
    event.preventDefault();
    event.stopPropagation();
    dragged = { place, x: event.clientX, y: event.clientY };
    root.setPointerCapture(event.pointerId);
  }, { capture: true });
  root.addEventListener("pointermove", (/** @type {PointerEvent} */ event) => {
    if (!dragged) return;
    event.stopPropagation();
    const box = over.getBoundingClientRect();
    const [right, down] = [(event.clientX - dragged.x) / box.width, (event.clientY - dragged.y) / box.height];
    if (dragged.place !== upwards && right) pan(across, -right);
    if (dragged.place !== across && down) pan(upwards, down);
    Object.assign(dragged, { x: event.clientX, y: event.clientY });
  }, { capture: true });
  for (const name of ["pointerup", "pointercancel"]) root.addEventListener(name, () => { dragged = null; });
  root.addEventListener("dblclick", reset);
}
