// A page to be printed, or saved as PDF by the browser: structure, requests, results, errors, digests.

import { button, make } from "./dom.js";
import { copyOf } from "./figure.js";
import { natural } from "./natural.js";
import { shown } from "./numbers.js";
import { state } from "./state.js";
import { coordinateName, inWords } from "./structures.js";

/** What of a view is told in a report; buttons and forms are left out. */
const TOLD = ".cautions, .readout, .verdict, .values, .special";

/**
 * Show the report on what a view shows, instead of the page, until it is closed.
 * @param {{title: string, view: HTMLElement, figures: Element[], result: any, requests: {title: string, kind: string, request: any}[]}} of
 */
export function report({ title, view, figures, result, requests }) {
  const close = () => {
    page.remove();
    document.body.classList.remove("reporting");
  };
  const page = make("main", { id: "report", "aria-label": "Report" },
    make("p", { class: "row unprinted" }, button("Print or save as PDF", () => print(), { class: "primary" }), button("Back to the page", close)),
    make("h1", {}, title),
    make("p", {}, `Vibroimpact ${(document.getElementById("version") || document.body).textContent}, ${new Date().toLocaleString()}`),
    ...structure(), make("h2", {}, "Results"), ...figures, ...motion(view), ...told(view), ...accuracy(result),
    make("h2", {}, "Requests"),
    ...requests.flatMap(({ title: name, kind, request }) => [make("h3", {}, `${name}: POST /v1/compute/${kind}`), make("pre", {}, JSON.stringify(request, null, 1))]),
    make("p", {}, "This view: ", make("code", {}, location.href)));
  document.body.classList.add("reporting");
  document.body.append(page);
  page.tabIndex = -1;
  page.focus();
}

/** @param {string[]} head @param {(string | number)[][]} rows */
function table(head, rows) {
  return make("table", {}, make("thead", {}, make("tr", {}, ...head.map((text) => make("th", { scope: "col" }, text)))),
    make("tbody", {}, ...rows.map((row) => make("tr", {}, ...row.map((text) => make("td", {}, text))))));
}

/** @returns {HTMLElement[]} */
function structure() {
  const { structure: of } = state;
  const known = natural();
  /** @param {number | null} value @param {string} none */
  const or = (value, none) => (value === null || value === undefined ? none : shown(value, 6));
  return [
    make("h2", {}, "Structure"), make("p", {}, `${inWords(of)}.`), ...(of.id ? [make("p", {}, "Stored as ", make("code", {}, of.id))] : []),
    ...(of.stops.length ? [table(["Stop", "Place", "Lower gap", "Upper gap", "Restitution", "Stiffness", "Damping", "Exponent"], of.stops.map((each, i) => [
      i, coordinateName(of, each.dof) + (each.relativeTo === null ? "" : ` relative to ${coordinateName(of, each.relativeTo)}`),
      or(each.lower, "none"), or(each.upper, "none"), each.stiffness === null ? shown(each.restitution, 6) : "–", or(each.stiffness, "rigid"), or(each.damping, "none"), or(each.exponent, each.stiffness === null ? "–" : "1")]))] : []),
    ...(known ? [make("p", {}, `Natural frequencies Ω: ${known.Omega.map((each) => shown(each, 6)).join(", ")}${known.all ? "" : " …"}`)] : []),
  ];
}

/** @param {HTMLElement} view @returns {HTMLElement[]} pictures of the structure in motion */
function motion(view) {
  return [...view.querySelectorAll("canvas.shape")].map((each) => {
    const copy = /** @type {HTMLElement} */ (copyOf(each));
    copy.className = "picture";
    return copy;
  });
}

/** @param {HTMLElement} view @returns {Node[]} */
function told(view) {
  return [...view.querySelectorAll(TOLD)].map((each) => {
    const copy = /** @type {HTMLElement} */ (each.cloneNode(true));
    for (const name of ["id", "aria-live", "role"]) copy.removeAttribute(name);
    copy.querySelectorAll("button").forEach((one) => one.replaceWith(make("span", {}, each.matches(".special") ? one.textContent : "")));
    return copy;
  });
}

/** @param {any} result @returns {HTMLElement[]} what is stated about its errors, and its name */
function accuracy(result) {
  const { error = {}, digest, provenance, complete } = result;
  const largest = Object.entries(error).flatMap(([name, value]) => {
    const numbers = [value].flat(Infinity).filter((each) => typeof each === "number" && Number.isFinite(each));
    return numbers.length ? [[name.replaceAll("_", " "), shown(numbers.reduce((a, b) => Math.max(a, b)), 3)]] : [];
  });
  return [
    make("h2", {}, "Errors"), ...(error.statement ? [make("p", {}, String(error.statement))] : []),
    ...(largest.length ? [table(["Largest error of", "is"], largest)] : []),
    ...(complete === undefined ? [] : [make("p", {}, complete ? "None of this kind can be missing." : "Some of this kind can be missing.")]),
    make("p", {}, "Digest of the result: ", make("code", {}, digest || "–"), ...(provenance && provenance.solver_version ? [`, solvers ${provenance.solver_version}`] : [])),
  ];
}
