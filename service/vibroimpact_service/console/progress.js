// A line that says that something is being computed, once it takes a moment.

import { send } from "./api.js";
import { button, make } from "./dom.js";

export function progressLine() {
  const bar = make("progress", { "aria-label": "Progress of the computation" });
  const text = make("span", {}, "computing …");
  const cancel = button("Cancel", () => {}, { class: "quiet" });
  const element = make("p", { class: "progress-line", hidden: true }, bar, " ", text, " ", cancel);
  return { element, bar, text, cancel };
}

/**
 * Show that work is under way, and how far it is.
 * @template Value
 * @param {ReturnType<typeof progressLine>} line
 * @param {(onJob: (job: import("./api.js").Job) => void) => Promise<Value>} work
 * @returns {Promise<Value>}
 */
export async function working(line, work) {
  line.cancel.hidden = true;
  line.bar.removeAttribute("value");
  line.text.textContent = "computing …";
  const timer = setTimeout(() => { line.element.hidden = false; }, 300);
  /** @param {import("./api.js").Job} job */
  const onJob = (job) => {
    if (job.progress.total > 1) Object.assign(line.bar, { max: job.progress.total, value: job.progress.done });
    line.text.textContent = job.waiting_reason ? `${job.state}: ${job.waiting_reason}` : `a job of ${job.progress.total} part${job.progress.total === 1 ? "" : "s"}, ${job.progress.done} done`;
    line.cancel.hidden = false;
    line.cancel.onclick = () => { send("DELETE", `/v1/jobs/${job.id}`).catch(() => {}); };
  };
  try {
    return await work(onJob);
  } finally {
    clearTimeout(timer);
    line.element.hidden = true;
  }
}
