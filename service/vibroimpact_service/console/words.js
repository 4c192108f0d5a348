// What results say, in words.

import { shown } from "./numbers.js";

/** @type {Record<string, string>} */
export const REASONS = {
  ok: "admissible",
  negative_impulse: "phantom: a stop would have to pull",
  wrong_velocity: "phantom: it would leave the stop before the impact",
  penetration: "phantom: a stop is passed between impacts",
  singular: "phantom: no impulse gives this motion",
};

/** @param {string} reason */
export function reasonInWords(reason) {
  return REASONS[reason] || reason.replaceAll("_", " ");
}

/**
 * Say why a solution is a motion of the structure or not, and where.
 * @param {string} reason
 * @param {{impulses: number[], active: number[], names: string[], velocities?: number[]}} solution
 * @param {{name: string, value: number, limit: number, time: number} | null} place where a stop is passed
 * @param {boolean} decided whether the verdict holds in spite of roundings
 */
export function whyPhantom(reason, { impulses, active, names }, place, decided) {
  if (!decided && reason !== "singular") {
    return `Rounding decides here, and the verdict is a guess (${reasonInWords(reason)}). So it is at the edges of bands, and where the stops are hardly touched (p = ${shown(Math.max(...impulses), 3)}) because a natural mode keeps the motion up without them.`;
  }
  if (reason === "ok") return "It is a motion of the structure: all stops push, and no limit is passed between impacts.";
  if (reason === "negative_impulse") {
    const pulling = active.filter((_, i) => impulses[i] <= 0);
    const who = pulling.map((stop) => names[stop]).join(" and ");
    const least = Math.min(...impulses);
    return `${who || "A stop"} would have to pull the structure (p = ${shown(least, 4)}). Stops can only push, so this solution of the equations is not a motion.`;
  }
  if (reason === "penetration" && place) {
    return `Between impacts ${place.name} is passed: the displacement reaches ${shown(place.value, 4)} where the stop stands at ${shown(place.limit, 4)}, at t/T = ${shown(place.time, 3)}. The impulses are right, but the way between them leads through a stop.`;
  }
  if (reason === "penetration") return "Between impacts a stop is passed, so there would be an impact that the solution does not have.";
  if (reason === "wrong_velocity") return "Just before its impact the structure would move away from the stop, so it would have come through the stop from behind.";
  if (reason === "singular") return "At this frequency the equations have no solution, or no impulse is needed: a natural mode of the structure resonates.";
  return reasonInWords(reason);
}

/** Impact modes lose nothing, so that no deviation from them decays. */
export const NEUTRAL = "neutral: deviations neither grow nor decay";

/** @param {number | null} radius largest modulus of the half-period map @param {number | null} error null: not bounded @param {boolean} neutral whether the radius is 1 within its error */
export function stabilityInWords(radius, error, neutral) {
  if (radius === null || error === null) return "not known";
  if (neutral) return NEUTRAL;
  return `unstable: deviations grow ${shown(radius, 3)} times per half period`;
}

/** @param {import("./structures.js").Stop} stop @param {number} index */
export function stopName(stop, index) {
  const place = stop.relativeTo === null || stop.relativeTo === undefined ? `coordinate ${stop.dof}` : `coordinates ${stop.dof} and ${stop.relativeTo}`;
  return `stop ${index} at ${place}`;
}
