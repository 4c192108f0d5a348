// Displays openapi.json, one operation or schema at a time, and sends requests.

import { keep, key } from "./api.js";
import { byId, button, make } from "./dom.js";

/** @typedef {any} Schema */

/** @param {string} label @param {string[]} head @param {(string | Node)[][]} lines */
function table(label, head, lines) {
  return make("div", { class: "scroll", tabindex: 0, role: "group", "aria-label": label },
    make("table", {}, make("thead", {}, make("tr", {}, ...head.map((text) => make("th", { scope: "col" }, text)))),
      make("tbody", {}, ...lines.map((line) => make("tr", {}, ...line.map((content) => make("td", {}, content)))))));
}

/**
 * A type in a few words, named schemas as links.
 * @param {Schema} [schema]
 * @returns {HTMLElement}
 */
function typed(schema = {}) {
  const { $ref, anyOf, oneOf } = schema;
  if ($ref) {
    const name = $ref.split("/").pop();
    return make("a", { href: `#schema/${name}` }, name);
  }
  const parts = anyOf || oneOf;
  if (parts) return make("span", {}, ...parts.flatMap((/** @type {Schema} */ part, /** @type {number} */ i) => [i ? " or " : "", typed(part)]));
  if (schema.enum) return make("span", {}, schema.enum.map((/** @type {any} */ value) => JSON.stringify(value)).join(", "));
  if (schema.const !== undefined) return make("span", {}, JSON.stringify(schema.const));
  if (schema.type === "array") return make("span", {}, "list of ", typed(schema.items));
  return make("span", {}, schema.type || "anything");
}

/** @param {Schema} schema */
function fieldsOf(schema) {
  const needed = new Set(schema.required || []);
  return Object.entries(schema.properties || {}).map(([name, part]) => [
    make("code", {}, name), make("span", {}, typed(part), needed.has(name) ? "" : ", optional"), part.description || "",
  ]);
}

/** @param {string} name @param {Schema} schema */
function schemaElements(name, schema) {
  const rows = fieldsOf(schema);
  return [make("h2", {}, name), make("p", {}, schema.description || ""), rows.length ? table(`Fields of ${name}`, ["Field", "Type", "Meaning"], rows) : make("p", {}, typed(schema))];
}

/**
 * The form that sends a request of an operation and shows the answer.
 * @param {string} method
 * @param {string} path
 * @param {any} about
 */
function tryIt(method, path, about) {
  const parameters = (about.parameters || []).map((/** @type {any} */ parameter, /** @type {number} */ i) => {
    const input = make("input", { id: `parameter-${i}`, placeholder: parameter.example || (parameter.schema && parameter.schema.default) || "", required: parameter.required });
    return { parameter, input, field: make("div", { class: "field" }, make("label", { for: input.id }, `${parameter.name} (${parameter.in})`), input) };
  });
  const contents = Object.entries((about.requestBody || {}).content || {});
  const body = make("textarea", { id: "body", rows: 12, spellcheck: "false" });
  let media = contents.length ? contents[0][0] : "";
  /** @type {[string, string, any][]} */
  const examples = contents.flatMap(([type, content]) => Object.values(content.examples || {}).map((/** @type {any} */ example) => /** @type {[string, string, any]} */ ([type, example.summary, example.value])));
  /** @param {number} index */
  const fill = (index) => {
    const [type, , value] = examples[index];
    media = type;
    body.value = typeof value === "string" ? value : JSON.stringify(value, null, 1);
  };
  const choice = make("select", { id: "example", onchange: () => fill(Number(choice.value)) }, ...examples.map(([, summary], i) => make("option", { value: i }, summary)));
  if (examples.length) fill(0);
  const answer = make("div", { "aria-live": "polite" });
  async function sendIt() {
    let address = path;
    const query = new URLSearchParams();
    /** @type {Record<string, string>} */
    const headers = key() ? { Authorization: `Bearer ${key()}` } : {};
    for (const { parameter, input } of parameters) {
      if (!input.value) continue;
      if (parameter.in === "path") address = address.replace(`{${parameter.name}}`, encodeURIComponent(input.value));
      else if (parameter.in === "query") query.set(parameter.name, input.value);
      else headers[parameter.name] = input.value;
    }
    if (contents.length) headers["Content-Type"] = media;
    const began = performance.now();
    answer.replaceChildren(make("p", {}, "sending …"));
    try {
      const got = await fetch(query.size ? `${address}?${query}` : address, { method, headers, body: contents.length ? body.value : undefined });
      const text = got.headers.get("content-type")?.includes("hdf5") ? "(HDF5)" : await got.text();
      answer.replaceChildren(
        make("p", {}, make("strong", { class: got.ok ? "good" : "bad" }, `${got.status} ${got.statusText}`), ` in ${Math.round(performance.now() - began)} ms`),
        make("details", {}, make("summary", {}, "Headers"), make("pre", { tabindex: 0, "aria-label": "Headers of the answer" }, [...got.headers].map(([name, value]) => `${name}: ${value}`).join("\n"))),
        make("pre", { tabindex: 0, "aria-label": "Body of the answer" }, readable(text)));
    } catch (error) {
      answer.replaceChildren(make("p", { class: "bad" }, String(error)));
    }
  }
  return [
    make("h3", {}, "Try it"), make("div", { class: "toolbar" }, ...parameters.map((/** @type {any} */ each) => each.field)),
    ...(examples.length > 1 ? [make("div", { class: "field" }, make("label", { for: "example" }, "Example"), choice)] : []),
    ...(contents.length ? [make("div", { class: "field" }, make("label", { for: "body" }, "Body"), body)] : []),
    make("p", { class: "row" }, button("Send", sendIt, { class: "primary" })), answer,
  ];
}

/** @param {string} text */
function readable(text) {
  const most = 30_000;
  let shown = text;
  try {
    shown = JSON.stringify(JSON.parse(text), null, 1);
  } catch { /* it is no JSON: shown as it is */ }
  return shown.length > most ? `${shown.slice(0, most)}\n… ${shown.length - most} more characters` : shown;
}

/** @param {string} method @param {string} path @param {any} about */
function operationElements(method, path, about) {
  const scope = about.security && about.security[0] && about.security[0].key;
  const answers = Object.entries(about.responses).map(([status, answer]) => [
    status, answer.description, make("span", {}, ...Object.entries(answer.content || {}).flatMap(([type, content], i) => [i ? "; " : "", `${type}: `, typed(content.schema)])),
  ]);
  const bodies = Object.entries((about.requestBody || {}).content || {}).map(([type, content]) => make("p", {}, `Body ${type}: `, typed(content.schema)));
  return [
    make("h2", {}, make("span", { class: "method" }, method.toUpperCase()), ` ${path}`), make("p", {}, `${about.summary}. ${about.description || ""}`),
    ...(scope ? [make("p", { class: "hint" }, `Scope of the key: ${scope.join(", ")}`)] : []),
    ...(about.parameters ? [table("Parameters", ["Parameter", "Where", "Type", "Meaning"], about.parameters.map((/** @type {any} */ p) => [make("code", {}, p.name), p.in, typed(p.schema), p.description || ""]))] : []),
    ...bodies, ...tryIt(method.toUpperCase(), path, about),
    make("h3", {}, "Answers"), table("Answers", ["Status", "Meaning", "Content"], answers),
  ];
}

const keyInput = /** @type {HTMLInputElement} */ (byId("key"));
keyInput.value = key();
keyInput.addEventListener("change", () => keep(keyInput.value.trim()));
const contract = await (await fetch("/openapi.json")).json();
byId("about").textContent = `${contract.info.title} ${contract.info.version}. ${contract.info.description}`;

/** @type {Map<string, {title: string, group: string, elements: () => HTMLElement[]}>} */
const entries = new Map();
for (const [path, methods] of Object.entries(contract.paths)) {
  for (const [method, about] of Object.entries(methods)) {
    entries.set(about.operationId, { title: `${method.toUpperCase()} ${path}`, group: (about.tags || [""])[0], elements: () => operationElements(method, path, about) });
  }
}
for (const [name, schema] of Object.entries(contract.components.schemas)) {
  entries.set(`schema/${name}`, { title: name, group: "schemas", elements: () => schemaElements(name, schema) });
}

function list() {
  const words = /** @type {HTMLInputElement} */ (byId("search")).value.toLowerCase();
  /** @type {Map<string, HTMLElement[]>} */
  const groups = new Map();
  for (const [name, { title, group }] of entries) {
    if (!`${title} ${name}`.toLowerCase().includes(words)) continue;
    const link = make("a", { href: `#${name}`, "aria-current": location.hash.slice(1) === name ? "true" : null }, title);
    groups.set(group, [...(groups.get(group) || []), make("li", {}, link)]);
  }
  byId("contents").replaceChildren(...[...groups].map(([group, links]) => make("details", { open: group !== "schemas" || words !== "" || location.hash.startsWith("#schema") }, make("summary", {}, group), make("ul", {}, ...links))));
}

function open() {
  const entry = entries.get(decodeURIComponent(location.hash.slice(1))) || entries.get("compute_impact_modes") || [...entries.values()][0];
  byId("operation").replaceChildren(...entry.elements());
  document.title = `${entry.title} – Vibroimpact`;
  list();
}

byId("search").addEventListener("input", list);
addEventListener("hashchange", () => {
  open();
  byId("operation").focus();
});
open();
