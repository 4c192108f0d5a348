// The jobs of the caller, live: progress, attempts, cancel, again, changed, downloads.

import { Problem, ask, follow, send } from "./api.js";
import { button, download, make } from "./dom.js";
import { showError } from "./fields.js";
import { asCurl, asPython } from "./request_panel.js";
import { submitted } from "./submitted.js";
import { duration } from "./numbers.js";

/** @typedef {import("./api.js").Job} Job */

export class JobsView {
  /** @param {HTMLElement} root */
  constructor(root) {
    this.body = make("tbody");
    this.empty = make("p", { class: "hint" }, "There are no jobs yet. Any computation can be queued as one, below its view.");
    this.live = make("p", { class: "visually-hidden", "aria-live": "polite" });
    /** @type {string | null} */ this.state = null;
    this.filter = make("select", { "aria-label": "Only jobs in this state", onchange: () => this.update() },
      ...["all", "queued", "running", "succeeded", "failed", "cancelled"].map((each) => make("option", {}, each)));
    const heads = ["Created", "Kind", "State", "Progress", "Attempts", "Acts"].map((text) => make("th", { scope: "col" }, text));
    this.table = make("div", { class: "scroll", tabindex: 0, role: "group", "aria-label": "Table of jobs" }, make("table", { class: "jobs" }, make("thead", {}, make("tr", {}, ...heads)), this.body));
    this.more = button("Older jobs", () => this.#load(this.next), { hidden: true });
    root.append(make("section", { class: "card", "aria-labelledby": "jobs-title" }, make("h2", { id: "jobs-title" }, "Jobs"), make("p", { class: "row" }, this.filter), this.live, this.empty, this.table, this.more));
    /** @type {Map<string, HTMLTableRowElement>} */ this.rows = new Map();
    this.stop = new AbortController();
    /** @type {string | null} */ this.next = null;
    this.timer = setInterval(() => this.#newer(), 4000);
  }

  destroy() {
    this.stop.abort();
    clearInterval(this.timer);
  }

  /** @returns {import("./base_view.js").Request[]} */
  requests() {
    return [];
  }

  async update() {
    this.stop.abort();
    this.stop = new AbortController();
    this.body.replaceChildren();
    this.rows.clear();
    await this.#load(null);
  }

  /** @param {string | null} cursor */
  async #load(cursor) {
    const chosen = this.filter.value === "all" ? "" : `&state=${this.filter.value}`;
    const page = await ask("GET", `/v1/jobs?limit=30${chosen}${cursor ? `&cursor=${cursor}` : ""}`, undefined, this.stop.signal);
    for (const job of page.jobs) this.#add(job, false);
    this.next = page.next;
    this.more.hidden = !page.next;
    this.empty.hidden = this.rows.size > 0;
    this.table.hidden = this.rows.size === 0;
  }

  /** Jobs queued elsewhere appear too. */
  async #newer() {
    if (document.hidden || this.filter.value !== "all") return;
    try {
      const page = await ask("GET", "/v1/jobs?limit=10", undefined, this.stop.signal);
      for (const job of [...page.jobs].reverse()) if (!this.rows.has(job.id)) this.#add(job, true);
      this.empty.hidden = this.rows.size > 0;
      this.table.hidden = this.rows.size === 0;
    } catch (error) {
      if (!(error instanceof Problem)) showError(error);
    }
  }

  /** @param {Job} job @param {boolean} first */
  #add(job, first) {
    const row = make("tr");
    this.rows.set(job.id, row);
    this.#fill(row, job);
    if (first) this.body.prepend(row);
    else this.body.append(row);
    if (!job.final) {
      follow(job, (now) => {
        this.#fill(row, now);
        if (now.final) this.live.textContent = `Job ${now.kind} ${now.state}.`;
      }, this.stop.signal).catch(showError);
    }
  }

  /** @param {HTMLTableRowElement} row @param {Job} job */
  #fill(row, job) {
    const progress = make("progress", { max: job.progress.total || 1, "aria-label": `Progress of ${job.id}` });
    if (job.state !== "queued") progress.value = job.state === "succeeded" ? progress.max : job.progress.done;
    const why = job.error ? job.error.detail : job.final ? "" : job.waiting_reason || job.phase;
    const took = job.started && job.finished ? duration((Date.parse(job.finished) - Date.parse(job.started)) / 1000) : "";
    const history = make("ul", { class: "attempts" });
    const attempts = job.attempts ? make("details", { ontoggle: () => { this.#history(job, history).catch(showError); } }, make("summary", {}, String(job.attempts)), history) : "0";
    /** @param {...(Node | string)} content */
    const cell = (...content) => make("td", {}, ...content);
    row.replaceChildren(
      cell(new Date(job.created).toLocaleTimeString(), make("br"), make("code", {}, job.id.slice(0, 12))),
      cell(job.kind), cell(make("span", { class: { succeeded: "good", failed: "bad" }[job.state] || "" }, job.reused ? `${job.state}, known before` : job.state), make("br"), make("small", {}, why || took)),
      cell(progress, ` ${job.progress.done}/${job.progress.total}`), cell(attempts), this.#acts(job));
  }

  /** @param {Job} job */
  #acts(job) {
    const known = submitted(job.digest);
    const of = `job ${job.id.slice(4, 12)}`;
    /** @param {string} text @param {() => Promise<any>} work */
    const act = (text, work) => button(text, () => { work().catch(showError); }, { "aria-label": `${text} ${of}`, class: "quiet" });
    /** @param {string} type @param {string} ending */
    const saved = (type, ending) => async () => {
      const answer = await send("GET", `/v1/jobs/${job.id}/result`, undefined, { Accept: type });
      download(`${job.kind}-${job.id.slice(4, 12)}.${ending}`, await answer.blob());
    };
    const acts = [];
    if (!job.final) {
      acts.push(act("Cancel", () => ask("DELETE", `/v1/jobs/${job.id}`)));
      const next = job.phase === "held" ? "Release" : "Hold";
      acts.push(act(next, () => ask("POST", `/v1/jobs/${job.id}/${next.toLowerCase()}`)));
    }
    if (job.state === "succeeded") acts.push(act("JSON", saved("application/json", "json")), act("HDF5", saved("application/x-hdf5", "h5")));
    if (job.state === "failed") acts.push(act("Retry", () => ask("POST", `/v1/jobs/${job.id}/retry`).then(() => this.update())));
    if (known) {
      if (job.state === "cancelled") acts.push(act("Submit again", () => this.#again(known)));
      acts.push(make("a", { href: known.address, "aria-label": `Open the view of ${of}` }, "open and change"));
      acts.push(act("curl", () => navigator.clipboard.writeText(asCurl(known.kind, known.request))), act("Python", () => navigator.clipboard.writeText(asPython(known.kind, known.request))));
    }
    return make("td", { class: "acts" }, ...acts);
  }

  /**
   * Send the request of a job again, as a new job.
   * @param {{kind: string, request: any}} known
   */
  async #again({ kind, request }) {
    await ask("POST", "/v1/jobs", { kind, request });
    await this.update();
  }

  /** Show the attempts at a job, with who made them and why they ended. @param {Job} job @param {HTMLElement} place */
  async #history(job, place) {
    const { history } = await ask("GET", `/v1/jobs/${job.id}`);
    place.replaceChildren(...(history || []).map((/** @type {any} */ each) => {
      const took = each.ended ? duration((Date.parse(each.ended) - Date.parse(each.began)) / 1000) : "now";
      return make("li", {}, `${each.worker}: ${took}${each.why ? `, ${each.why}` : ""}`);
    }));
  }
}
