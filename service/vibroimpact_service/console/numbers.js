// Numbers as text, and small numerics.

/**
 * Return a number with a few significant digits.
 * @param {number | null | undefined} value
 * @param {number} [digits]
 */
export function shown(value, digits = 5) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  const text = size >= 1e6 || size < 1e-4 ? value.toExponential(Math.max(0, digits - 2)).replace(/\.?0+e/, "e") : Number(value.toPrecision(digits)).toString();
  return text.replace("e+", "e").replaceAll("-", "−");
}

/**
 * Return the power of ten that the labels of an axis leave out: 0 unless they would be long.
 * @param {[number, number]} range
 */
export function leftOutPower([low, high]) {
  const size = Math.max(Math.abs(low), Math.abs(high));
  return size > 0 && (size < 1e-3 || size >= 1e6) ? 3 * Math.floor(Math.log10(size) / 3 + 1e-12) : 0;
}

/** @param {string} label of an axis @param {number} power that its numbers leave out @returns {string} */
export function inPower(label, power) {
  return power ? `${label}, in 10${String(power).replace(/[-\d]/g, (sign) => (sign === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[Number(sign)]))}` : label;
}

/** @param {number} low @param {number} high @param {number} count */
export function linspace(low, high, count) {
  return Array.from({ length: count }, (_, i) => low + ((high - low) * i) / Math.max(1, count - 1));
}

/** @param {number} seconds */
export function duration(seconds) {
  if (seconds < 1e-3) return `${shown(1e6 * seconds, 2)} µs`;
  if (seconds < 1) return `${shown(1e3 * seconds, 2)} ms`;
  if (seconds < 120) return `${shown(seconds, 2)} s`;
  return seconds < 7200 ? `${shown(seconds / 60, 2)} min` : `${shown(seconds / 3600, 2)} h`;
}

/** @param {number} size */
export function bytes(size) {
  const units = ["B", "kB", "MB", "GB"];
  let step = 0;
  for (; size >= 1000 && step < units.length - 1; step += 1) size /= 1000;
  return `${shown(size, 3)} ${units[step]}`;
}

/**
 * Return the index of the value nearest to a number in an ascending list.
 * @param {ArrayLike<number>} ascending
 * @param {number} value
 */
export function nearest(ascending, value) {
  let low = 0;
  let high = ascending.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (ascending[middle] <= value) low = middle;
    else high = middle;
  }
  return Math.abs(ascending[low] - value) <= Math.abs(ascending[high] - value) ? low : high;
}

/**
 * Return a row of a table of numbers at a fractional index, cubic between the rows.
 * @param {ArrayLike<number>[]} rows
 * @param {number} place 0 to rows.length - 1
 * @param {Float64Array} into
 */
export function interpolated(rows, place, into) {
  const last = rows.length - 1;
  const at = Math.min(Math.max(Math.floor(place), 0), Math.max(0, last - 1));
  const s = Math.min(Math.max(place - at, 0), 1);
  const [a, b, c, d] = [rows[Math.max(0, at - 1)], rows[at], rows[Math.min(last, at + 1)], rows[Math.min(last, at + 2)]];
  for (let i = 0; i < into.length; i += 1) {
    // At the ends, the missing neighbour lies on the parabola through the others.
    const before = at > 0 ? a[i] : 3 * b[i] - 3 * c[i] + d[i];
    const after = at + 2 <= last ? d[i] : 3 * c[i] - 3 * b[i] + a[i];
    const m = (c[i] - before) / 2;
    const n = (after - b[i]) / 2;
    const t = s * s;
    into[i] = b[i] + m * s + (3 * (c[i] - b[i]) - 2 * m - n) * t + (2 * (b[i] - c[i]) + m + n) * t * s;
  }
  return into;
}

/** @param {number} number whole @returns {string} */
export function subscript(number) {
  return String(number).replace(/\d/g, (digit) => "₀₁₂₃₄₅₆₇₈₉"[Number(digit)]);
}
