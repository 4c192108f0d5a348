// Matrices in files, as the service takes them or as the browser can read them itself.

/** @typedef {number[][] | {shape: number[], row: number[], col: number[], data: number[]}} Matrix in forms of the contract */
/** @typedef {{values: any, shape: number[], fortran: boolean}} NumpyArray */

export const ENDINGS = ["mtx", "npy", "npz", "csv", "txt", "json"];

/** Names of matrices in files and of files, as the Python client knows them. @type {Record<string, "M" | "K" | "C">} */
const NAMES = Object.fromEntries([
  ...["M", "MASS", "MAA", "MAAX", "MGG", "MXX"].map((name) => [name, "M"]),
  ...["K", "STIFFNESS", "KAA", "KAAX", "KGG", "KXX", "STIF"].map((name) => [name, "K"]),
  ...["C", "D", "DAMPING", "BAA", "BGG", "BXX", "VISCOUSDAMPING"].map((name) => [name, "C"]),
]);
const ORDER = /** @type {const} */ (["M", "K", "C"]);

/**
 * Return what the service stores, and the geometry beside it. Matrix Market texts, one .npy and JSON
 * are read by the service; the others here.
 * @param {File[]} files one, or one for each matrix, which its name tells
 * @returns {Promise<{content: Blob, geometry?: import("./structures.js").GeometryDocument}>}
 */
export async function structureOf(files) {
  const [first] = files;
  if (files.length === 1 && endingOf(first) === "json") return document(await first.text());
  if (files.length === 1 && endingOf(first) === "npy") return { content: new Blob([first], { type: "application/x-npy" }) };
  if ((await Promise.all(files.map(isMatrixMarket))).every(Boolean)) {
    const ordered = files.length === 1 ? files : ORDER.flatMap((name) => files.filter((file) => matrixOf(file.name) === name));
    checkNames(files, ordered.map(({ name }) => matrixOf(name)));
    return { content: new Blob(ordered.flatMap((file) => [file, "\n"]), { type: "application/x-matrix-market" }) };
  }
  const parts = (await Promise.all(files.map(read))).flatMap((part) => Object.entries(part));
  const names = parts.map(([name]) => matrixOf(name));
  // One matrix alone is the stiffness, whatever its name.
  if (parts.length === 1) names[0] = "K";
  checkNames(files, names);
  const matrices = Object.fromEntries(parts.map(([, matrix], i) => [String(names[i]), whole(matrix)]));
  const n = sizeOf(matrices.K);
  const system = { M: { scalar: 1, n }, ...matrices, constraints: [] };
  return { content: new Blob([JSON.stringify(system)], { type: "application/json" }) };
}

/** @param {File} file */
function endingOf({ name }) {
  return (name.split(".").pop() || "").toLowerCase();
}

/** @param {string} name of a file or of a matrix in one @returns {"M" | "K" | "C" | undefined} */
function matrixOf(name) {
  return NAMES[name.replace(/\.[^.]*$/, "").toUpperCase()];
}

/** @param {File[]} files @param {(string | undefined)[]} names */
function checkNames(files, names) {
  if (files.length === 1 && names.length === 1) return;
  const known = names.filter(Boolean);
  if (known.includes("K") && known.length === names.length && new Set(names).size === names.length && (names.length !== 2 || known.includes("M"))) return;
  const has = files.map(({ name }) => name).join(", ");
  throw new Error(`${has}: it is not clear which matrix is which. Name them M, K and C, as M.csv and K.csv, or as arrays of one .npz file.`);
}

/** @param {File} file */
async function isMatrixMarket(file) {
  return endingOf(file) === "mtx" && (await file.slice(0, 14).text()) === "%%MatrixMarket";
}

/** @param {string} text @returns {{content: Blob, geometry?: any}} */
function document(text) {
  const { geometry, ...system } = JSON.parse(text);
  return { geometry, content: new Blob([JSON.stringify({ constraints: [], ...system })], { type: "application/json" }) };
}

/** @param {File} file @returns {Promise<Record<string, Matrix>>} */
async function read(file) {
  const ending = endingOf(file);
  const stem = file.name.replace(/\.[^.]*$/, "");
  if (ending === "npz") return archive(await file.arrayBuffer(), file.name, stem);
  if (ending === "npy") return { [stem]: rows(numpyArray(await file.arrayBuffer(), file.name), file.name) };
  if (ending === "csv" || ending === "txt") return { [stem]: table(await file.text(), file.name) };
  if (ending === "mtx") return { [stem]: await isMatrixMarket(file) ? marketArray(await file.text(), file.name) : abaqus(await file.text(), file.name) };
  const how = `import numpy, vibroimpact; m = vibroimpact.read_model("${file.name}"); numpy.savez("${stem}.npz", M=m.M.toarray(), K=m.K.toarray())`;
  throw new Error(`The page cannot read ${file.name}. It reads .${ENDINGS.join(", .")}. The Python client reads .mat, .op4, .bdf, .dat and .pch too and writes what can be uploaded here: ${how}`);
}

/** @param {string} text @param {string} name @returns {number[][]} of numbers in lines */
function numbersOf(text, name) {
  const lines = text.split(/\r?\n/).map((line) => line.replace(/[#%*].*$/, "").trim()).filter(Boolean);
  return lines.map((line) => {
    const values = line.split(/[\s,;]+/).filter(Boolean).map(Number);
    if (values.some(Number.isNaN)) throw new Error(`${name} has a line without numbers: ${line.slice(0, 60)}`);
    return values;
  });
}

/** @param {string} text @param {string} name @returns {number[][]} */
function table(text, name) {
  const lines = numbersOf(text, name);
  if (!lines.length || lines.some((line) => line.length !== lines.length)) {
    throw new Error(`${name} has ${lines.length} lines of ${lines.length ? lines[0].length : 0} numbers; a matrix has as many lines as numbers in each.`);
  }
  return lines;
}

/** Abaqus: lines of node, direction, node, direction, value, or of row, column, value. @param {string} text @param {string} name @returns {Matrix} */
function abaqus(text, name) {
  const lines = numbersOf(text, name);
  const width = lines.length ? lines[0].length : 0;
  if ((width !== 3 && width !== 5) || lines.some((line) => line.length !== width)) {
    throw new Error(`${name} is neither Matrix Market nor of lines with 3 or 5 numbers, as Abaqus writes them.`);
  }
  const data = lines.map((line) => line[width - 1]);
  if (width === 3) {
    const [row, col] = [0, 1].map((k) => lines.map((line) => line[k] - 1));
    const n = 1 + [...row, ...col].reduce((a, b) => Math.max(a, b), 0);
    return { shape: [n, n], row, col, data };
  }
  const ends = lines.flatMap((line) => [[line[0], line[1]], [line[2], line[3]]]);
  const ordered = ends.sort(([a, b], [c, d]) => a - c || b - d).map((end) => end.join());
  const index = new Map([...new Set(ordered)].map((end, i) => [end, i]));
  /** @param {number} k */
  const places = (k) => lines.map((line) => Number(index.get(`${line[k]},${line[k + 1]}`)));
  return { shape: [index.size, index.size], row: places(0), col: places(2), data };
}

/** One of several files in Matrix Market's form beside others in other forms. @param {string} text @param {string} name @returns {Matrix} */
function marketArray(text, name) {
  const symmetric = /^%%MatrixMarket +matrix +coordinate +\S+ +(general|symmetric)/i.exec(text);
  if (!symmetric) throw new Error(`${name}: beside files of other forms, a Matrix Market file is to be one of coordinates.`);
  const [[n, m], ...entries] = numbersOf(text, name);
  return { shape: [n, m], row: entries.map(([i]) => i - 1), col: entries.map(([, j]) => j - 1), data: entries.map(([, , value]) => value) };
}

/** @param {Matrix} matrix @returns {number} */
function sizeOf(matrix) {
  return Array.isArray(matrix) ? matrix.length : matrix.shape[0];
}

/** A triangle stands for the whole. @param {Matrix} matrix @returns {Matrix} */
function whole(matrix) {
  if (Array.isArray(matrix)) {
    const given = [1, -1].map((side) => matrix.some((row, i) => row.some((value, j) => value !== 0 && side * (j - i) > 0)));
    return given[0] && given[1] ? matrix : matrix.map((row, i) => row.map((value, j) => (i === j ? value : value + matrix[j][i])));
  }
  const { shape, row, col, data } = matrix;
  if (data.some((value, e) => value !== 0 && row[e] < col[e]) && data.some((value, e) => value !== 0 && row[e] > col[e])) return matrix;
  const off = data.map((_, e) => e).filter((e) => row[e] !== col[e]);
  return { shape, row: [...row, ...off.map((e) => col[e])], col: [...col, ...off.map((e) => row[e])], data: [...data, ...off.map((e) => data[e])] };
}

/** @param {ArrayBuffer} content @param {string} name @param {string} stem @returns {Promise<Record<string, Matrix>>} */
async function archive(content, name, stem) {
  /** @type {Record<string, NumpyArray>} */
  const arrays = {};
  for (const [entry, data] of await unzipped(content, name)) arrays[entry.replace(/\.npy$/, "")] = numpyArray(data, `${name}, ${entry}`);
  if (arrays.format) return { [stem]: sparse(arrays, name) };
  const named = Object.entries(arrays).filter(([each]) => matrixOf(each));
  if (!named.length) throw new Error(`${name} has no array called M, K or C; it has ${Object.keys(arrays).join(", ")}.`);
  return Object.fromEntries(named.map(([each, array]) => [each, rows(array, name)]));
}

/** Of scipy.sparse.save_npz. @param {Record<string, NumpyArray>} arrays @param {string} name @returns {Matrix} */
function sparse(arrays, name) {
  const format = String(arrays.format.values);
  /** @param {string} key @returns {number[]} */
  const list = (key) => Array.from(arrays[key].values);
  const [shape, data] = [list("shape"), list("data")];
  if (format === "coo") return { shape, row: list("row"), col: list("col"), data };
  if (format !== "csr" && format !== "csc") throw new Error(`${name} is a sparse matrix of the form ${format}; save it as csr.`);
  const starts = list("indptr");
  const outer = starts.slice(1).flatMap((end, i) => new Array(end - starts[i]).fill(i));
  const inner = list("indices");
  return format === "csr" ? { shape, row: outer, col: inner, data } : { shape, row: inner, col: outer, data };
}

/** @param {NumpyArray} array @param {string} name @returns {number[][]} */
function rows({ values, shape, fortran }, name) {
  const [n, m] = shape;
  if (shape.length !== 2 || n !== m) throw new Error(`${name} has an array of the shape ${shape.join(" × ")}; a matrix is square.`);
  return Array.from({ length: n }, (_, i) => Array.from({ length: n }, (_2, j) => values[fortran ? j * n + i : i * n + j]));
}

/** @type {Record<string, (buffer: ArrayBuffer) => ArrayLike<number>>} */
const TYPES = {
  "<f8": (buffer) => new Float64Array(buffer), "<f4": (buffer) => new Float32Array(buffer), "<i4": (buffer) => new Int32Array(buffer),
  "<i8": (buffer) => Array.from(new BigInt64Array(buffer), Number), "|i1": (buffer) => new Int8Array(buffer), "|u1": (buffer) => new Uint8Array(buffer), "|b1": (buffer) => new Uint8Array(buffer),
};

/** @param {ArrayBuffer} content of a .npy file @param {string} name @returns {NumpyArray} */
function numpyArray(content, name) {
  const bytes = new Uint8Array(content);
  const view = new DataView(content);
  if (String.fromCharCode(...bytes.slice(1, 6)) !== "NUMPY") throw new Error(`${name} is no array of numpy.`);
  const start = bytes[6] === 1 ? 10 : 12;
  const end = start + (bytes[6] === 1 ? view.getUint16(8, true) : view.getUint32(8, true));
  const head = new TextDecoder("latin1").decode(bytes.slice(start, end));
  const [, type] = /'descr': *'([^']*)'/.exec(head) || ["", ""];
  const [, sizes] = /'shape': *\(([^)]*)\)/.exec(head) || ["", ""];
  const shape = sizes.split(",").filter((each) => each.trim()).map(Number);
  const data = content.slice(end);
  if (type.startsWith("|S")) return { values: new TextDecoder("latin1").decode(data), shape, fortran: false };
  if (!TYPES[type]) throw new Error(`${name} has numbers of the type ${type || "object"}; save them as float64.`);
  return { values: TYPES[type](data), shape, fortran: /'fortran_order': *True/.test(head) };
}

/** @param {ArrayBuffer} content @param {string} name @returns {Promise<[string, ArrayBuffer][]>} the files of an archive */
async function unzipped(content, name) {
  const view = new DataView(content);
  let end = content.byteLength - 22;
  while (end >= 0 && view.getUint32(end, true) !== 0x06054b50) end -= 1;
  if (end < 0) throw new Error(`${name} is no .npz file.`);
  let at = view.getUint32(end + 16, true);
  /** @type {[string, ArrayBuffer][]} */
  const files = [];
  for (let left = view.getUint16(end + 10, true); left > 0; left -= 1) {
    const [method, size] = [view.getUint16(at + 10, true), view.getUint32(at + 20, true)];
    const [named, extra, comment] = [28, 30, 32].map((offset) => view.getUint16(at + offset, true));
    const entry = new TextDecoder().decode(content.slice(at + 46, at + 46 + named));
    const local = view.getUint32(at + 42, true);
    const start = local + 30 + view.getUint16(local + 26, true) + view.getUint16(local + 28, true);
    const packed = content.slice(start, start + size);
    const inflated = () => new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate-raw"))).arrayBuffer();
    files.push([entry, method ? await inflated() : packed]);
    at += 46 + named + extra + comment;
  }
  return files;
}
