// Ranges of values that show curves, with and without poles.

/**
 * Return a range of values that shows all of them, with room around.
 * @param {number[]} values
 * @returns {[number, number]}
 */
export function wholeRange(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) [low, high] = [Math.min(low, value), Math.max(high, value)];
  const pad = 0.08 * (high - low || 1);
  return [low - pad, high + pad];
}

/**
 * Return a range of values that shows a curve with poles: its outermost parts are cut off.
 * @param {number[]} values
 * @returns {[number, number]}
 */
export function rangeWithPoles(values) {
  const used = values.filter(Number.isFinite).sort((a, b) => a - b);
  if (!used.length) return [-1, 1];
  /** @param {number} q */
  const quantile = (q) => used[Math.min(used.length - 1, Math.floor(q * used.length))];
  const low = Math.min(0, quantile(0.02));
  const high = Math.max(0, quantile(0.96));
  const pad = 0.12 * (high - low || 1);
  return [low < 0 ? low - pad : -0.35 * pad, high + pad];
}

/**
 * Return the values with gaps where a curve jumps through a pole.
 * @param {number[]} values
 * @param {[number, number]} range
 * @returns {(number | null)[]}
 */
export function withoutPoles(values, [low, high]) {
  const height = high - low;
  return values.map((value, i) => {
    if (!Number.isFinite(value)) return null;
    const next = values[i + 1];
    const jump = next !== undefined && Math.abs(next - value) > 0.6 * height && next * value < 0;
    // Far outside of the drawing, coordinates of canvases overflow.
    return jump ? null : Math.min(Math.max(value, low - 3 * height), high + 3 * height);
  });
}
