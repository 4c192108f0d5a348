// Colours of canvases, as the style sheet gives them for the light or the dark theme.

/** @type {Set<() => void>} */
const listeners = new Set();

/** @param {() => void} listener called when the theme has changed */
export function onTheme(listener) {
  listeners.add(listener);
  return () => listeners.delete(listener);
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  for (const listener of listeners) listener();
});

/** @param {string} name of a custom property, without its dashes */
export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/** @returns {import("./shape.js").Colours} */
export function shapeColours() {
  return {
    ink: colour("ink"), soft: colour("soft"), line: colour("line"), accent: colour("accent"),
    fill: colour("card"), stop: colour("stop"), alarm: colour("alarm"), paper: colour("card"),
  };
}
