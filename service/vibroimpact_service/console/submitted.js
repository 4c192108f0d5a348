// What this browser knows of jobs: their requests, so that they can be changed and sent again, the
// names that they were given, and whether they were made by a view or taken off the list.

const STORED = "vibroimpact-submitted";
const KEPT = 120;
/** Characters of all that is kept. */
const LARGEST = 2_000_000;

/**
 * @typedef {{kind?: string, request?: any, address?: string, structure?: string, name?: string,
 *   looked?: boolean, removed?: boolean}} Known looked: it was made by a view while one looked, not queued
 */

/** @returns {Record<string, Known>} by the digest of the result */
function all() {
  try {
    return JSON.parse(localStorage.getItem(STORED) || "{}");
  } catch {
    return {};
  }
}

/** @param {string} digest @param {Known} more what is known of a job now, beside what was */
export function remember(digest, more) {
  const now = all();
  const entries = Object.entries({ ...now, [digest]: { ...now[digest], ...more } });
  // The earliest are forgotten first.
  let kept = entries.slice(-KEPT);
  while (kept.length > 1 && JSON.stringify(kept).length > LARGEST) kept = kept.slice(1);
  const text = JSON.stringify(Object.fromEntries(kept));
  if (text.length <= LARGEST) localStorage.setItem(STORED, text);
}

/** @param {string} digest @returns {Known} */
export function submitted(digest) {
  return all()[digest] || {};
}
