// Fields of forms: numbers and choices, and the faults that the service finds in them.

import { Away, Problem } from "./api.js";
import { byId, make } from "./dom.js";

let count = 0;

/**
 * Return a labelled number. Pointers are those of the requests that it becomes part of.
 * @param {string} label
 * @param {number | null} value null: empty
 * @param {(value: number | null) => void} onInput called with valid numbers, and with null where it may be empty
 * @param {{pointer?: string, whole?: boolean, min?: number, max?: number, empty?: string, name?: string}} [options]
 */
export function numberField(label, value, onInput, { pointer, whole, min, max, empty, name } = {}) {
  count += 1;
  const input = make("input", {
    id: `field-${count}`, type: "number", step: whole ? 1 : "any", min, max, name, "data-pointer": pointer,
    placeholder: empty, required: empty === undefined, inputmode: whole ? "numeric" : "decimal",
  });
  input.value = value === null ? "" : String(value);
  const note = make("span", { class: "fault", id: `fault-${count}` });
  input.addEventListener("input", () => {
    clearFault(input);
    const valid = input.checkValidity();
    dispatchEvent(new Event("input-checked"));
    if (!valid) {
      tellFault(input, input.validationMessage);
      return;
    }
    if (input.value === "") {
      if (empty !== undefined) onInput(null);
    } else onInput(Number(input.value));
  });
  const field = make("div", { class: "field" }, make("label", { for: input.id }, label), input, note);
  // A number of the address can be wrong, too.
  if (!input.checkValidity()) tellFault(input, input.validationMessage);
  return field;
}

/**
 * Return a labelled choice.
 * @param {string} label
 * @param {[string, string][]} choices value, label
 * @param {string} value
 * @param {(value: string) => void} onChange
 * @param {{pointer?: string, name?: string}} [options]
 */
export function choiceField(label, choices, value, onChange, { pointer, name } = {}) {
  count += 1;
  const select = make("select", { id: `field-${count}`, "data-pointer": pointer, name },
    ...choices.map(([each, text]) => make("option", { value: each, selected: each === value }, text)));
  select.addEventListener("change", () => {
    clearFault(select);
    onChange(select.value);
  });
  return make("div", { class: "field" }, make("label", { for: select.id }, label), select, make("span", { class: "fault", id: `fault-${count}` }));
}

/**
 * Return a labelled switch.
 * @param {string} label
 * @param {boolean} value
 * @param {(value: boolean) => void} onChange
 * @param {{name?: string}} [options]
 */
export function switchField(label, value, onChange, { name } = {}) {
  const input = make("input", { type: "checkbox", name, onchange: () => onChange(input.checked) });
  input.checked = value;
  return make("label", { class: "switch" }, input, ` ${label}`);
}

/** @returns {boolean} whether a field of the structure or of the view has no valid value */
export function hasInvalid() {
  return document.querySelector("#structure input:invalid, #view input:invalid") !== null;
}

/** @param {Element} field @returns {Element | null | undefined} where its faults are written: beside an input, at the end of a group */
function noteOf(field) {
  if (!field.matches("input, select, textarea")) return [...field.querySelectorAll(".fault")].pop();
  return field.parentElement && field.parentElement.querySelector(".fault");
}

/** @param {Element} field */
function clearFault(field) {
  field.removeAttribute("aria-invalid");
  field.removeAttribute("aria-describedby");
  const note = noteOf(field);
  if (note) note.textContent = "";
}

export function clearFaults() {
  document.querySelectorAll("[aria-invalid]").forEach(clearFault);
  byId("message").textContent = "";
}

/**
 * Show an error: faults at the fields they belong to, the rest as a message.
 * @param {unknown} error
 */
export function showError(error) {
  if (error instanceof DOMException && error.name === "AbortError") return;
  const place = byId("message");
  if (error instanceof Away) {
    place.textContent = "";
    byId("away").hidden = false;
    dispatchEvent(new Event("service-away"));
    return;
  }
  if (!(error instanceof Problem)) {
    place.textContent = error instanceof Error ? error.message : String(error);
    console.warn(error);
    return;
  }
  if (error.status === 401) /** @type {HTMLDetailsElement} */ (byId("key-box")).open = true;
  const rest = error.faults.filter((fault) => !markFault(fault));
  const lines = rest.map((fault) => `${fault.parameter || fault.pointer || "request"}: ${fault.message}`);
  const text = error.faults.length ? lines : [error.message];
  place.textContent = [...new Set(text)].join(" · ");
  if (error.status === 404 && !error.faults.length) place.textContent += " A stored structure belongs to the key that stored it.";
}

/** @param {import("./api.js").Fault} fault @returns {boolean} whether there is a field that it belongs to */
function markFault(fault) {
  const pointer = (fault.pointer || "").replace(/^(\/request)?(\/base)?(?=\/)/, "");
  /** @type {HTMLElement[]} */
  const fields = [...document.querySelectorAll("[data-pointer]")].map((each) => /** @type {HTMLElement} */ (each));
  const box = byId("structure-box");
  if (pointer.startsWith("/system")) box.setAttribute("open", "");
  const visible = fields.filter((field) => field.offsetParent !== null);
  const field = visible.filter((each) => within(pointer, each.dataset.pointer || "")).sort((a, b) => (b.dataset.pointer || "").length - (a.dataset.pointer || "").length)[0]
    || (pointer.length > 1 ? visible.find((each) => within(each.dataset.pointer || "", pointer) && pointer.split("/").length > 2) : undefined);
  return field !== undefined && tellFault(field, fault.message);
}

/** Write what is wrong with a field. @param {Element} field @param {string} message @returns {boolean} whether there is a place for it */
function tellFault(field, message) {
  const note = noteOf(field);
  if (!note) return false;
  field.setAttribute("aria-invalid", "true");
  field.setAttribute("aria-describedby", note.id);
  note.textContent = message;
  return true;
}

/** @param {string} inner @param {string} outer */
function within(inner, outer) {
  return outer !== "" && (inner === outer || inner.startsWith(`${outer}/`));
}
