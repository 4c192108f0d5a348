// Starts the page: the structure on one side, the view that the address names on the other.

import { ask, keep, key } from "./api.js";
import { AttractorsView } from "./attractors_view.js";
import { BasinsView } from "./basins_view.js";
import { byId, make } from "./dom.js";
import { DrivenView } from "./driven_view.js";
import { clearFaults, showError } from "./fields.js";
import { HistoryView } from "./history_view.js";
import { JobsView } from "./jobs_view.js";
import { MapView } from "./map_view.js";
import { ModesView } from "./modes_view.js";
import { learn } from "./natural.js";
import { requestPanel } from "./request_panel.js";
import { note, onChange, readAddress, show, state } from "./state.js";
import { loaded, structurePanel } from "./structure_panel.js";

/**
 * A view: it draws itself for the structure and the fields of the address.
 * @typedef {{update: () => void | Promise<void>, follow?: () => void, requests: () => {title: string, kind: string, request: any}[],
 *   checked?: () => void, destroy: () => void}} View
 */

/** @type {Record<string, {title: string, View: new (root: HTMLElement) => View}>} */
const VIEWS = {
  modes: { title: "Impact modes", View: ModesView },
  driven: { title: "Driven response", View: DrivenView },
  attractors: { title: "Attractors", View: AttractorsView },
  history: { title: "Time history", View: HistoryView },
  basins: { title: "Ensemble", View: BasinsView },
  map: { title: "Map", View: MapView },
  jobs: { title: "Jobs", View: JobsView },
};

/** @type {View | null} */
let current = null;
let shown = "";

readAddress();
const panel = structurePanel(byId("structure"));
const requests = requestPanel(byId("requests"), () => (current ? current.requests() : []));

async function open() {
  if (!Object.hasOwn(VIEWS, state.view)) state.view = "modes";
  const { title, View } = VIEWS[state.view];
  if (state.view !== shown) {
    if (current) current.destroy();
    byId("view").replaceChildren();
    current = new View(byId("view"));
    shown = state.view;
  }
  document.title = `${title} – Vibroimpact`;
  for (const link of byId("views").querySelectorAll("a")) {
    if (link.dataset.view === state.view) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  document.body.dataset.view = state.view;
  clearFaults();
  if (note.refused) showError(new Error(note.refused));
  note.refused = "";
  await refresh();
}

async function refresh() {
  try {
    const { structure } = state;
    if (structure.form === "stored" && !structure.matrices) {
      state.structure = await loaded(structure);
      panel.rebuild();
    }
    await learn();
    panel.listModes();
    if (current) await current.update();
    requests.update();
  } catch (error) {
    showError(error);
  }
}

byId("views").append(...Object.entries(VIEWS).map(([name, { title }]) => make("a", {
  href: `#${name}`, "data-view": name,
  onclick: (/** @type {Event} */ event) => {
    event.preventDefault();
    show(name);
  },
}, title)));

onChange((changed) => {
  if (changed === "structure") {
    panel.drawStill();
    if (changed === "structure" && byId("structure").dataset.form !== state.structure.form + (state.structure.id || "")) panel.rebuild();
    byId("structure").dataset.form = state.structure.form + (state.structure.id || "");
    refresh();
  } else if (changed === "fields") refresh();
  else {
    if (changed === "all") panel.rebuild();
    open();
  }
});
byId("structure").dataset.form = state.structure.form + (state.structure.id || "");

// On a phone the view comes first.
if (matchMedia("(max-width: 62rem)").matches) /** @type {HTMLDetailsElement} */ (byId("structure-box")).open = false;

const keyInput = /** @type {HTMLInputElement} */ (byId("key"));
keyInput.value = key();
keyInput.addEventListener("change", () => {
  keep(keyInput.value.trim());
  open();
});

/** @type {ReturnType<typeof setTimeout> | undefined} */
let timer;

async function watchHealth() {
  const badge = byId("health");
  const wasAway = !byId("away").hidden;
  try {
    const answer = await fetch("/v1/health/ready");
    const health = await answer.json().catch(() => ({}));
    badge.textContent = answer.ok ? "ready" : "not ready";
    badge.title = health.kernels === "warming" ? "Kernels are being compiled; first answers take longer." : "";
    badge.className = `badge ${answer.ok ? "good" : "bad"}`;
    byId("away").hidden = true;
    if (wasAway) open();
  } catch {
    badge.textContent = "no answer";
    badge.className = "badge bad";
    byId("away").hidden = false;
  }
  clearTimeout(timer);
  timer = setTimeout(watchHealth, byId("away").hidden ? 15_000 : 1000);
}

// A view has changed numbers of the structure: its form shows them.
addEventListener("structure-filled", () => panel.rebuild());
// A slider of the structure is being dragged.
addEventListener("structure-moving", () => {
  panel.drawStill();
  if (current && current.follow) current.follow();
});
addEventListener("input-checked", () => { if (current && current.checked) current.checked(); });
addEventListener("service-away", watchHealth);
addEventListener("natural-known", refresh);
document.addEventListener("visibilitychange", () => { if (!document.hidden) watchHealth(); });
open();
watchHealth();
ask("GET", "/v1/version").then((about) => { byId("version").textContent = about.service; }, () => {});
