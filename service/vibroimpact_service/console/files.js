// Files of structures, which go to the service as they are: it has the one reader of each format.

/** Endings of the files that can be chosen. */
export const ENDINGS = ["mtx", "npy", "npz", "csv", "txt", "op4", "pch", "bdf", "dat", "nas", "sti", "mas", "dof", "matrix", "mapping", "hb", "rb", "rsa", "rua", "gz", "json", "mat"];

/**
 * Return what the service stores, and the geometry beside it.
 * @param {File[]} files one, or one for each matrix, which its name tells
 * @returns {Promise<{content: Blob | FormData, geometry?: import("./structures.js").GeometryDocument}>}
 */
export async function structureOf(files) {
  const [first] = files;
  if (files.length === 1 && endingOf(first) === "json") return document(await first.text());
  const matlab = files.find((file) => endingOf(file) === "mat");
  if (matlab) throw new Error(withoutMatlab(matlab.name));
  const content = new FormData();
  for (const file of files) content.append("file", file, file.name);
  return { content };
}

/** @param {File} file */
function endingOf({ name }) {
  return (name.split(".").pop() || "").toLowerCase();
}

/** @param {string} text @returns {{content: Blob, geometry?: any}} */
function document(text) {
  const { geometry, ...system } = JSON.parse(text);
  return { geometry, content: new Blob([JSON.stringify({ constraints: [], ...system })], { type: "application/json" }) };
}

/** @param {string} name @returns {string} the way from a file of Matlab to one that the service reads */
function withoutMatlab(name) {
  const archive = name.replace(/\.[^.]*$/, ".npz");
  const how = `import numpy, vibroimpact; m = vibroimpact.read_model("${name}"); numpy.savez("${archive}", M=m.M.toarray(), K=m.K.toarray())`;
  return `The service cannot read ${name}: files of Matlab are read by the Python client, which writes what can be uploaded here: ${how}`;
}
