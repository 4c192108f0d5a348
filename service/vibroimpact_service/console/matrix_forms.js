// Matrices in the forms of the contract: their size and their entries.

/** @param {any} matrix in any form of the contract @returns {number} */
export function rows(matrix) {
  if (Array.isArray(matrix)) return matrix.length;
  if (matrix.diagonal) return matrix.diagonal.length;
  if (matrix.bands) return matrix.bands["0"] ? matrix.bands["0"].length : 0;
  return matrix.shape ? matrix.shape[0] : matrix.n;
}

/** @param {any} matrix @param {number} n @returns {Generator<[number, number, number]>} row, column, value */
export function* entries(matrix, n) {
  if (Array.isArray(matrix)) {
    for (let i = 0; i < n; i += 1) for (let j = 0; j < n; j += 1) if (matrix[i][j]) yield [i, j, matrix[i][j]];
  } else if (matrix.bands) {
    for (const [offset, row] of Object.entries(matrix.bands)) {
      for (let i = 0; i < row.length; i += 1) {
        yield [i, i + Number(offset), row[i]];
        if (Number(offset)) yield [i + Number(offset), i, row[i]];
      }
    }
  } else if (matrix.data) {
    for (let e = 0; e < matrix.data.length; e += 1) yield [matrix.row[e], matrix.col[e], matrix.data[e]];
  } else {
    for (let i = 0; i < n; i += 1) yield [i, i, matrix.diagonal ? matrix.diagonal[i] : matrix.scalar];
  }
}
