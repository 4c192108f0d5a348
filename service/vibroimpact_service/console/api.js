// Requests to the service that delivered this page.

import { remember, submitted } from "./submitted.js";

/**
 * @typedef {{pointer: string, parameter?: string | null, code: string, message: string}} Fault
 * @typedef {{detail?: string, title?: string, errors?: Fault[], request_id?: string}} ProblemDocument
 * @typedef {{id: string, version: number, kind: string, state: string, final: boolean, phase: string,
 *   waiting_reason: string | null, progress: {done: number, total: number}, created: string, name?: string | null,
 *   started: string | null, finished: string | null, attempts: number, error: ProblemDocument | null,
 *   result: string | null, digest: string, reused: boolean, estimate: number | null}} Job
 */

/** An error that the service answered, by its problem document. */
export class Problem extends Error {
  /** @param {ProblemDocument} document @param {number} status */
  constructor(document, status) {
    super(document.detail || document.title || `HTTP ${status}`);
    this.status = status;
    /** @type {Fault[]} */
    this.faults = document.errors || [];
    this.requestId = document.request_id || "";
  }
}

/** The service did not answer at all. */
export class Away extends Error {}

const STORED = "vibroimpact-key";
/** Times that a request is sent again to a busy service. */
const PATIENCE = 20;

export function key() {
  return sessionStorage.getItem(STORED) || "";
}

/** @param {string} text */
export function keep(text) {
  if (text) sessionStorage.setItem(STORED, text);
  else sessionStorage.removeItem(STORED);
}

/**
 * Send a request and return the answer, whatever its type.
 * @param {string} method
 * @param {string} path
 * @param {any} [body] a document, or a Blob or the parts of a form, which are sent as they are
 * @param {Record<string, string>} [headers]
 * @param {AbortSignal} [signal]
 */
export async function send(method, path, body, headers = {}, signal) {
  /** @type {Record<string, string>} */
  const sent = { Accept: "application/json", ...headers };
  const form = body instanceof FormData; // the browser names its boundary
  const raw = form || body instanceof Blob;
  if (body !== undefined && !form && !sent["Content-Type"]) sent["Content-Type"] = body instanceof Blob ? body.type : "application/json";
  if (key()) sent.Authorization = `Bearer ${key()}`;
  const content = body === undefined || raw ? body : JSON.stringify(body);
  let answer;
  for (let left = PATIENCE; ; left -= 1) {
    try {
      answer = await fetch(path, { method, headers: sent, signal, body: content });
    } catch (error) {
      if (error instanceof DOMException && error.name === "AbortError") throw error;
      throw new Away("The service does not answer.");
    }
    // A busy service says when to come again; nothing of the request was done.
    const pause = Number(answer.headers.get("Retry-After"));
    if (answer.status !== 503 || !(pause > 0) || !left) break;
    await new Promise((resolve) => { setTimeout(resolve, 1000 * pause); });
  }
  if (!answer.ok) throw new Problem(await answer.json().catch(() => ({})), answer.status);
  return answer;
}

/**
 * Send a request and return the document of the answer.
 * @param {string} method
 * @param {string} path
 * @param {any} [body]
 * @param {AbortSignal} [signal]
 * @returns {Promise<any>}
 */
export async function ask(method, path, body, signal) {
  const answer = await send(method, path, body, {}, signal);
  return answer.json();
}

/**
 * Compute, and wait for the job where the service makes one.
 * @param {string} kind
 * @param {any} request
 * @param {{signal?: AbortSignal, onJob?: (job: Job) => void, queued?: boolean}} [options] queued: by a
 *   job from the beginning, so that what takes seconds holds up no answers to the cursor
 * @returns {Promise<any>} the result
 */
export async function compute(kind, request, { signal, onJob, queued } = {}) {
  /** @type {Record<string, string>} */
  const headers = queued ? { Prefer: "respond-async" } : {};
  const answer = await send("POST", `/v1/compute/${kind}`, request, headers, signal);
  const document = await answer.json();
  if (answer.status !== 202) return document;
  // The list of jobs is of those that were queued.
  remember(document.digest, { looked: true, ...submitted(document.digest) });
  if (onJob) onJob(document);
  // What the page no longer waits for need not be computed.
  if (signal) signal.addEventListener("abort", () => { ask("DELETE", `/v1/jobs/${document.id}`).catch(() => {}); }, { once: true });
  const job = await follow(document, (now) => onJob && onJob(now), signal);
  if (job.state === "succeeded") return ask("GET", `/v1/jobs/${job.id}/result`, undefined, signal);
  throw new Problem(job.error || { detail: `The job was ${job.state}.` }, 500);
}

/**
 * Follow a job until it is final, by its events; cut connections are taken up again.
 * @param {Job} job
 * @param {(job: Job) => void} onChange
 * @param {AbortSignal} [signal]
 * @returns {Promise<Job>}
 */
export async function follow(job, onChange, signal) {
  let last = job;
  for (let pause = 250; !last.final; pause = Math.min(2 * pause, 8000)) {
    try {
      const answer = await send("GET", `/v1/jobs/${last.id}/events`, undefined, {
        Accept: "text/event-stream", "Last-Event-ID": String(last.version),
      }, signal);
      if (answer.status === 204) last = await ask("GET", `/v1/jobs/${last.id}`, undefined, signal);
      else for await (const data of events(answer)) {
        pause = 250;
        last = JSON.parse(data);
        onChange(last);
      }
    } catch (error) {
      if (!(error instanceof Away || (error instanceof Problem && error.status >= 500) || error instanceof TypeError)) throw error;
    }
    if (!last.final) await new Promise((resolve) => { setTimeout(resolve, pause); });
    if (signal && signal.aborted) throw new DOMException("aborted", "AbortError");
  }
  return last;
}

/**
 * Yield the data of the events of a stream.
 * @param {Response} answer
 */
async function* events(answer) {
  if (!answer.body) return;
  const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return;
    const parts = (rest + value.replaceAll("\r", "")).split("\n\n");
    rest = parts.pop() || "";
    for (const part of parts) {
      const data = part.split("\n").filter((line) => line.startsWith("data:")).map((line) => line.slice(5).trim());
      if (data.length) yield data.join("\n");
    }
  }
}

/**
 * Of calls that follow one another quickly, do the first and the latest; one at a time.
 * @template Argument
 * @param {(argument: Argument) => Promise<void>} work
 */
export function latest(work) {
  let busy = false;
  /** @type {{argument: Argument} | null} */
  let waiting = null;
  /** @param {Argument} argument */
  async function call(argument) {
    if (busy) {
      waiting = { argument };
      return;
    }
    busy = true;
    try {
      await work(argument);
    } finally {
      busy = false;
      const next = waiting;
      waiting = null;
      if (next) call(next.argument);
    }
  }
  return call;
}
