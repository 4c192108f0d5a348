// Below each curve: buttons that zoom, the range of its values, its files, and a copy to compare with.

import { numbersOf, pngFile, svgFile, svgOf } from "./figure.js";
import { button, download, make } from "./dom.js";
import { numberField, showError } from "./fields.js";

/** @typedef {import("./curve.js").Curve} Curve */

const STEP = 1.5;

/**
 * @param {{name: string, curve: () => Curve | null, caption: () => string, keep: () => void, report: () => void,
 *   compute?: (from: number, to: number) => void}} options compute: anew in the range that is shown
 */
export function plotTools({ name, curve, caption, keep, report, compute }) {
  /** @param {(curve: Curve) => void | Promise<void>} work */
  const act = (work) => async () => {
    const now = curve();
    if (!now || !now.plot) return;
    try {
      await work(now);
    } catch (error) {
      showError(error);
    }
  };
  /** @param {string} text @param {string} title @param {(curve: Curve) => void | Promise<void>} work */
  const tool = (text, title, work) => button(text, act(work), { class: "quiet", title, "aria-label": title });
  const again = button("Compute this range anew", act((now) => {
    const [from, to] = now.part("x").map((value) => Number(value.toPrecision(6)));
    if (compute) compute(from, to);
  }), { hidden: true });
  const range = make("span", { class: "range" });
  /** Ends of the values that are shown, as far as they are given. @type {[number | null, number | null]} */
  const ends = [null, null];
  /** @param {0 | 1} end */
  const limit = (end) => (/** @type {number | null} */ value) => {
    ends[end] = value;
    const now = curve();
    if (!now) return;
    const [low, high] = [0, 1].map((i) => ends[i] ?? now.whole("y")[i]);
    if (ends.every((each) => each === null)) now.limit("y", null);
    else if (low < high && !(now.options.log && low <= 0)) now.limit("y", [low, high]);
    else showError(new Error("The lower end of the values is not below the upper one."));
  };
  range.append(numberField("Values from", null, limit(0), { empty: "all", name: "y-from" }), numberField("values to", null, limit(1), { empty: "all", name: "y-to" }));
  const element = make("details", { class: "tools" },
    make("summary", {}, "Zoom, save, compare, report"),
    make("div", { class: "row", role: "group", "aria-label": "Zoom" },
      tool("+", "Zoom in", (now) => now.enlarge("x", 1 / STEP)), tool("−", "Zoom out", (now) => now.enlarge("x", STEP)),
      tool("◀", "Move to the left", (now) => now.move("x", -0.25)), tool("▶", "Move to the right", (now) => now.move("x", 0.25)),
      tool("All", "Show all of it", (now) => {
        range.querySelectorAll("input").forEach((input) => { input.value = ""; });
        ends.fill(null);
        now.all();
      }), again, range),
    make("p", { class: "hint" }, "The wheel zooms, with Shift the values; dragging an axis, or with Shift the curve, moves what is shown; a double click shows all."),
    make("div", { class: "row", role: "group", "aria-label": "Save and compare" },
      tool("PNG", "Save as PNG", async (now) => download(`${name}.png`, await pngFile(now, caption()))),
      tool("SVG", "Save as SVG", (now) => download(`${name}.svg`, svgFile(svgOf(now, caption())))),
      tool("CSV", "Save the numbers as CSV", (now) => download(`${name}.csv`, new Blob([`# ${caption()}\r\n`, numbersOf(now)], { type: "text/csv" }))),
      tool("Keep beside", "Keep this beside the next one", keep), tool("Report", "Report to print or to save as PDF", report)));
  /** What is shown has changed. */
  function update() {
    const now = curve();
    again.hidden = !compute || !now || now.zoom.x === null;
  }
  return { element, update };
}
