// Branches of periodic motions as curves that turn back, with their special points.

/** @typedef {import("./curve.js").Path} Path */
/** @typedef {{Omega: number, height: number, exists: boolean, impacts: number, stability: number | null, neutral: boolean, reason: string,
 *   periods: number, phases: number[] | null, sequence: {constraint: number, side: string}[]}} Motion one of the
 *   response; phases: of its impacts, where several are to be looked for; null: those of the request */
/** @typedef {{kind: string, Omega: number, height: number, exists: boolean, segment: number}} Special segment: index of
 *   the motion before it on its branch */

/** The states of a motion and their lines; they are told apart without colours. */
/** @satisfies {Record<string, {colour: string, width: number, dash?: number[]}>} */
export const LINES = {
  stable: { colour: "stable", width: 2.6, dash: [] },
  neutral: { colour: "neutral", width: 2.2, dash: [10, 3, 2, 3] },
  unstable: { colour: "unstable", width: 1.8, dash: [6, 4] },
  phantom: { colour: "phantom", width: 1, dash: [2, 3] },
};

/** @param {{exists: boolean, stability: number | null, neutral: boolean}} motion @returns {"stable" | "neutral" | "unstable" | "phantom"} */
export function stateOf(motion) {
  return motion.exists ? stabilityOf(motion) : "phantom";
}

/** @param {{stability: number | null, neutral: boolean}} motion @returns {"stable" | "neutral" | "unstable"} */
function stabilityOf({ stability, neutral }) {
  if (neutral) return "neutral";
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
    Omega, height: solution.x_max[i][column] === null ? NaN : (solution.x_max[i][column] - solution.x_min[i][column]) / 2, exists: solution.exists[i], impacts: solution.impacts[i] + (solution.contacts ? solution.contacts[i] : 0),
    stability: solution.stability[i], neutral: Boolean(solution.neutral && solution.neutral[i]), reason: solution.reason[i], periods: solution.periods ? solution.periods[i] : periods,
    phases: solution.branch && struck[i].length > 1 ? struck[i].map((each) => impact.phase[each]) : null,
    sequence: struck[i].map((each) => ({ constraint: impact.constraint[each], side: impact.side[each] > 0 ? "upper" : "lower" })),
  }));
}

const OF_STABILITY = ["fold", "flip", "torus", "symmetry"];
const OF_EXISTENCE = ["grazing", "end"];

/**
 * Return the lines of motions that follow one another; they change at special points.
 * @param {Motion[]} motions
 * @param {Special[]} special those on the way, in its order
 * @returns {Path[]}
 */
export function lines(motions, special) {
  /** @type {Path[]} */
  const paths = [];
  let state = "";
  /** @param {[number, number]} point @param {keyof LINES} next */
  const draw = (point, next) => {
    if (paths.length) paths[paths.length - 1].points.push(point);
    if (next !== state) paths.push({ ...LINES[next], label: next, points: [point] });
    state = next;
  };
  motions.forEach((motion, i) => {
    draw([motion.Omega, motion.height], stateOf(motion));
    const next = motions[i + 1];
    if (!next) return;
    let [how, there] = [stabilityOf(motion), motion.exists];
    const located = special.filter(({ segment }) => segment === i);
    // Where nothing was located, the middle is as likely as any other place.
    const middle = { kind: "", Omega: (motion.Omega + next.Omega) / 2, height: (motion.height + next.height) / 2 };
    const here = located.length || stateOf(motion) === stateOf(next) ? located : [middle];
    const [turning, passing] = [change(here, OF_STABILITY, how !== "unstable"), change(here, OF_EXISTENCE, there)];
    for (const each of here) {
      if (each === turning) how = stabilityOf(next);
      if (each === passing) there = next.exists;
      draw([each.Omega, each.height], there ? how : "phantom");
    }
  });
  return paths;
}

/**
 * Return the point of a segment at which what the kinds tell changes, if it does. Motions lose their stability at the
 * first such point, and regain it at the last; so they do their existence. Where there is none, it is lost or regained
 * at any other, as at a grazing.
 * @template {{kind: string}} Place
 * @param {Place[]} points @param {string[]} kinds @param {boolean} first
 * @returns {Place | undefined}
 */
function change(points, kinds, first) {
  const some = points.filter(({ kind }) => kinds.includes(kind));
  const all = some.length ? some : points;
  return first ? all[0] : all[all.length - 1];
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
 * Return the special points of each branch with their heights.
 * @param {any} result of branches
 * @param {Motion[][]} branches
 * @returns {Special[][]}
 */
export function specialPoints({ solution, points }, branches) {
  const first = branches.map((_, number) => solution.branch.indexOf(number));
  /** @type {Special[][]} */
  const placed = branches.map(() => []);
  for (const { branch, type: kind, Omega, exists, solution: row, along } of points) {
    const segment = row - first[branch];
    const [a, b] = [branches[branch][segment], branches[branch][segment + 1]];
    placed[branch].push({ kind, Omega, exists, segment, height: b ? a.height + along * (b.height - a.height) : a.height });
  }
  return placed;
}

/**
 * Return special points of motions at ascending frequencies for other motions of the same branch.
 * @param {Special[]} special
 * @param {Motion[]} motions at ascending frequencies
 * @returns {Special[]}
 */
export function between(special, motions) {
  return special.map((each) => {
    const after = motions.findIndex(({ Omega }) => Omega >= each.Omega);
    const segment = Math.max(0, (after < 0 ? motions.length : after) - 1);
    const [a, b] = [motions[segment], motions[Math.min(segment + 1, motions.length - 1)]];
    const along = b.Omega > a.Omega ? Math.min(Math.max((each.Omega - a.Omega) / (b.Omega - a.Omega), 0), 1) : 0;
    return { ...each, segment, height: a.height + along * (b.height - a.height) };
  }).sort((a, b) => a.Omega - b.Omega);
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
