// Natural frequencies of K x = λ M x: Cholesky, Householder's reduction, Sturm's bisection.

/** Above this number of degrees of freedom the page does not compute them. */
export const LARGEST = 400;

/**
 * Return the natural angular frequencies in ascending order; those of negative stiffness are left out.
 * @param {Float64Array[]} M symmetric, positive definite
 * @param {Float64Array[]} K symmetric
 * @returns {number[]} empty where M is not positive definite
 */
export function naturalFrequencies(M, K) {
  const L = cholesky(M);
  if (!L) return [];
  const [diagonal, off] = tridiagonal(congruent(L, K));
  return eigenvalues(diagonal, off).filter((value) => value > 0).map(Math.sqrt);
}

/** @param {Float64Array[]} M @returns {Float64Array[] | null} */
function cholesky(M) {
  const L = M.map((row) => Float64Array.from(row));
  for (let i = 0; i < L.length; i += 1) {
    for (let j = 0; j <= i; j += 1) {
      let sum = L[i][j];
      for (let k = 0; k < j; k += 1) sum -= L[i][k] * L[j][k];
      if (i === j && !(sum > 0)) return null;
      L[i][j] = i === j ? Math.sqrt(sum) : sum / L[j][j];
    }
  }
  return L;
}

/**
 * Return L⁻¹ K L⁻ᵀ.
 * @param {Float64Array[]} L
 * @param {Float64Array[]} K
 */
function congruent(L, K) {
  /** @param {Float64Array[]} rows each is replaced by L⁻¹ of it */
  const solved = (rows) => rows.map((row) => {
    const x = Float64Array.from(row);
    for (let i = 0; i < x.length; i += 1) {
      for (let k = 0; k < i; k += 1) x[i] -= L[i][k] * x[k];
      x[i] /= L[i][i];
    }
    return x;
  });
  const half = solved(K);
  return solved(half.map((_, i) => half.map((row) => row[i])).map((row) => Float64Array.from(row)));
}

/**
 * Return the diagonal and the squares beside it of a tridiagonal matrix with the same eigenvalues.
 * @param {Float64Array[]} A symmetric; overwritten
 * @returns {[number[], number[]]}
 */
function tridiagonal(A) {
  const n = A.length;
  /** @type {number[]} */
  const off = [];
  for (let k = 0; k < n - 1; k += 1) {
    let norm = 0;
    for (let i = k + 1; i < n; i += 1) norm += A[i][k] * A[i][k];
    off.push(norm);
    norm = Math.sqrt(norm);
    if (norm === 0) continue;
    const v = new Float64Array(n);
    for (let i = k + 1; i < n; i += 1) v[i] = A[i][k];
    v[k + 1] += v[k + 1] < 0 ? -norm : norm;
    let size = 0;
    for (let i = k + 1; i < n; i += 1) size += v[i] * v[i];
    const p = new Float64Array(n);
    let product = 0;
    for (let i = k + 1; i < n; i += 1) {
      for (let j = k + 1; j < n; j += 1) p[i] += A[i][j] * v[j];
      p[i] *= 2 / size;
      product += p[i] * v[i];
    }
    for (let i = k + 1; i < n; i += 1) p[i] -= (product / size) * v[i];
    for (let i = k + 1; i < n; i += 1) {
      for (let j = k + 1; j < n; j += 1) A[i][j] -= v[i] * p[j] + p[i] * v[j];
    }
  }
  return [A.map((row, i) => row[i]), off];
}

/**
 * Return all eigenvalues of a symmetric tridiagonal matrix, ascending.
 * @param {number[]} d diagonal
 * @param {number[]} squares of the entries beside it
 */
function eigenvalues(d, squares) {
  let low = Infinity;
  let high = -Infinity;
  d.forEach((value, i) => {
    const radius = Math.sqrt(squares[i] || 0) + Math.sqrt(squares[i - 1] || 0);
    low = Math.min(low, value - radius);
    high = Math.max(high, value + radius);
  });
  /** @param {number} x number of eigenvalues below it */
  const below = (x) => {
    let count = 0;
    let q = 1;
    for (let i = 0; i < d.length; i += 1) {
      q = d[i] - x - (i ? squares[i - 1] / (q || 1e-300) : 0);
      if (q < 0) count += 1;
    }
    return count;
  };
  return d.map((_, index) => {
    let [a, b] = [low, high];
    for (let step = 0; step < 60 && b - a > 1e-12 * Math.max(Math.abs(a), Math.abs(b)); step += 1) {
      const middle = (a + b) / 2;
      if (below(middle) > index) b = middle;
      else a = middle;
    }
    return (a + b) / 2;
  });
}
