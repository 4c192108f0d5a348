// The form in which a structure is entered, with its drawing.

import { ask, send } from "./api.js";
import { button, make, settled } from "./dom.js";
import { choiceField, clearFaults, numberField, showError, switchField } from "./fields.js";
import { exampleField } from "./examples.js";
import { ENDINGS, structureOf } from "./files.js";
import { help } from "./help.js";
import { matrixEditor } from "./matrix_editor.js";
import { natural } from "./natural.js";
import { shown } from "./numbers.js";
import { Shape } from "./shape.js";
import { dampingSlider, gapSlider, restitutionSlider } from "./sliders.js";
import { setStructure, show, state } from "./state.js";
import { FORMS, HERTZ, SQUARE, beamIn, coordinateName, geometryOf, isSoft, lawOf, leading, measure, preset, size, stop } from "./structures.js";
import { onTheme, shapeColours } from "./theme.js";
import { UNITS, inSeconds, labelled, stiffnessLabel } from "./units.js";

/** @typedef {import("./structures.js").Structure} Structure */

const changed = settled(200, () => {
  clearFaults();
  setStructure(state.structure);
});

/** @param {HTMLElement} root */
export function structurePanel(root) {
  const canvas = make("canvas", { class: "still", role: "img" });
  const hint = make("p", { class: "hint" }, "Click a coordinate to place a stop there, or to remove it. Coordinates count from 0, masses and nodes from 1.");
  const modes = make("details", { class: "natural" });
  /** @type {Shape | null} */
  let shape = null;

  function drawStill() {
    const n = size(state.structure);
    if (!n || n > 5000) return;
    const geometry = geometryOf(state.structure);
    shape = new Shape(canvas, geometry, state.structure.stops.filter((each) => each.dof < n && (each.relativeTo || 0) < n), shapeColours());
    shape.fit([]);
    shape.envelope = null;
    shape.draw(new Float64Array(n));
    const stops = state.structure.stops.map((each) => each.dof).join(", ");
    canvas.setAttribute("aria-label", `Structure with ${n} degrees of freedom at rest; stops at ${stops || "none"}.`);
  }

  canvas.addEventListener("click", (event) => {
    const dof = shape ? shape.at(event.offsetX, event.offsetY) : -1;
    if (dof >= 0) toggleStop(dof);
  });

  function toggleStop(/** @type {number} */ dof) {
    const { stops } = state.structure;
    const there = stops.findIndex((each) => each.dof === dof);
    if (there >= 0) stops.splice(there, 1);
    else {
      const last = stops[stops.length - 1];
      stops.push(last ? { ...last, dof, relativeTo: null, active: true } : stop(dof, 1, 1));
    }
    rebuild();
    changed();
  }

  function rebuild() {
    root.replaceChildren(
      exampleField(({ view, structure, fields }) => {
        state.structure = structure();
        show(view, { ...fields });
        dispatchEvent(new Event("structure-filled"));
      }),
      choiceField("Structure", Object.entries(FORMS).filter(([form]) => form !== "stored" || state.structure.form === "stored").map(([form, { label }]) => [form, label]),
        state.structure.form, (form) => { clearFaults(); setStructure(preset(form), {}); }, { name: "form" }),
      upload(),
      canvas, hint, modes,
      parameters(), stops(toggleStop, rebuild), loads(rebuild),
    );
    drawStill();
    listModes();
  }

  /** List the natural frequencies, as far as they are known. */
  function listModes() {
    const known = natural();
    modes.hidden = !known;
    if (!known) return;
    const { Omega, all } = known;
    const last = Omega[Omega.length - 1];
    const cycles = inSeconds() ? "Hz" : "Ω/2π";
    modes.replaceChildren(
      make("summary", {}, "Natural frequencies ", make("span", { class: "hint" }, Omega.length === 1 ? `Ω₁ = ${shown(Omega[0], 4)}` : `${shown(Omega[0], 4)} to ${shown(last, 4)}${all ? "" : " …"}`)),
      make("table", {}, make("thead", {}, make("tr", {}, ...["", "Ω", cycles].map((text) => make("th", { scope: "col" }, text)))),
        make("tbody", {}, ...Omega.map((each, j) => make("tr", {}, make("th", { scope: "row" }, String(j + 1)), make("td", {}, shown(each, 5)), make("td", {}, shown(each / (2 * Math.PI), 5)))))));
  }

  new ResizeObserver(drawStill).observe(canvas);
  onTheme(drawStill);
  rebuild();
  return { rebuild, drawStill, listModes };
}

function parameters() {
  const { structure } = state;
  const about = FORMS[structure.form];
  const box = make("div", { class: "fields" });
  const units = structure.matrices && !structure.matrices.units ? [unitsField()] : [];
  if (structure.form === "stored") {
    const text = `${structure.name || "structure"}: ${size(structure) || "…"} degrees of freedom`;
    const force = structure.matrices && structure.matrices.force;
    box.append(make("p", { class: "hint" }, text), geometryUpload(), ...units, ...(force && force.some(Boolean) ? [make("p", { class: "hint" }, "The file has a constant load; those below are added.")] : []), ...dampingField(structure, changed));
    return box;
  }
  if (structure.form === "matrices") box.append(matrixEditor(structure, changed), ...units);
  for (const { label, name, whole, min, max } of about.parameters) {
    box.append(numberField(label, structure.parameters[name], (value) => {
      structure.parameters[name] = /** @type {number} */ (value);
      changed();
    }, { pointer: `/system/${name}`, whole, min, max, name }));
  }
  box.append(...dampingField(structure, changed));
  return box;
}

/** @param {import("./structures.js").Structure} structure @param {() => void} changed @returns {HTMLElement[]} a field for the damping ratio, where there is no other damping */
function dampingField(structure, changed) {
  if (!FORMS[structure.form].damped || (structure.matrices && structure.matrices.C)) return [];
  const pointer = structure.form === "stored" || structure.form === "matrices" ? "/system/damping" : "/system/C";
  const field = numberField("Damping ratio ζ", structure.damping, (value) => {
    structure.damping = /** @type {number} */ (value);
    changed();
  }, { pointer, min: 0, name: "zeta" });
  field.append(dampingSlider(field, changed));
  return [field];
}

/** @param {(dof: number) => void} toggleStop @param {() => void} rebuild */
function stops(toggleStop, rebuild) {
  const { structure } = state;
  const box = make("fieldset", { class: "stops", "data-pointer": "/system/constraints", tabindex: -1 }, make("legend", {}, "Stops"));
  structure.stops.forEach((each, index) => {
    const at = `/system/constraints/${index}`;
    /** @param {"dof" | "relativeTo" | "lower" | "upper" | "restitution" | "stiffness" | "damping" | "exponent"} name */
    const set = (name) => (/** @type {number | null} */ value) => {
      /** @type {any} */ (each)[name] = value;
      changed();
      if (name === "exponent") choose();
    };
    const lower = numberField(labelled("Lower gap", measure(structure, each.dof)), each.lower, set("lower"), { pointer: `${at}/gap/lower`, empty: "none" });
    const upper = numberField(labelled("Upper gap", measure(structure, each.dof)), each.upper, set("upper"), { pointer: `${at}/gap`, empty: "none" });
    const restitution = numberField("Restitution", each.restitution, set("restitution"), { pointer: `${at}/restitution`, min: 0, max: 1 });
    restitution.append(restitutionSlider(index, restitution, changed));
    // With a stiffness, which time histories, ensembles and periodic motions take, there is a damping instead.
    const damping = numberField(labelled("Stop damping", "dashpot"), each.damping, set("damping"), { pointer: `${at}/law/damping`, min: 0, empty: "none" });
    // Time histories and ensembles also take forces that grow with a power of the indentation, without loss.
    const exponent = numberField("Exponent", each.exponent ?? SQUARE, set("exponent"), { pointer: `${at}/law/exponent`, min: 1, max: 64 });
    const law = choiceField("Law of its force", [["linear", "linear"], ["hertz", "Hertz"], ["power", "power"]], lawOf(each), (value) => {
      each.exponent = value === "linear" ? null : value === "hertz" ? HERTZ : SQUARE;
      /** @type {HTMLInputElement} */ (exponent.querySelector("input")).value = String(each.exponent ?? SQUARE);
      choose();
      changed();
    }, { name: "law" });
    const stiffness = numberField("", each.stiffness, (value) => {
      set("stiffness")(value);
      choose();
    }, { pointer: `${at}/law`, min: 0, empty: "rigid" });
    const choose = () => {
      const soft = isSoft(each);
      const type = /** @type {HTMLSelectElement} */ (law.querySelector("select")).value;
      [restitution.hidden, law.hidden, damping.hidden, exponent.hidden] = [soft, !soft, !soft || type !== "linear", !soft || type !== "power"];
      /** @type {HTMLInputElement} */ (exponent.querySelector("input")).disabled = exponent.hidden;
      /** @type {HTMLElement} */ (stiffness.querySelector("label")).textContent = stiffnessLabel(each.exponent ?? 1);
    };
    choose();
    // The words of the first stop are explained where they stand.
    const [gapHelp, restitutionHelp, struckHelp] = index ? ["", "", ""] : [help("gap"), help("restitution"), help("struck")];
    lower.append(gapHelp);
    restitution.append(restitutionHelp);
    box.append(make("div", { class: "stop", role: "group", "aria-label": `Stop ${index}` },
      make("p", { class: "hint whole" }, `Stop ${index} at ${coordinateName(structure, each.dof)}`),
      numberField("Coordinate", each.dof, set("dof"), { pointer: `${at}/dof`, whole: true, min: 0 }),
      numberField("Relative to", each.relativeTo, set("relativeTo"), { pointer: `${at}/direction`, whole: true, min: 0, empty: "ground" }),
      lower, upper, make("div", { class: "whole" }, gapSlider(index, lower, upper, changed)), restitution,
      stiffness, law, exponent, damping,
      make("div", { class: "stop-acts" },
        make("span", {}, switchField("struck", each.active, (value) => { each.active = value; changed(); }), struckHelp),
        button("Remove", () => { structure.stops.splice(index, 1); rebuild(); changed(); }, { class: "quiet", "aria-label": `Remove stop ${index}` })),
    ));
  });
  box.append(button("Add a stop", () => {
    const taken = new Set(structure.stops.map((each) => each.dof));
    const free = Array.from({ length: size(structure) }, (_, dof) => dof).find((dof) => !taken.has(dof));
    if (free !== undefined) toggleStop(free);
  }, { class: "quiet" }), make("span", { class: "fault", id: "fault-stops" }));
  return box;
}

/** @param {() => void} rebuild */
function loads(rebuild) {
  const { structure } = state;
  const box = make("fieldset", { class: "stops", "data-pointer": "/system/force", tabindex: -1 }, make("legend", {}, "Constant load"));
  structure.loads.forEach((each, index) => {
    /** @param {"dof" | "force"} name */
    const set = (name) => (/** @type {number | null} */ value) => {
      each[name] = /** @type {number} */ (value);
      changed();
    };
    box.append(make("div", { class: "stop", role: "group", "aria-label": `Constant force ${index}` },
      numberField("On coordinate", each.dof, set("dof"), { whole: true, min: 0 }), numberField("Force", each.force, set("force")),
      button("Remove", () => { structure.loads.splice(index, 1); rebuild(); changed(); }, { class: "quiet", "aria-label": `Remove constant force ${index}` })));
  });
  box.append(button("Add a constant force", () => {
    const first = structure.stops[0];
    structure.loads.push({ dof: first ? first.dof : 0, force: 0 });
    rebuild();
  }, { class: "quiet" }), make("span", { class: "fault", id: "fault-loads" }));
  return box;
}

function upload() {
  const input = make("input", { type: "file", id: "upload", multiple: true, accept: ENDINGS.map((ending) => `.${ending}`).join(), class: "visually-hidden" });
  /** @param {FileList | null | undefined} list */
  async function given(list) {
    const files = [...(list || [])];
    if (!files.length) return;
    clearFaults();
    try {
      await take(files);
    } catch (error) {
      showError(error);
    }
    input.value = "";
  }
  input.addEventListener("change", () => given(input.files));
  const box = make("p", { class: "upload" }, input, make("label", { for: "upload", class: "quiet button" }, "Upload matrices …"),
    make("span", { class: "hint" }, " of Nastran, Abaqus, CalculiX, ANSYS, numpy, or .mtx, .csv, .json; one file, or M and K, also dropped here"));
  box.addEventListener("dragover", (event) => event.preventDefault());
  box.addEventListener("drop", (event) => {
    event.preventDefault();
    given(event.dataTransfer && event.dataTransfer.files);
  });
  return box;
}

/** Store files as a structure. @param {File[]} files */
async function take(files) {
  const { content, geometry } = await structureOf(files);
  const { id, unused } = await (await send("POST", "/v1/systems", content)).json();
  const structure = await loaded({ ...preset("stored"), id, name: files.map(({ name }) => name).join(", "), geometry });
  structure.stops = await firstStop(structure);
  setStructure(structure, {});
  if (unused.length) showError(new Error(`Not used: ${unused.join(", ")}.`));
}

/**
 * Return a stop where the first mode moves most: with a hundredth of the size of the geometry as its
 * gap, where there is one.
 * @param {Structure} structure
 */
async function firstStop(structure) {
  const { drawn, nodes } = geometryOf(structure);
  const sizes = nodes ? [0, 1, 2].map((axis) => Math.max(...nodes.map((node) => node[axis])) - Math.min(...nodes.map((node) => node[axis]))) : [];
  const beam = beamIn(structure);
  const extent = Math.max(0, ...sizes, beam ? beam.length : 0);
  const gap = extent > 0 ? Number((0.01 * extent).toPrecision(1)) : 1;
  const request = { system: { id: structure.id, constraints: [] }, count: 1, outputs: ["Omega", "shape"] };
  const mode = await ask("POST", "/v1/compute/natural-frequencies", request).catch(() => ({}));
  if (!mode.shape) return [stop(drawn[0] || 0, gap, gap)];
  const [shape] = mode.shape;
  // A geometry, or a beam, tells displacements, which alone are drawn, from rotations.
  const most = nodes || beam ? drawn.reduce((best, dof) => (Math.abs(shape[dof]) > Math.abs(shape[best]) * (1 + 1e-9) ? dof : best), drawn[0] || 0) : leading(structure, shape, drawn);
  return [stop(most, gap, gap)];
}

/**
 * Return a stored structure with its matrices, as the service keeps them.
 * @param {Structure} structure
 * @returns {Promise<Structure>}
 */
export async function loaded(structure) {
  const document = await ask("GET", `/v1/systems/${structure.id}`);
  const { M, K, C, force, units, geometry } = document;
  if (!K) throw new Error("Presets are entered by their parameters.");
  return { ...structure, geometry: structure.geometry || geometry, matrices: { M, K, C, force, units } };
}

/** Offer units for matrices that came without: the service keeps them with the structure. */
function unitsField() {
  return choiceField("Units", [["", "none"], ...UNITS.map(([name]) => /** @type {[string, string]} */ ([name, name]))], "", async (chosen) => {
    try {
      const [, units] = UNITS.filter(([name]) => name === chosen)[0];
      const { structure } = state;
      const matrices = /** @type {NonNullable<Structure["matrices"]>} */ (structure.matrices);
      const { M, K, C, force } = matrices;
      const document = { M, K, ...(C ? { C } : {}), ...(force ? { force } : {}), units, constraints: [] };
      const id = structure.form === "stored" ? (await (await send("POST", "/v1/systems", document)).json()).id : structure.id;
      setStructure({ ...structure, id, matrices: { ...matrices, units } });
      dispatchEvent(new Event("structure-filled"));
    } catch (error) {
      showError(error);
    }
  }, { name: "units" });
}

function geometryUpload() {
  const input = make("input", { type: "file", id: "geometry", accept: ".csv,.txt,.json", class: "visually-hidden" });
  input.addEventListener("change", async () => {
    const file = input.files && input.files[0];
    if (!file) return;
    try {
      const text = await file.text();
      state.structure.geometry = file.name.endsWith(".json") ? JSON.parse(text) : nodesOf(text);
      setStructure(state.structure);
    } catch (error) {
      showError(error);
    }
  });
  return make("p", { class: "upload" }, input, make("label", { for: "geometry", class: "quiet button" }, "Geometry …"),
    make("span", { class: "hint" }, " one line per coordinate: x, y, z, direction"));
}

/**
 * Return the geometry in a table with one line for each degree of freedom: x, y, z, direction.
 * @param {string} text
 * @returns {import("./structures.js").GeometryDocument}
 */
function nodesOf(text) {
  /** @type {Map<string, number>} */
  const index = new Map();
  /** @type {number[][]} */
  const nodes = [];
  const dofs = text.split(/\r?\n/).map((line) => line.trim()).filter((line) => /^[-+.\d]/.test(line)).map((line) => {
    const [x, y = "0", z = "0", direction = "z"] = line.split(/[\s,;]+/);
    const place = [x, y, z].map(Number);
    if (place.some(Number.isNaN)) throw new Error(`The geometry has a line without numbers: ${line.slice(0, 60)}`);
    const name = place.join(" ");
    if (!index.has(name)) index.set(name, nodes.push(place) - 1);
    return { node: /** @type {number} */ (index.get(name)), direction };
  });
  if (dofs.length !== size(state.structure)) {
    throw new Error(`The geometry has ${dofs.length} lines for ${size(state.structure)} degrees of freedom.`);
  }
  return { nodes, dofs };
}
