// The console: a form that writes a request, the plot of its result, the jobs, the health.

import { Problem, ask, keep, key } from "/console/api.js";
import { draw } from "/console/plot.js";

const find = (id) => document.getElementById(id);
const [form, request, message] = ["form", "request", "message"].map(find);
const OUTPUTS = ["impulse", "exists", "reason"];

function written() {
  const value = Object.fromEntries([...new FormData(form)].map(([k, v]) => [k, Number(v)]));
  return {
    system: {
      preset: "chain", n: value.n, mass: value.mass, stiffness: value.stiffness,
      constraints: [{ dof: value.dof, gap: value.gap }],
    },
    frequency: { start: value.start, stop: value.stop, num: value.num },
    outputs: OUTPUTS,
  };
}

function writeRequest() {
  request.value = JSON.stringify(written(), null, 1);
}

function told(error) {
  if (!(error instanceof Problem)) return String(error.message || error);
  const faults = (error.document.errors || []).map((f) => `${f.pointer || f.parameter}: ${f.message}`);
  if (error.status === 401) find("key-box").open = true;
  return [...new Set([faults.length ? "" : error.message, ...faults])].filter(Boolean).join(" · ");
}

async function guarded(work) {
  message.textContent = "";
  const buttons = form.querySelectorAll("button");
  buttons.forEach((button) => { button.disabled = true; });
  try {
    await work();
  } catch (error) {
    message.textContent = told(error);
  } finally {
    buttons.forEach((button) => { button.disabled = false; });
  }
}

function show(result) {
  if (!result.impulse || !result.exists) throw new Error("The result has no impulse or existence to draw.");
  draw(find("plot"), find("caption"), result);
}

async function compute() {
  const { status, document } = await ask("POST", "/v1/compute/impact-modes", request.value);
  if (status === 202) {
    find("caption").textContent = "It became a job; its result can be drawn when it has succeeded.";
    await showJobs();
  } else show(document);
}

async function queue() {
  await ask("POST", "/v1/jobs", { kind: "impact-modes", request: JSON.parse(request.value) });
  await showJobs();
}

form.addEventListener("submit", (event) => {
  event.preventDefault();
  guarded(event.submitter && event.submitter.value === "job" ? queue : compute);
});
form.querySelectorAll("fieldset input").forEach((input) => input.addEventListener("input", writeRequest));
find("key").value = key();
find("key").addEventListener("change", (event) => { keep(event.target.value.trim()); refresh(); });

function cell(row, ...content) {
  const made = document.createElement("td");
  made.append(...content);
  row.append(made);
}

function button(text, label, work) {
  const made = document.createElement("button");
  made.type = "button";
  made.className = "second";
  made.textContent = text;
  made.setAttribute("aria-label", label);
  made.addEventListener("click", () => guarded(work));
  return made;
}

function jobRow(job) {
  const row = document.createElement("tr");
  const progress = document.createElement("progress");
  progress.max = job.progress.total || 1;
  progress.value = job.state === "succeeded" ? progress.max : job.progress.done;
  progress.setAttribute("aria-label", `progress of ${job.id}`);
  const code = document.createElement("code");
  code.textContent = job.id.slice(0, 16);
  const state = document.createElement("span");
  state.textContent = job.waiting_reason ? `${job.state}: ${job.waiting_reason}` : job.error ? `${job.state}: ${job.error.detail}` : job.state;
  if (job.state === "succeeded") state.className = "good";
  if (job.state === "failed") state.className = "bad";
  cell(row, new Date(job.created).toLocaleTimeString());
  cell(row, job.kind);
  cell(row, state);
  cell(row, progress, ` ${job.progress.done}/${job.progress.total}`);
  cell(row, code);
  if (job.state === "succeeded" && job.kind === "impact-modes") {
    cell(row, button("draw", `draw the result of ${job.id}`, async () => show((await ask("GET", job.result)).document)));
  } else if (!job.final) {
    cell(row, button("cancel", `cancel ${job.id}`, async () => { await ask("DELETE", `/v1/jobs/${job.id}`); await showJobs(); }));
  } else cell(row, "");
  return row;
}

let shown = "";

async function showJobs() {
  const { document: page } = await ask("GET", "/v1/jobs?limit=20");
  const now = JSON.stringify(page.jobs.map((job) => [job.id, job.version, job.waiting_reason]));
  // The table is redrawn only after changes, so that buttons stay under the pointer.
  if (now !== shown) {
    shown = now;
    if (page.jobs.length) find("jobs").replaceChildren(...page.jobs.map(jobRow));
  }
  return page.jobs.some((job) => !job.final);
}

async function showHealth() {
  const badge = find("health");
  try {
    await ask("GET", "/v1/health/ready");
    badge.textContent = "ready";
    badge.className = "badge good";
  } catch (error) {
    badge.textContent = error instanceof Problem ? error.message : "no answer";
    badge.className = "badge bad";
  }
}

async function refresh() {
  let busy = false;
  if (!document.hidden) {
    await showHealth();
    try {
      busy = await showJobs();
    } catch (error) {
      if (!(error instanceof Problem)) shown = "";
      else if (error.status === 401) message.textContent = told(error);
    }
  }
  clearTimeout(refresh.timer);
  refresh.timer = setTimeout(refresh, busy ? 700 : 4000);
}

writeRequest();
ask("GET", "/v1/version").then(({ document: about }) => {
  find("version").textContent = `${about.service} · ${about.kinds.join(", ")}`;
}, () => {});
refresh();
