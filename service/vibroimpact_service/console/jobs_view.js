// The jobs of the caller, live: progress, attempts, cancel, again, changed, downloads.

import { Problem, ask, follow, send } from "./api.js";
import { button, download, make } from "./dom.js";
import { showError, switchField } from "./fields.js";
import { compareWith } from "./kept.js";
import { asCurl, asPython } from "./request_panel.js";
import { remember, submitted } from "./submitted.js";
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
    this.search = make("input", { type: "search", placeholder: "Search", "aria-label": "Search jobs by name, structure, kind, state or id", oninput: () => this.#sift() });
    this.looked = switchField("with those that views made while one looked", false, () => this.#sift(), { name: "looked" });
    this.compare = button("Compare the two chosen", () => this.#compare(), { disabled: true });
    const heads = ["", "Created", "Name", "Queued as", "Kind", "State", "Progress", "Attempts", "Acts"].map((text) => make("th", { scope: "col" }, text || make("span", { class: "visually-hidden" }, "Chosen")));
    this.table = make("div", { class: "scroll", tabindex: 0, role: "group", "aria-label": "Table of jobs" }, make("table", { class: "jobs" }, make("thead", {}, make("tr", {}, ...heads)), this.body));
    this.more = button("Older jobs", () => this.#load(this.next), { hidden: true });
    root.append(make("section", { class: "card", "aria-labelledby": "jobs-title" }, make("h2", { id: "jobs-title" }, "Jobs"), make("p", { class: "row" }, this.filter, this.search, this.looked, this.compare), this.live, this.empty, this.table, this.more));
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
    this.#sift();
  }

  /** Show the rows that are asked for. */
  #sift() {
    const words = this.search.value.toLowerCase().split(/\s+/).filter(Boolean);
    const looked = /** @type {HTMLInputElement} */ (this.looked.querySelector("input")).checked;
    let count = 0;
    for (const row of this.rows.values()) {
      const text = `${row.textContent} ${row.dataset.text}`.toLowerCase();
      row.hidden = row.dataset.removed === "true" || (row.dataset.looked === "true" && !looked) || !words.every((word) => text.includes(word));
      count += Number(!row.hidden);
    }
    this.empty.hidden = count > 0;
    this.empty.textContent = words.length ? "No job that is loaded has these words." : "There are no jobs yet. Any computation can be queued as one, below its view.";
    this.table.hidden = count === 0;
  }

  /** @returns {string[]} addresses of the jobs that are chosen */
  #chosen() {
    return [...this.body.querySelectorAll("input[name=chosen]:checked")].map((each) => /** @type {HTMLInputElement} */ (each).value);
  }

  #compare() {
    const [first, second] = this.#chosen();
    if (first.split("?")[0] !== second.split("?")[0]) showError(new Error("Only two jobs of the same view stand beside one another."));
    else compareWith(first, second);
  }

  /** Jobs queued elsewhere appear too. */
  async #newer() {
    if (document.hidden || this.filter.value !== "all") return;
    try {
      const page = await ask("GET", "/v1/jobs?limit=10", undefined, this.stop.signal);
      for (const job of [...page.jobs].reverse()) if (!this.rows.has(job.id)) this.#add(job, true);
      this.#sift();
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
    /** @param {...(Node | string | null)} content */
    const cell = (...content) => make("td", {}, ...content);
    const known = submitted(job.digest);
    const of = `job ${job.id.slice(4, 12)}`;
    const name = make("input", { value: known.name || "", placeholder: "unnamed", "aria-label": `Name of ${of}`, class: "named" });
    name.addEventListener("change", () => {
      remember(job.digest, { name: name.value.trim() });
      row.dataset.text = `${name.value} ${job.id} ${job.digest}`;
    });
    Object.assign(row.dataset, { text: `${known.name || job.name || ""} ${job.id} ${job.digest}`, looked: String(Boolean(known.looked)), removed: String(Boolean(known.removed)) });
    const choose = known.address ? make("input", { type: "checkbox", name: "chosen", value: known.address, "aria-label": `Choose ${of}`, onchange: () => { this.compare.disabled = this.#chosen().length !== 2; } }) : null;
    const open = row.contains(document.activeElement) ? document.activeElement : null;
    if (open instanceof HTMLInputElement && open.className === "named") return;
    row.replaceChildren(
      cell(choose), cell(new Date(job.created).toLocaleString(), make("br"), make("code", {}, job.id.slice(0, 12))), cell(name), cell(known.structure || job.name || "–"),
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
    const { kind, request, address } = known;
    if (kind && request) {
      if (job.state === "cancelled") acts.push(act("Submit again", () => this.#again({ kind, request, name: job.name })));
      acts.push(act("curl", () => navigator.clipboard.writeText(asCurl(kind, request))), act("Python", () => navigator.clipboard.writeText(asPython(kind, request))));
    }
    if (address) acts.push(make("a", { href: address, "aria-label": `Open the view of ${of}` }, "open and change"));
    // Its record and its result stay at the service as long as it keeps them.
    if (job.final) {
      acts.push(act("Remove", async () => {
        remember(job.digest, { removed: true });
        this.#remove(job.digest);
      }));
    }
    return make("td", { class: "acts" }, ...acts);
  }

  /** Take the jobs of a result off this list. @param {string} digest */
  #remove(digest) {
    for (const row of this.rows.values()) if ((row.dataset.text || "").endsWith(digest)) row.dataset.removed = "true";
    this.#sift();
  }

  /**
   * Send the request of a job again, as a new job.
   * @param {{kind: string, request: any, name?: string | null}} known
   */
  async #again({ kind, request, name }) {
    await ask("POST", "/v1/jobs", { kind, request, ...(name ? { name } : {}) });
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
