// Plots p(Omega): admissible solutions as a strong line, phantoms as a thin one, and their bands.

const SPACE = "http://www.w3.org/2000/svg";
const [LEFT, RIGHT, TOP, BOTTOM, BAND] = [64, 786, 14, 340, 372];

function element(parent, name, attributes, text) {
  const made = document.createElementNS(SPACE, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  parent.append(made);
  return made;
}

function quantile(sorted, q) {
  return sorted[Math.min(sorted.length - 1, Math.floor(q * sorted.length))];
}

// Round numbers that cover an interval, about `count` of them.
export function ticks(low, high, count = 6) {
  const raw = (high - low) / count || 1;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw);
  const found = [];
  for (let v = Math.ceil(low / step) * step; v <= high + step * 1e-9; v += step) found.push(v);
  return found.map((v) => Number(v.toPrecision(12)));
}

// The range of p: poles go to infinity, so that the outer parts of the values are cut off.
export function range(values, real) {
  const shown = values.filter((v, i) => Number.isFinite(v) && real[i]);
  const used = (shown.length > 3 ? shown : values.filter(Number.isFinite)).sort((a, b) => a - b);
  if (!used.length) return [-1, 1];
  const low = Math.min(0, quantile(used, 0.02));
  const high = Math.max(0, quantile(used, 0.97));
  const pad = 0.15 * (high - low || 1);
  return [low - pad, high + pad];
}

// Pieces of the curve, interrupted at the ends of existence bands and at poles.
export function pieces(x, y, real, height) {
  const found = [];
  let current = null;
  for (let i = 0; i < x.length; i += 1) {
    const pole = i > 0 && Math.abs(y[i] - y[i - 1]) > height && y[i] * y[i - 1] < 0;
    if (!current || current.real !== real[i] || pole || !Number.isFinite(y[i])) {
      const joined = current && !pole && Number.isFinite(y[i]) && Number.isFinite(y[i - 1]);
      current = { real: real[i], points: joined ? [[x[i - 1], y[i - 1]]] : [] };
      found.push(current);
    }
    if (Number.isFinite(y[i])) current.points.push([x[i], y[i]]);
  }
  return found.filter((piece) => piece.points.length > 1);
}

export function draw(svg, caption, result) {
  const x = result.frequency.Omega;
  const y = result.impulse.map((row) => row[0]);
  const real = result.exists;
  const [low, high] = range(y, real);
  const [first, last] = [x[0], x[x.length - 1]];
  const across = (v) => LEFT + ((v - first) / (last - first || 1)) * (RIGHT - LEFT);
  // Values near a pole may exceed the range of SVG coordinates.
  const near = (v) => Math.min(Math.max(v, 2 * low - high), 2 * high - low);
  const up = (v) => BOTTOM - ((near(v) - low) / (high - low)) * (BOTTOM - TOP);
  svg.replaceChildren();
  element(svg, "rect", { x: LEFT, y: TOP, width: RIGHT - LEFT, height: BOTTOM - TOP, class: "axis" });
  for (const v of ticks(first, last, 9)) {
    const at = across(v);
    element(svg, "line", { x1: at, x2: at, y1: TOP, y2: BOTTOM, class: "axis" });
    element(svg, "text", { x: at, y: BOTTOM + 16, "text-anchor": "middle" }, v);
  }
  for (const v of ticks(low, high)) {
    element(svg, "line", { x1: LEFT, x2: RIGHT, y1: up(v), y2: up(v), class: v === 0 ? "zero" : "axis" });
    element(svg, "text", { x: LEFT - 6, y: up(v) + 4, "text-anchor": "end" }, v);
  }
  const frame = element(element(svg, "defs", {}), "clipPath", { id: "frame" });
  element(frame, "rect", { x: LEFT, y: TOP, width: RIGHT - LEFT, height: BOTTOM - TOP });
  const curves = element(svg, "g", { "clip-path": "url(#frame)" });
  for (const piece of pieces(x, y, real, high - low)) {
    const points = piece.points.map(([a, b]) => `${across(a).toFixed(2)},${up(b).toFixed(2)}`);
    element(curves, "polyline", { points: points.join(" "), class: piece.real ? "real" : "phantom" });
  }
  for (let i = 0; i < x.length; ) {
    let j = i;
    while (j < x.length && real[j] === real[i]) j += 1;
    const from = across(x[i]);
    const to = across(x[Math.min(j, x.length - 1)]);
    if (real[i]) element(svg, "rect", { x: from, y: BAND, width: Math.max(1, to - from), height: 10, class: "band" });
    i = j;
  }
  element(svg, "rect", { x: LEFT, y: BAND, width: RIGHT - LEFT, height: 10, class: "axis" });
  element(svg, "text", { x: LEFT - 6, y: BAND + 9, "text-anchor": "end" }, "exists");
  element(svg, "text", { x: (LEFT + RIGHT) / 2, y: 408, "text-anchor": "middle" }, "Ω");
  element(svg, "text", { x: 12, y: TOP + 10 }, "p");
  const cursor = element(svg, "line", { x1: 0, x2: 0, y1: TOP, y2: BAND + 10, class: "cursor", visibility: "hidden" });
  const count = real.filter(Boolean).length;
  const summary = `${x.length} frequencies, ${count} with a real impact mode (strong line and bar), the others phantoms (thin).`;
  caption.textContent = summary;
  svg.setAttribute("aria-label", `Impulse parameter over frequency: ${summary}`);
  svg.onpointermove = (event) => {
    const box = svg.getBoundingClientRect();
    const at = first + (((event.clientX - box.left) / box.width) * 800 - LEFT) / (RIGHT - LEFT) * (last - first);
    if (at < first || at > last) return;
    let i = x.findIndex((v) => v >= at);
    i = i < 0 ? x.length - 1 : i;
    for (const end of ["x1", "x2"]) cursor.setAttribute(end, across(x[i]));
    cursor.setAttribute("visibility", "visible");
    caption.textContent = `Ω = ${x[i].toPrecision(6)}, p = ${y[i].toPrecision(6)}, ${result.reason ? result.reason[i].replaceAll("_", " ") : ""}`;
  };
  svg.onpointerleave = () => {
    cursor.setAttribute("visibility", "hidden");
    caption.textContent = summary;
  };
}
