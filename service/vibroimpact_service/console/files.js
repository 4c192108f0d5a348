// Matrices in files, as the service takes them or as the browser can read them itself.

/** @typedef {{shape: number[], row: number[], col: number[], data: number[]}} Entries of a sparse matrix, in the form of the contract */
/** @typedef {number[][] | Entries & {ends?: string[]}} Matrix in forms of the contract; `ends`: what the rows are, nodes and directions; empty: the last ones may be missing */
/** @typedef {{values: any, shape: number[], fortran: boolean}} NumpyArray */

export const ENDINGS = ["mtx", "npy", "npz", "csv", "txt", "json"];

/** Names of matrices in files and of files, as the Python client knows them. @type {Record<string, "M" | "K" | "C">} */
const NAMES = Object.fromEntries([
  ...["M", "MASS", "MAA", "MAAX", "MGG", "MGGX", "MXX", "MHH", "M2GG", "M2PP"].map((name) => [name, "M"]),
  ...["K", "STIFFNESS", "STIF", "KAA", "KAAX", "KGG", "KGGX", "KXX", "KHH", "K2GG", "K2PP"].map((name) => [name, "K"]),
  ...["C", "D", "DAMPING", "VISCOUSDAMPING", "BAA", "BAAX", "BGG", "BGGX", "BXX", "BHH", "B2GG", "B2PP"].map((name) => [name, "C"]),
]);
const ORDER = /** @type {const} */ (["M", "K", "C"]);

/** Numbers as files write them, with Fortran's exponents too. */
const NUMBER = /^[+-]?(?:\d+\.?\d*|\.\d+)(?:[eEdD][+-]?\d+)?$/;
const MARKET = "application/x-matrix-market";

/**
 * Return what the service stores, and the geometry beside it. Matrix Market texts, one .npy and JSON
 * are read by the service, which has the one reader of such texts; the others here, and written as
 * such texts where they come beside one.
 * @param {File[]} files one, or one for each matrix, which its name tells
 * @returns {Promise<{content: Blob, geometry?: import("./structures.js").GeometryDocument}>}
 */
export async function structureOf(files) {
  const [first] = files;
  if (files.length === 1 && endingOf(first) === "json") return document(await first.text());
  if (files.length === 1 && endingOf(first) === "npy") return { content: new Blob([first], { type: "application/x-npy" }) };
  const market = (await Promise.all(files.map(isMatrixMarket))).some(Boolean);
  const parts = (await Promise.all(files.map(read))).flatMap((part) => Object.entries(part));
  const names = parts.map(([name]) => matrixOf(name));
  // One matrix alone is the stiffness, whatever its name; one text may hold several.
  if (parts.length === 1) names[0] = "K";
  checkNames(files, names);
  const matrices = Object.fromEntries(parts.map(([, matrix], i) => [String(names[i]), matrix]));
  if (market) {
    const ordered = ORDER.flatMap((name) => (name in matrices ? [matrices[name]] : []));
    return { content: new Blob(ordered.flatMap((each) => [each instanceof File ? each : marketText(whole(each)), "\n"]), { type: MARKET }) };
  }
  const placed = together(/** @type {Record<string, Matrix>} */ (matrices));
  const system = { M: { scalar: 1, n: sizeOf(placed.K) }, ...placed, constraints: [] };
  return { content: new Blob([JSON.stringify(system)], { type: "application/json" }) };
}

/**
 * Return matrices in the size of the stiffness, triangles completed. Lists of entries leave out what
 * has no mass or damping: rows are then placed by their nodes and directions.
 * @param {Record<string, Matrix>} matrices @returns {Record<string, any>}
 */
function together(matrices) {
  const { K } = matrices;
  const ends = Array.isArray(K) ? undefined : K.ends;
  return Object.fromEntries(Object.entries(matrices).map(([name, matrix]) => {
    if (!Array.isArray(matrix) && matrix.ends && ends) {
      const places = matrix.ends.map((end) => ends.indexOf(end));
      if (places.includes(-1)) throw new Error(`${name} has nodes or directions that K has not.`);
      /** @param {number} i */
      const place = (i) => (places.length ? places[i] : i);
      const side = Math.max(sizeOf(K), places.length ? 0 : sizeOf(matrix));
      return [name, whole({ shape: [side, side], row: matrix.row.map(place), col: matrix.col.map(place), data: matrix.data })];
    }
    return [name, whole(matrix)];
  }));
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
  return endingOf(file) === "mtx" && /^\s*%+\s*MatrixMarket/im.test(await file.slice(0, 4096).text());
}

/** @param {string} text @returns {{content: Blob, geometry?: any}} */
function document(text) {
  const { geometry, ...system } = JSON.parse(text);
  return { geometry, content: new Blob([JSON.stringify({ constraints: [], ...system })], { type: "application/json" }) };
}

/** @param {File} file @returns {Promise<Record<string, Matrix | File>>} */
async function read(file) {
  const ending = endingOf(file);
  const stem = file.name.replace(/\.[^.]*$/, "");
  if (ending === "npz") return archive(await file.arrayBuffer(), file.name, stem);
  if (ending === "npy") return { [stem]: rows(numpyArray(await file.arrayBuffer(), file.name), file.name) };
  if (ending === "csv" || ending === "txt") return { [stem]: table(await file.text(), file.name) };
  if (ending === "mtx") return { [stem]: await isMatrixMarket(file) ? file : list(await file.text(), file.name) };
  const how = `import numpy, vibroimpact; m = vibroimpact.read_model("${file.name}"); numpy.savez("${stem}.npz", M=m.M.toarray(), K=m.K.toarray())`;
  throw new Error(`The page cannot read ${file.name}. It reads .${ENDINGS.join(", .")}. The Python client reads .mat, .op4, .bdf, .dat and .pch too and writes what can be uploaded here: ${how}`);
}

/** @typedef {{line: number, words: string[], values: number[]}} Row of numbers */

/** @param {string} text @param {string} name @returns {Row[]} the lines that have numbers */
function numbersOf(text, name) {
  const rowsOfNumbers = /** @type {Row[]} */ ([]);
  const semicolons = text.includes(";");
  text.replace(/^\ufeff/, "").split(/\r\n|\r|\n/).forEach((content, i) => {
    const words = content.replace(/[#%*].*$/, "").trim().replace(/\s*[,;]$/, "").split(/\s*[,;]\s*|\s+/);
    if (words.length === 1 && !words[0]) return;
    const line = i + 1;
    if (semicolons && content.includes(",")) throw new Error(`${name}, line ${line}: decimal commas are not read; write points.`);
    const wrong = words.find((word) => !NUMBER.test(word));
    if (wrong !== undefined) throw new Error(`${name}, line ${line}, is a line without numbers: ${content.trim().slice(0, 60)} (${wrong ? `"${wrong.slice(0, 40)}" is not a number` : "an empty field"})`);
    const values = words.map((word) => Number(word.replace(/[dD]/, "e")));
    if (!values.every(Number.isFinite)) throw new Error(`${name}, line ${line}: a number is beyond double precision.`);
    rowsOfNumbers.push({ line, words, values });
  });
  return rowsOfNumbers;
}

/** @param {string} text @param {string} name @returns {number[][]} */
function table(text, name) {
  if (/^\s*%+\s*MatrixMarket/im.test(text)) throw new Error(`${name} is a text of Matrix Market: call it .mtx.`);
  const lines = numbersOf(text, name);
  const wrong = lines.find(({ values }) => values.length !== lines.length);
  if (!lines.length || wrong) {
    throw new Error(`${name} has ${lines.length} lines${wrong ? `, and ${wrong.values.length} numbers in line ${wrong.line}` : ""}; a matrix has as many lines as numbers in each.`);
  }
  return lines.map(({ values }) => values);
}

/** Abaqus: lines of node, direction, node, direction, value, or of row, column, value. @param {string} text @param {string} name @returns {Matrix} */
function list(text, name) {
  const lines = numbersOf(text, name);
  const width = lines.length ? lines[0].values.length : 0;
  const wrong = lines.find(({ values }) => values.length !== width);
  if ((width !== 3 && width !== 5) || wrong) {
    throw new Error(`${name} is neither Matrix Market nor of lines with 3 or 5 numbers, as Abaqus writes them${wrong ? `: line ${wrong.line} has ${wrong.values.length}` : ""}.`);
  }
  const uneven = lines.find(({ values }) => !values.slice(0, -1).every(Number.isInteger));
  if (uneven) throw new Error(`${name}, line ${uneven.line}: an index is not whole.`);
  const data = lines.map(({ values }) => values[width - 1]);
  if (width === 3) {
    checkSizes(lines, name);
    const low = Math.min(...lines.map(({ values }) => Math.min(values[0], values[1])));
    const first = low === 0 && lines.some(({ values: [i, j] }) => i === 0 && j === 0) ? 0 : 1;
    const out = lines.find(({ values: [i, j] }) => Math.min(i, j) < first);
    if (out) throw new Error(`${name}, line ${out.line}: an index below 1.`);
    const [row, col] = [0, 1].map((k) => lines.map(({ values }) => values[k] - first));
    const n = 1 + [...row, ...col].reduce((a, b) => Math.max(a, b), 0);
    return { shape: [n, n], row, col, data, ends: [] };
  }
  const pairs = lines.flatMap(({ values }) => [[values[0], values[1]], [values[2], values[3]]]);
  const ordered = [...pairs].sort(([a, b], [c, d]) => a - c || b - d).map((end) => end.join());
  const index = new Map([...new Set(ordered)].map((end, i) => [end, i]));
  /** @param {number} k */
  const places = (k) => lines.map(({ values }) => Number(index.get(`${values[k]},${values[k + 1]}`)));
  return { shape: [index.size, index.size], row: places(0), col: places(2), data, ends: [...index.keys()] };
}

/** Refuse a first line that can be the size of a matrix whose header was lost. @param {Row[]} lines @param {string} name */
function checkSizes([first, ...others], name) {
  const whole = (/** @type {string} */ word) => /^[+-]?\d+$/.test(word);
  const [i, j, announced] = first.values;
  if (!others.length || !first.words.every(whole) || others.some(({ values }) => values[0] > i || values[1] > j)) return;
  const repeated = others.some(({ values }) => values[0] === i && values[1] === j);
  const cut = announced > others.length && announced <= i * j && !others.every(({ words }) => whole(words[2]));
  if (announced === others.length || repeated || cut) {
    throw new Error(`${name}, line ${first.line}: it can be an entry, or the size of a matrix whose header was lost. Put %%MatrixMarket matrix coordinate real general before it, or write its value with a decimal point.`);
  }
}

/** @param {Matrix} matrix @returns {string} as a text of Matrix Market */
function marketText(matrix) {
  const lines = Array.isArray(matrix)
    ? matrix.flatMap((row, i) => row.flatMap((value, j) => (value ? [`${i + 1} ${j + 1} ${value}`] : [])))
    : matrix.data.map((value, e) => `${matrix.row[e] + 1} ${matrix.col[e] + 1} ${value}`);
  const n = sizeOf(matrix);
  return ["%%MatrixMarket matrix coordinate real general", `${n} ${n} ${lines.length}`, ...lines].join("\n");
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
  const { row, col, data } = matrix;
  const shape = [...matrix.shape];
  if (data.some((value, e) => value !== 0 && row[e] < col[e]) && data.some((value, e) => value !== 0 && row[e] > col[e])) return { shape, row, col, data };
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
