// The requests behind a view: their plans, themselves as curl, Python and JSON, jobs, downloads.

import { ask, send } from "./api.js";
import { button, download, make } from "./dom.js";
import { hasInvalid, showError } from "./fields.js";
import { bytes, duration, shown } from "./numbers.js";
import { remember } from "./submitted.js";
import { show, state } from "./state.js";
import { inWords } from "./structures.js";

/**
 * @param {HTMLElement} root
 * @param {() => {title: string, kind: string, request: any}[]} requests those of the current view
 */
export function requestPanel(root, requests) {
  let chosen = 0;
  let form = "plan";
  const tabs = make("div", { class: "row", role: "group", "aria-label": "Request" });
  const forms = make("div", { class: "row", role: "group", "aria-label": "Shown as" });
  const body = make("div");
  const details = make("details", { ontoggle: () => draw() }, make("summary", {}, make("h2", { id: "requests-title" }, "Plan and request")), tabs, forms, body);
  root.append(details);

  function draw() {
    const list = hasInvalid() ? [] : requests();
    root.hidden = list.length === 0;
    if (root.hidden || !details.open) return;
    chosen = Math.min(chosen, list.length - 1);
    const now = list[chosen];
    tabs.replaceChildren(...(list.length < 2 ? [] : list.map((each, i) => button(each.title, () => { chosen = i; draw(); }, { "aria-pressed": String(i === chosen), class: "tab" }))));
    forms.replaceChildren(
      ...[["plan", "Plan"], ["curl", "curl"], ["python", "Python"], ["json", "JSON"]].map(([name, text]) => button(text, () => { form = name; draw(); }, { "aria-pressed": String(name === form), class: "tab" })),
      button("Queue as a job", () => queue(now)),
      button("Download JSON", () => save(now, "application/json", "json")),
      button("Download HDF5", () => save(now, "application/x-hdf5", "h5")),
    );
    if (form === "plan") plan(now);
    else {
      const text = { curl: asCurl, python: asPython, json: asJson }[form] || asJson;
      const code = text(now.kind, now.request);
      body.replaceChildren(make("pre", { tabindex: 0, "aria-label": `The request as ${form}` }, code), button("Copy", () => { navigator.clipboard.writeText(code).catch(showError); }));
    }
  }

  /** @param {{kind: string, request: any}} request */
  async function plan({ kind, request }) {
    try {
      const answer = await ask("POST", `/v1/plan/${kind}`, request);
      if (form === "plan") body.replaceChildren(...planElements(answer));
    } catch (error) {
      body.replaceChildren(make("p", { class: "hint" }, "There is no plan for a request with faults."));
      showError(error);
    }
  }
  return { update: draw };
}

/** @param {any} plan @returns {HTMLElement[]} */
function planElements(plan) {
  const cost = plan.cached ? "The result is stored already." : `About ${duration(plan.seconds)} of computing and ${bytes(plan.bytes)}; ${plan.inline ? "answered at once" : "it becomes a job"}.`;
  /** @param {string[]} head @param {(string | number)[][]} lines */
  const table = (head, lines) => make("div", { class: "scroll", tabindex: 0, role: "group", "aria-label": head[0] },
    make("table", {}, make("thead", {}, make("tr", {}, ...head.map((text) => make("th", { scope: "col" }, text)))),
      make("tbody", {}, ...lines.map((line) => make("tr", {}, ...line.map((text) => make("td", {}, text)))))));
  return [
    make("p", {}, cost),
    table(["Step", "Method", "Reason", "Operations"], plan.steps.map((/** @type {any} */ step) => [step.stage.replaceAll("_", " "), step.method, step.reason, shown(step.flops, 3)])),
    ...(plan.skips.length ? [table(["Not computed", "Why"], plan.skips.map((/** @type {any} */ skip) => [skip.what, skip.why]))] : []),
  ];
}

/** @param {{kind: string, request: any}} request */
async function queue({ kind, request }) {
  try {
    // Other browsers learn of it by this name.
    const name = inWords(state.structure).slice(0, 120);
    const job = await ask("POST", "/v1/jobs", { kind, request, name });
    remember(job.digest, { kind, request, address: location.hash, structure: inWords(state.structure), looked: false, removed: false });
    show("jobs");
  } catch (error) {
    showError(error);
  }
}

/** @param {{kind: string, request: any}} request @param {string} type @param {string} ending */
async function save({ kind, request }, type, ending) {
  try {
    const answer = await send("POST", `/v1/compute/${kind}`, request, { Accept: type, Prefer: "wait=20" });
    if (answer.status === 202) show("jobs");
    else download(`${kind}.${ending}`, await answer.blob());
  } catch (error) {
    showError(error);
  }
}

/** @param {string} kind @param {any} request */
function asJson(kind, request) {
  return JSON.stringify(request, null, 1);
}

/** @param {string} kind @param {any} request */
export function asCurl(kind, request) {
  const text = JSON.stringify(request).replaceAll("'", "'\\''");
  return `curl ${location.origin}/v1/compute/${kind} \\\n  -H 'Content-Type: application/json' \\\n  -H "Authorization: Bearer $VIBROIMPACT_KEY" \\\n  -d '${text}'`;
}

/** @param {string} kind @param {any} request */
export function asPython(kind, request) {
  return `import vibroimpact as vi\n\nclient = vi.Client("${location.origin}")  # key: the environment's VIBROIMPACT_KEY\nresult = client.compute(\n    "${kind}",\n    ${python(request, 4)},\n)\nresult.plot()`;
}

/** @param {any} value @param {number} indent @returns {string} */
function python(value, indent) {
  const pad = " ".repeat(indent + 4);
  if (value === null) return "None";
  if (typeof value === "boolean") return value ? "True" : "False";
  if (typeof value !== "object") return JSON.stringify(value);
  const flat = Array.isArray(value) ? `[${value.map((each) => python(each, indent)).join(", ")}]`
    : `{${Object.entries(value).map(([name, each]) => `${JSON.stringify(name)}: ${python(each, indent)}`).join(", ")}}`;
  if (Array.isArray(value) || flat.length < 70) return flat;
  return `{\n${Object.entries(value).map(([name, each]) => `${pad}${JSON.stringify(name)}: ${python(each, indent + 4)},\n`).join("")}${" ".repeat(indent)}}`;
}
