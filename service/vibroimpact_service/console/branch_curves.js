// Branches of periodic motions as curves that turn back, with their special points.

/** @typedef {import("./curve.js").Path} Path */
/** @typedef {{Omega: number, height: number, exists: boolean, impacts: number, stability: number | null, reason: string,
 *   periods: number, phases: number[] | null, sequence: {constraint: number, side: string}[]}} Motion one of the
 *   response; phases: of its impacts, where several are to be looked for; null: those of the request */
/** @typedef {{kind: string, Omega: number, height: number, exists: boolean}} Special */

/** The states of a motion and their lines; they are told apart without colours. */
const LINES = {
  stable: { colour: "stable", width: 2.6 },
  unstable: { colour: "unstable", width: 1.8, dash: [6, 4] },
  phantom: { colour: "phantom", width: 1, dash: [2, 3] },
};

/** @param {{exists: boolean, stability: number | null}} motion @returns {"stable" | "unstable" | "phantom"} */
export function stateOf({ exists, stability }) {
  if (!exists) return "phantom";
  return stability !== null && stability < 1 ? "stable" : "unstable";
}

/**
 * Return the motions in a table of solutions, of periodic motions or of branches.
 * @param {any} result
 * @param {number} dof coordinate whose amplitude is their height
 * @param {number} periods of the drive in one of the motion, where the table has none
 * @returns {Motion[]}
 */
export function motionsOf({ solution, impact, dof: dofs }, dof, periods) {
  const column = Math.max(0, dofs.indexOf(dof));
  /** @type {number[][]} */
  const struck = solution.Omega.map(() => []);
  impact.solution.forEach((/** @type {number} */ row, /** @type {number} */ i) => struck[row].push(i));
  return solution.Omega.map((/** @type {number} */ Omega, /** @type {number} */ i) => ({
    // null where there is no bounded motion: it has no place in the curve.
    Omega, height: solution.x_max[i][column] === null ? NaN : (solution.x_max[i][column] - solution.x_min[i][column]) / 2, exists: solution.exists[i], impacts: solution.impacts[i],
    stability: solution.stability[i], reason: solution.reason[i], periods: solution.periods ? solution.periods[i] : periods,
    phases: solution.branch && struck[i].length > 1 ? struck[i].map((each) => impact.phase[each]) : null,
    sequence: struck[i].map((each) => ({ constraint: impact.constraint[each], side: impact.side[each] > 0 ? "upper" : "lower" })),
  }));
}

/**
 * Return the lines of motions that follow one another.
 * @param {Motion[]} motions
 * @returns {Path[]}
 */
export function lines(motions) {
  /** @type {Path[]} */
  const paths = [];
  let before = "";
  motions.forEach((motion, i) => {
    const state = stateOf(motion);
    /** @type {[number, number]} */
    const point = [motion.Omega, motion.height];
    if (state !== before) {
      // From the last point of the other state on, so that the line has no gap.
      const last = motions[i - 1];
      paths.push({ ...LINES[state], points: last ? [[last.Omega, last.height]] : [] });
    }
    paths[paths.length - 1].points.push(point);
    before = state;
  });
  return paths;
}

/**
 * Return the branches with impacts, each in its order.
 * @param {any} result of branches
 * @param {Motion[]} motions those in its table
 * @returns {Motion[][]}
 */
export function branchesOf({ solution }, motions) {
  /** @type {Motion[][]} */
  const branches = [];
  motions.forEach((motion, i) => {
    const number = solution.branch[i];
    (branches[number] = branches[number] || []).push(motion);
  });
  return branches;
}

/**
 * Return the special points with the heights of the branches there.
 * @param {any} result of branches
 * @param {Motion[][]} branches
 * @returns {Special[]}
 */
export function specialPoints({ points }, branches) {
  /** @type {number[]} */
  const reached = [];
  return points.map((/** @type {any} */ { branch: number, type: kind, Omega, exists }) => {
    const branch = branches[number] || [];
    const segment = segmentOf(branch, kind, Omega, reached[number] || 0);
    reached[number] = segment;
    const [a, b] = [branch[segment], branch[Math.min(segment + 1, branch.length - 1)]];
    const part = a && b.Omega !== a.Omega ? Math.min(Math.max((Omega - a.Omega) / (b.Omega - a.Omega), 0), 1) : 0;
    return { kind, Omega, exists, height: a ? a.height + part * (b.height - a.height) : NaN };
  });
}

/**
 * Return the segment of a branch on which a special point lies. The points are listed in the order
 * of the branch; where it turns back, several segments pass a frequency.
 * @param {Motion[]} branch @param {string} kind @param {number} Omega @param {number} first
 */
function segmentOf(branch, kind, Omega, first) {
  let [best, least] = [first, Infinity];
  for (let k = first; k < branch.length - 1; k += 1) {
    const [a, b] = [branch[k], branch[k + 1]];
    const outside = Math.max(Math.min(a.Omega, b.Omega) - Omega, Omega - Math.max(a.Omega, b.Omega), 0);
    const changes = kind === "end" || kind === "grazing" ? a.exists !== b.exists : stateOf(a) !== stateOf(b);
    // A fold lies beside its segment; the others lie on theirs, most often where the state changes.
    const distance = outside + (changes || kind === "fold" ? 0 : 1e-6);
    if (distance < least) [best, least] = [k, distance];
  }
  return best;
}

const TURN = 2 * Math.PI;
/** Impacts up to which all ways are tried in which their phases may be spread over several periods. */
const SPREAD = 8;

/**
 * Return the phases of the impacts of one motion in all ways in which they can follow one another:
 * results give them within one period of the drive, and the motion may last several.
 * @param {number[]} phases in the order of the impacts
 * @param {number} periods
 * @returns {number[][]}
 */
export function unwrapped(phases, periods) {
  const count = phases.length;
  const gaps = phases.map((phase, j) => ((((phases[(j + 1) % count] - phase) % TURN) + TURN) % TURN) / TURN);
  const left = Math.round(periods - gaps.reduce((a, b) => a + b, 0));
  /** @type {number[][]} whole periods that are added to each gap */
  let ways = [[]];
  for (const gap of gaps) {
    const even = Math.max(0, periods / count - gap);
    const choices = count <= SPREAD ? [...new Set([Math.floor(even), Math.ceil(even)])] : [Math.round(even)];
    ways = ways.flatMap((way) => choices.map((each) => [...way, each]));
  }
  return ways.filter((way) => way.reduce((a, b) => a + b, 0) === left).map((way) => {
    let phase = phases[0];
    return phases.map((_, j) => {
      const here = phase;
      phase += TURN * (gaps[j] + way[j]);
      return here;
    });
  });
}

/**
 * Return where in the period impacts are, 0 to 1: among all places with their phases those at which
 * the struck coordinate is nearest to its wall.
 * @param {{phase: number, stop: number, side: number}[]} impacts
 * @param {number} periods
 * @param {(impact: {stop: number, side: number}, place: number) => number} apart distance from the wall
 * @returns {number[]}
 */
export function placesOf(impacts, periods, apart) {
  /** @type {Set<string>} */
  const taken = new Set();
  return impacts.map((impact) => {
    const places = Array.from({ length: periods }, (_, k) => (impact.phase / TURN + k) / periods).filter((place) => !taken.has(`${impact.stop} ${impact.side} ${place.toFixed(9)}`));
    const place = places.reduce((best, each) => (apart(impact, each) < apart(impact, best) ? each : best), places[0] || 0);
    taken.add(`${impact.stop} ${impact.side} ${place.toFixed(9)}`);
    return place;
  });
}
