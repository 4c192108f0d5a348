// The moving structure in a notebook: what anywidget calls, with the drawing of the console.

import { interpolated } from "./numbers.js";
import { Player, calm } from "./player.js";
import { Shape } from "./shape.js";

/** Colours by which notebooks draw, light or dark as the browser is. */
const NOTEBOOK = {
  light: { ink: "#1c2530", soft: "#56616e", line: "#dfe3e6", accent: "#1d5c97", fill: "#ffffff", stop: "#b3391f", alarm: "#c0262d", paper: "#ffffff" },
  dark: { ink: "#e4e8ec", soft: "#a2adb8", line: "#333c45", accent: "#7db7ee", fill: "#1a2026", stop: "#f08a6b", alarm: "#ff7b74", paper: "#1a2026" },
};

/**
 * @param {{model: {get: (name: string) => any}, el: HTMLElement}} widget the model has scene: geometry,
 *   stops, motions (title, rows, mirrored: back along the same path) and seconds
 */
function render({ model, el }) {
  const { geometry, stops, motions, again, seconds } = model.get("scene");
  const canvas = document.createElement("canvas");
  Object.assign(canvas.style, { width: "100%", height: "15rem", display: "block" });
  const play = document.createElement("button");
  const time = Object.assign(document.createElement("input"), { type: "range", min: "0", max: "1", step: "0.001", value: "0" });
  time.setAttribute("aria-label", "Time");
  const choice = document.createElement("select");
  choice.setAttribute("aria-label", "Motion");
  choice.append(...motions.map((/** @type {any} */ { title }, /** @type {number} */ i) => new Option(title, String(i))));
  const row = document.createElement("div");
  Object.assign(row.style, { display: "flex", gap: "0.6rem", alignItems: "center" });
  time.style.flex = "1";
  row.append(play, time, choice);
  el.append(canvas, row);
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", "The moving structure");
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  const shape = new Shape(canvas, geometry, stops, dark ? NOTEBOOK.dark : NOTEBOOK.light);
  const x = new Float64Array(geometry.n);
  /** @param {number} place */
  const draw = (place) => {
    const { rows, mirrored } = motions[Number(choice.value) || 0];
    const share = mirrored ? (place < 0.5 ? 2 * place : 2 - 2 * place) : place;
    shape.draw(interpolated(rows, share * (rows.length - 1), x));
    time.value = String(place);
  };
  const player = new Player(draw, { seconds, again });
  player.onState = () => { play.textContent = player.playing ? "Pause" : "Play"; };
  play.textContent = "Play";
  play.addEventListener("click", () => player.toggle());
  time.addEventListener("input", () => {
    player.pause();
    player.seek(Number(time.value));
  });
  const choose = () => {
    shape.fit(motions[Number(choice.value) || 0].rows);
    draw(player.place);
  };
  choice.addEventListener("change", choose);
  const watch = new ResizeObserver(choose);
  watch.observe(canvas);
  if (!calm()) player.play();
  return () => {
    player.pause();
    watch.disconnect();
  };
}

export default { render };
