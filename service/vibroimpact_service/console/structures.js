// Structures of the page: their documents, their matrices, and how they are drawn.

import { beamOf } from "./beams.js";
import { entries, rows } from "./matrix_forms.js";

/**
 * @typedef {{dof: number, relativeTo: number | null, lower: number | null, upper: number | null,
 *   restitution: number, active: boolean, stiffness: number | null, damping: number | null, exponent: number | null}} Stop
 *
 * @typedef {{form: string, parameters: Record<string, number>, damping: number, stops: Stop[],
 *   loads: {dof: number, force: number}[], matrices?: {M: any, K: any, C?: any, force?: number[], units?: any}, id?: string, name?: string,
 *   geometry?: GeometryDocument}} Structure
 *
 * A stop without a stiffness is rigid; one with an exponent pushes with that power of the indentation, else linearly. Loads are constant forces, in addition to the one that a file may have.
 *
 * @typedef {{nodes: number[][], dofs?: {node: number, direction: string}[], links?: number[][]}} GeometryDocument
 *
 * @typedef {{layout: "row" | "profile" | "pendulum" | "cloud", n: number, drawn: number[],
 *   fixed: [boolean, boolean], springs: boolean, smooth: boolean, element?: number,
 *   nodes?: number[][], directions?: number[][], nodeOf?: number[], links?: number[][]}} Geometry
 *
 * A geometry with the length of an element is that of a beam: each rotation follows its displacement.
 *
 * @typedef {{label: string, name: string, value: number, whole?: boolean, min?: number, max?: number}} Parameter
 */

/** @param {number} dof @param {number | null} lower @param {number | null} upper @returns {Stop} */
export function stop(dof, lower, upper, restitution = 1, /** @type {number | null} */ relativeTo = null) {
  return { dof, relativeTo, lower, upper, restitution, active: true, stiffness: null, damping: null, exponent: null };
}

/** Power of the indentation in the force between two curved surfaces. */
export const HERTZ = 1.5;

/** The power that is offered where another one is chosen. */
export const SQUARE = 2;

/** Degrees of freedom up to which matrices are entered entry by entry. */
export const LARGEST = 8;

/** Where modes of structures with a wide spectrum, such as beams, are shown first. @type {[number, number]} */
const WIDE = [0.98, 1.3];

/**
 * The forms a structure can have: what one enters for it, and its first stops. Ranges of frequency
 * are multiples of natural frequencies: of the last one where modes are shown, or of the first in a
 * wide spectrum; of the first where it is driven.
 * @type {Record<string, {label: string, parameters: Parameter[], stops: Stop[], damped: boolean,
 *   modes: [number, number], wide: [number, number], driven: [number, number]}>}
 */
export const FORMS = {
  chain: {
    label: "Chain of masses between walls", damped: true, modes: [0.2767, 1.31], wide: [0.98, 12], driven: [0.2233, 4.466], stops: [stop(5, 0.2, 0.2)],
    parameters: [
      { label: "Masses", name: "n", value: 13, whole: true, min: 1, max: 5000 },
      { label: "Mass", name: "mass", value: 1 }, { label: "Stiffness", name: "stiffness", value: 1 },
    ],
  },
  beam: {
    label: "Cantilever beam", damped: true, modes: [0.277, 1.31], wide: [0.853, 11.376], driven: [0.2844, 8.532], stops: [stop(6, 0.05, 0.05)],
    parameters: [
      { label: "Elements", name: "elements", value: 4, whole: true, min: 1, max: 1000 },
      { label: "Length", name: "length", value: 1 }, { label: "Bending stiffness EI", name: "EI", value: 1 },
      { label: "Mass per length ρA", name: "rhoA", value: 1 },
    ],
  },
  oscillator: {
    label: "Oscillator", damped: true, modes: [0.5, 3], wide: WIDE, driven: [0.2, 3], stops: [stop(0, 1, 1)],
    parameters: [{ label: "Frequency Ω₀", name: "Omega0", value: 1 }],
  },
  two_mass: {
    label: "Two coupled masses", damped: true, modes: [0.231, 2.02], wide: WIDE, driven: [0.4, 2.5], stops: [stop(0, 1, 1)],
    parameters: [
      { label: "Frequency Ω₀", name: "Omega0", value: 1 }, { label: "Coupling c", name: "coupling", value: 1 },
    ],
  },
  double_pendulum: {
    label: "Double pendulum", damped: false, modes: [0.212, 2.83], wide: WIDE, driven: [0.3674, 4.899], stops: [stop(0, 0.1, 0.1)],
    parameters: [{ label: "Mass ratio μ", name: "mu", value: 2, min: 1 }],
  },
  absorber: {
    label: "Mass with impact absorber", damped: true, modes: [0.4472, 1.789], wide: WIDE, driven: [0.7826, 1.4535], stops: [stop(1, 0.5, 0.5, 0.7, 0)],
    parameters: [
      { label: "Frequency Ω₀", name: "Omega0", value: 1 }, { label: "Mass ratio", name: "ratio", value: 0.05 },
    ],
  },
  matrices: { label: "Matrices M, K", damped: true, modes: [0.277, 1.31], wide: WIDE, driven: [0.3, 2.5], stops: [stop(0, 1, 1)], parameters: [] },
  stored: { label: "Uploaded structure", damped: true, modes: [0.277, 1.31], wide: WIDE, driven: [0.3, 2.5], stops: [stop(0, 1, 1)], parameters: [] },
};

/** @param {string} form @returns {Structure} */
export function preset(form) {
  const about = FORMS[form];
  return {
    form, damping: 0, loads: [], stops: about.stops.map((each) => ({ ...each })),
    parameters: Object.fromEntries(about.parameters.map(({ name, value }) => [name, value])),
    ...(form === "matrices" ? { matrices: { M: [[1, 0, 0], [0, 1, 0], [0, 0, 1]], K: [[2, -1, 0], [-1, 2, -1], [0, -1, 2]] } } : {}),
  };
}

/** @param {Structure} structure @returns {boolean} whether its stops have a stiffness: what meets one is in contact for a while */
export function yields(structure) {
  return structure.stops.some(isSoft);
}

/** @param {{stiffness?: number | null}} each @returns {boolean} whether a stop has a stiffness */
export function isSoft({ stiffness }) {
  return stiffness !== null && stiffness !== undefined;
}

/** @param {number} n @param {number} dof @param {number} value @returns {number[]} that value of one coordinate, the others at rest */
export function only(n, dof, value) {
  const all = new Array(n).fill(0);
  if (dof < n) all[dof] = value;
  return all;
}

/** @param {Structure} structure @returns {number} degrees of freedom; 0 where they are not known yet */
export function size(structure) {
  const { form, parameters: p, matrices } = structure;
  if (form === "chain") return p.n;
  if (form === "beam") return 2 * p.elements;
  if (form === "oscillator") return 1;
  if (form === "matrices" || form === "stored") return matrices ? rows(matrices.K) : 0;
  return 2;
}

/**
 * Say what a coordinate is: its number, and the part of the structure that it moves.
 * @param {Structure} structure @param {number} dof
 * @returns {string} as "coordinate 5 (mass 6)"
 */
export function coordinateName(structure, dof) {
  const part = partOf(structure, dof);
  return `coordinate ${dof}${part && ` (${part})`}`;
}

/** @param {Structure} structure @param {number} dof @returns {string} as the label of an axis */
export function axisName(structure, dof) {
  return `x of ${partOf(structure, dof) || `coordinate ${dof}`}`;
}

/** @param {Structure} structure @param {number} dof @returns {"length" | "angle"} what a coordinate is measured in */
export function measure(structure, dof) {
  const { geometry } = structure;
  const place = geometry && geometry.dofs && geometry.dofs[dof];
  if (!place && dof % 2 && beamIn(structure)) return "angle";
  return place && place.direction.startsWith("r") ? "angle" : "length";
}

/** @param {Structure} structure @returns {import("./beams.js").Beam | null} the beam that matrices without a geometry are, if they are one */
export function beamIn({ matrices, geometry }) {
  return matrices && !geometry ? beamOf(matrices.K) : null;
}

/** @param {Structure} structure @param {number} dof @returns {string} */
function partOf(structure, dof) {
  const { form, geometry } = structure;
  if (form === "chain" || form === "two_mass") return `mass ${dof + 1}`;
  if (form === "beam" || beamIn(structure)) return `node ${Math.floor(dof / 2) + 1}, ${dof % 2 ? "rotation" : "deflection"}`;
  if (form === "absorber") return ["main mass", "absorber"][dof] || "";
  if (form === "double_pendulum") return ["upper rod", "lower rod"][dof] || "";
  const place = geometry && geometry.dofs && geometry.dofs[dof];
  return place ? `node ${place.node + 1}, ${place.direction}` : "";
}

/** @param {Structure} structure @returns {string} in a line: what it is, and its stops */
export function inWords(structure) {
  const { form, parameters, stops, name, damping } = structure;
  const about = FORMS[form];
  const numbers = about.parameters.map(({ label, name: key }) => `${label[0].toLowerCase()}${label.slice(1)} ${parameters[key]}`);
  const each = stops.map(({ dof, lower, upper }) => `coordinate ${dof} ${lower === upper ? `±${upper}` : `${lower === null ? "" : `−${lower}`}…${upper ?? ""}`}`);
  return [form === "stored" ? name || about.label : about.label, ...numbers, ...(damping ? [`ζ = ${damping}`] : []), each.length ? `stops: ${each.join("; ")}` : "no stop"].join(", ");
}

/** @param {Stop} each @param {boolean} losses without them it is rigid, and gives all velocity back @returns {any} the document of a constraint */
function constraint(each, losses) {
  const place = each.relativeTo === null
    ? { dof: each.dof } : { direction: { dofs: [each.dof, each.relativeTo], weights: [1, -1] } };
  const gap = each.lower === each.upper && each.upper !== null && each.upper > 0
    ? each.upper : { lower: each.lower, upper: each.upper };
  const soft = isSoft(each);
  return { ...place, gap, ...(soft && losses ? { law: lawDocument(each) } : { restitution: soft ? 1 : each.restitution }) };
}

/** @param {{exponent: number | null}} each a stop with a stiffness @returns {"linear" | "hertz" | "power"} */
export function lawOf({ exponent }) {
  if (exponent === null || exponent === undefined) return "linear";
  return exponent === HERTZ ? "hertz" : "power";
}

/** @param {Stop} each with a stiffness */
function lawDocument(each) {
  const [type, { stiffness }] = [lawOf(each), each];
  if (type === "linear") return { type, stiffness, damping: each.damping || 0 };
  return { type, stiffness, ...(type === "power" ? { exponent: each.exponent } : {}) };
}

/**
 * Return the document of a structure. Damping, and the stiffness of stops, are left out where a computation knows none.
 * @param {Structure} structure
 * @param {boolean} [damped]
 */
export function systemDocument(structure, damped = true) {
  const { form, parameters: p, stops, id, loads } = structure;
  const constraints = stops.map((each) => constraint(each, damped));
  const zeta = damped && !(structure.matrices && structure.matrices.C) ? structure.damping : 0;
  const loaded = loads.some((each) => each.force);
  if (!loaded) {
    if (form === "stored") return { id, constraints, ...(zeta ? { damping: { ratio: zeta } } : {}) };
    if (form === "oscillator" || form === "two_mass") return { preset: form, ...p, ...(zeta ? { zeta } : {}), constraints };
    if (form === "chain" && !zeta) return { preset: "chain", n: p.n, mass: p.mass, stiffness: p.stiffness, constraints };
    if (form === "absorber" && !zeta) return { preset: form, ...p, constraints };
    if (form === "beam" && !zeta) return { preset: form, ...p, constraints };
    if (form === "double_pendulum") return { preset: form, mu: p.mu, constraints };
  }
  const { M, K, C, force, units } = sparseMatrices(structure);
  const ratio = zeta && (form === "stored" || form === "matrices") ? { damping: { ratio: zeta } } : {};
  const damping = "damping" in ratio || !damped ? undefined : zeta ? dampingOf(structure, K, zeta) : C;
  const constant = loaded ? total(size(structure), force, loads) : force;
  return { M, K, ...(damping ? { C: damping } : {}), ...ratio, ...(constant ? { force: constant } : {}), ...(units ? { units } : {}), constraints };
}

/**
 * Return what the document of a structure without its damping and the stiffness of its stops leaves out, as results say it.
 * @param {Structure} structure
 * @returns {string[]}
 */
export function leftOut(structure) {
  const damped = structure.damping || (structure.form !== "stored" && structure.matrices && structure.matrices.C);
  const soft = structure.stops.flatMap((each, i) => (isSoft(each) ? [`the stiffness of stop ${i} is neglected: impact modes are motions between rigid stops`] : []));
  return [...(damped ? ["the damping C is neglected: the motions have no energy loss"] : []), ...soft];
}

/** @param {number} n @param {number[] | undefined | null} force @param {{dof: number, force: number}[]} loads @returns {number[]} */
function total(n, force, loads) {
  const all = force ? [...force] : new Array(n).fill(0);
  // One beyond the end makes it too long, and the service says so at the field.
  for (const { dof, force: value } of loads) all[Math.min(dof, n)] = (all[Math.min(dof, n)] || 0) + value;
  return all;
}

/** @param {Structure} structure @param {any} K @param {number} zeta @returns {any} as the service's presets have it, or in proportion to stiffness */
function dampingOf(structure, K, zeta) {
  if (structure.form === "two_mass") return { diagonal: [2 * zeta * structure.parameters.Omega0, 0] };
  return times(K, (2 * zeta) / lowest(structure));
}

/** @param {Structure} structure @returns {number} an estimate of the lowest natural frequency */
function lowest({ form, parameters: p }) {
  if (form === "chain") return 2 * Math.sqrt(p.stiffness / p.mass) * Math.sin(Math.PI / (2 * (p.n + 1)));
  if (form === "beam") return 3.5160152685 * Math.sqrt(p.EI / p.rhoA) / p.length ** 2;
  return p.Omega0 || 1;
}

/** @param {any} matrix @param {number} factor @returns {any} */
function times(matrix, factor) {
  if (Array.isArray(matrix)) return matrix.map((row) => row.map((/** @type {number} */ value) => value * factor));
  return { bands: Object.fromEntries(Object.entries(matrix.bands).map(([k, row]) => [k, row.map((/** @type {number} */ v) => v * factor)])) };
}

/** @param {Structure} structure @returns {any} M, K and perhaps C, in forms of the contract */
function sparseMatrices({ form, parameters: p, matrices }) {
  if (form === "beam") return beam(p);
  if (form === "absorber") {
    const k = p.Omega0 ** 2;
    return {
      M: [[1, 0], [0, p.ratio]],
      K: [[k * (1 + p.ratio), -k * p.ratio], [-k * p.ratio, k * p.ratio]],
    };
  }
  if (form === "oscillator") return { M: [[1]], K: [[p.Omega0 ** 2]] };
  if (form === "two_mass") {
    const [k, c] = [p.Omega0 ** 2, p.coupling];
    return { M: [[1, 0], [0, 1]], K: [[k * (1 + c), -k * c], [-k * c, k * (1 + c)]] };
  }
  if (form === "double_pendulum") return { M: [[p.mu ** 2, 1], [1, 1]], K: [[p.mu ** 2, 0], [0, 1]] };
  if (form === "chain") {
    /** @param {number} value @param {number} count */
    const row = (value, count) => new Array(Math.max(0, count)).fill(value);
    return {
      M: { bands: { 0: row(p.mass, p.n) } },
      K: { bands: { 0: row(2 * p.stiffness, p.n), ...(p.n > 1 ? { 1: row(-p.stiffness, p.n - 1) } : {}) } },
    };
  }
  return matrices || { M: [[1]], K: [[1]] };
}

/**
 * Return the matrices of a cantilever of Hermite elements; degrees of freedom: w₁, θ₁, w₂, θ₂ …
 * @param {Record<string, number>} p
 */
function beam(p) {
  const h = p.length / p.elements;
  const [k, m] = [p.EI / h ** 3, (p.rhoA * h) / 420];
  const stiffness = [[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h], [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h * h, -6 * h, 4 * h * h]];
  const mass = [[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h], [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h * h, -22 * h, 4 * h * h]];
  const n = 2 * p.elements;
  /** @param {number[][]} local @param {number} factor */
  const assembled = (local, factor) => {
    const bands = [0, 1, 2, 3].map((offset) => new Array(Math.max(0, n - offset)).fill(0));
    for (let e = 0; e < p.elements; e += 1) {
      for (let i = 0; i < 4; i += 1) {
        for (let j = i; j < 4; j += 1) {
          const row = 2 * e + i - 2;
          if (row >= 0) bands[j - i][row] += factor * local[i][j];
        }
      }
    }
    return { bands: Object.fromEntries(bands.map((row, offset) => [offset, row]).filter(([, row]) => /** @type {number[]} */ (row).length)) };
  };
  return { M: assembled(mass, m), K: assembled(stiffness, k) };
}

/**
 * Return the coordinate that takes most of a motion's kinetic energy: rotations of a beam, in units
 * of their own, take little of it.
 * @param {Structure} structure
 * @param {number[]} shape of the motion
 * @param {number[]} among
 */
export function leading(structure, shape, among) {
  const share = new Float64Array(shape.length);
  for (const [i, j, value] of entries(sparseMatrices(structure).M, shape.length)) share[i] += shape[i] * value * shape[j];
  return among.reduce((best, dof) => (share[dof] > share[best] ? dof : best), among[0] || 0);
}

const AXES = { x: 0, y: 1, z: 2 };

/** @param {Structure} structure @returns {Geometry} how it is drawn */
export function geometryOf(structure) {
  const n = size(structure);
  const all = Array.from({ length: n }, (_, i) => i);
  /** @type {Geometry} */
  const base = { layout: "profile", n, drawn: all, fixed: [false, false], springs: false, smooth: false };
  const { form, parameters: p } = structure;
  if (form === "chain") return n <= 3 ? { ...base, layout: "row", springs: true, fixed: [true, true] } : { ...base, fixed: [true, true] };
  if (form === "beam") return { ...base, drawn: all.filter((i) => i % 2 === 0), fixed: [true, false], smooth: true, element: p.length / p.elements };
  if (form === "oscillator") return { ...base, layout: "row", springs: true, fixed: [true, false] };
  if (form === "two_mass") return { ...base, layout: "row", springs: true, fixed: [true, true] };
  if (form === "absorber") return { ...base, layout: "row", springs: true, fixed: [true, false] };
  if (form === "double_pendulum") return { ...base, layout: "pendulum" };
  if (structure.geometry) return cloud(base, structure.geometry, structure);
  const beam = beamIn(structure);
  // Only a cantilever is drawn with its slopes.
  if (beam) return { ...base, drawn: all.filter((i) => i % 2 === 0), fixed: beam.fixed, smooth: true, ...(beam.fixed[0] && !beam.fixed[1] ? { element: beam.element } : {}) };
  return base;
}

/**
 * Return the degrees of freedom that a drawing needs; where many lie closer than its pixels, some.
 * @param {Structure} structure
 * @param {number} most
 */
export function neededDofs(structure, most) {
  const { drawn, element, n } = geometryOf(structure);
  const step = Math.ceil(drawn.length / most);
  const some = drawn.filter((_, i) => i % step === 0);
  const stops = structure.stops.flatMap(({ dof, relativeTo }) => (relativeTo === null ? [dof] : [dof, relativeTo]));
  const all = [...some, ...(element ? some.map((dof) => dof + 1) : []), ...stops];
  return [...new Set(all)].filter((dof) => dof < n).sort((a, b) => a - b);
}

/** @param {Geometry} base @param {GeometryDocument} geometry @param {Structure} structure @returns {Geometry} */
function cloud(base, geometry, structure) {
  const flat = geometry.nodes.every((node) => node.length < 3 || node[2] === geometry.nodes[0][2]);
  const where = geometry.dofs || geometry.nodes.map((_, node) => ({ node, direction: flat ? "y" : "z" }));
  /** @param {string} direction */
  const unit = (direction) => {
    const vector = [0, 0, 0];
    const axis = AXES[/** @type {"x" | "y" | "z"} */ (direction)];
    if (axis !== undefined) vector[axis] = 1; // rotations are not drawn
    return vector;
  };
  const nodeOf = where.map(({ node }) => node);
  return {
    ...base, layout: "cloud", nodes: geometry.nodes.map((node) => [node[0], node[1] || 0, node[2] || 0]),
    directions: where.map(({ direction }) => unit(direction)), nodeOf,
    drawn: base.drawn.filter((dof) => where[dof] && unit(where[dof].direction).some(Boolean)),
    links: geometry.links || joined(structure, geometry, nodeOf),
  };
}

/** Links of the geometries seen: they are asked for at every move of the cursor. @type {WeakMap<GeometryDocument, number[][]>} */
const LINKS = new WeakMap();

/** @param {Structure} structure @param {GeometryDocument} geometry @param {number[]} nodeOf @returns {number[][]} nodes that stiffness couples */
function joined(structure, geometry, nodeOf) {
  const known = LINKS.get(geometry);
  if (known) return known;
  const links = new Map();
  const { K } = sparseMatrices(structure);
  for (const [i, j, value] of entries(K, size(structure))) {
    const [a, b] = [nodeOf[i], nodeOf[j]];
    if (value && a < b && b !== undefined) links.set(`${a} ${b}`, [a, b]);
  }
  const made = [...links.values()].slice(0, 20_000);
  LINKS.set(geometry, made);
  return made;
}
