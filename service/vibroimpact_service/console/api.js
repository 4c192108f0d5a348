// Requests to the service that delivered this page.

export class Problem extends Error {
  constructor(document, status) {
    super(document.detail || `HTTP ${status}`);
    this.status = status;
    this.document = document;
  }
}

const STORED = "vibroimpact-key";

export function key() {
  return sessionStorage.getItem(STORED) || "";
}

export function keep(text) {
  if (text) sessionStorage.setItem(STORED, text);
  else sessionStorage.removeItem(STORED);
}

export async function ask(method, path, body, headers = {}) {
  const sent = { Accept: "application/json", ...headers };
  if (body !== undefined) sent["Content-Type"] = "application/json";
  if (key()) sent.Authorization = `Bearer ${key()}`;
  const text = body === undefined || typeof body === "string" ? body : JSON.stringify(body);
  const answer = await fetch(path, { method, headers: sent, body: text });
  const document = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Problem(document, answer.status);
  return { status: answer.status, headers: answer.headers, document };
}
