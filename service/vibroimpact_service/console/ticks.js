// Round numbers along an axis.

/**
 * Return round numbers between two others, with steps of 1, 2 or 5 times a power of ten.
 * @param {number} low @param {number} high @param {number} count how many at most
 * @returns {number[]}
 */
export function linearTicks(low, high, count) {
  const least = (high - low) / Math.max(1, count);
  if (!(least > 0) || !Number.isFinite(least)) return [];
  const power = 10 ** Math.floor(Math.log10(least));
  const step = power * ([1, 2, 5].find((factor) => factor * power >= least * (1 - 1e-9)) || 10);
  const ticks = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i += 1) ticks.push(Number((i * step).toPrecision(12)));
  return ticks;
}

/** Leading digits of the numbers on a logarithmic axis, from many to few. */
const LEADING = [[1, 2, 3, 4, 5, 6, 7, 8, 9], [1, 2, 3, 5, 7], [1, 2, 5], [1, 3], [1]];

/**
 * Return round numbers between two positive ones for a logarithmic axis.
 * @param {number} low @param {number} high @param {number} count how many at most
 * @returns {number[]}
 */
export function logTicks(low, high, count) {
  const [from, to] = [Math.floor(Math.log10(low)), Math.ceil(Math.log10(high))];
  /** @param {number[]} digits @param {number} step of decades */
  const ticks = (digits, step) => {
    const values = [];
    for (let power = step * Math.ceil(from / step); power <= to; power += step) {
      for (const digit of digits) values.push(Number(`${digit}e${power}`));
    }
    return values.filter((value) => value >= low * (1 - 1e-12) && value <= high * (1 + 1e-12));
  };
  const most = Math.max(2, count);
  for (const digits of LEADING) {
    const values = ticks(digits, 1);
    if (values.length < 3) break;
    if (values.length <= most) return values;
  }
  if (high / low < 1000) return linearTicks(low, high, most);
  let step = 1;
  while (ticks([1], step).length > most) step += 1;
  return ticks([1], step);
}
