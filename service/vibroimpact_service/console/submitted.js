// The requests of the jobs queued from this browser, so that they can be changed and sent again.

const STORED = "vibroimpact-submitted";
const KEPT = 40;

/** @returns {Record<string, {kind: string, request: any, address: string}>} by the digest of the result */
function all() {
  try {
    return JSON.parse(localStorage.getItem(STORED) || "{}");
  } catch {
    return {};
  }
}

/** @param {string} digest @param {string} kind @param {any} request */
export function remember(digest, kind, request) {
  const entries = Object.entries(all()).filter(([name]) => name !== digest).slice(1 - KEPT);
  const text = JSON.stringify(Object.fromEntries([...entries, [digest, { kind, request, address: location.hash }]]));
  if (text.length < 2_000_000) localStorage.setItem(STORED, text);
}

/** @param {string} digest */
export function submitted(digest) {
  return all()[digest] || null;
}
