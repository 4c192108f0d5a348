// Draws a structure and its stops on a canvas at one instant. Knows neither the page nor the
// service, so that notebooks use it as it is.

import { FINE, beamEnvelope } from "./envelope.js";
import { shown } from "./numbers.js";
import { drawWall, indentation } from "./walls.js";

/**
 * @typedef {import("./structures.js").Geometry} Geometry
 * @typedef {{dof: number, relativeTo: number | null, lower: number | null, upper: number | null, stiffness?: number | null}} Walls stiffness: of stops that give way
 * @typedef {{ink: string, soft: string, line: string, accent: string, fill: string, stop: string, alarm: string, paper: string}} Colours
 * @typedef {{stop: number, side: number, alarm?: boolean}} Mark a wall that is emphasised: side 1 is the upper one
 * @typedef {import("./envelope.js").Envelope} Envelope
 */

const [PAD, BAR] = [18, 26]; // least pixels of the bar that tells the scale

export class Shape {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {Geometry} geometry
   * @param {Walls[]} stops
   * @param {Colours} colours
   */
  constructor(canvas, geometry, stops, colours) {
    this.canvas = canvas;
    this.geometry = geometry;
    this.stops = stops;
    this.colours = colours;
    /** Displacement that fills the height of the drawing. */
    this.reach = 1;
    /** How far a stop is pushed in at most, as a displacement. */
    this.deepest = 0;
    /** Coordinate whose waveform is shown. */
    this.chosen = -1;
    /** @type {Envelope | null} */
    this.envelope = null;
    /** @type {[number, number]} turn and tilt of a cloud of nodes */
    this.angles = [-0.6, 0.45];
    /** @type {{dof: number, x: number, y: number}[]} */
    this.places = [];
    this.context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  }

  /**
   * Make the largest of these displacements, and the gaps if they are of its order, fill the drawing.
   * @param {ArrayLike<number>[]} rows displacements [time][dof]
   */
  fit(rows) {
    const { drawn, n } = this.geometry;
    const smallest = new Float64Array(n);
    const largest = new Float64Array(n);
    let most = 0;
    for (const row of rows) {
      for (const dof of drawn) {
        smallest[dof] = Math.min(smallest[dof], row[dof]);
        largest[dof] = Math.max(largest[dof], row[dof]);
        most = Math.max(most, Math.abs(row[dof]));
      }
    }
    const gaps = this.stops.flatMap(({ lower, upper }) => [lower, upper].map((gap) => Math.abs(gap || 0)));
    const gap = Math.max(0, ...gaps);
    this.deepest = Math.max(0, ...this.stops.flatMap((stop) => [1, -1].map((side) => rows.reduce((depth, row) => Math.max(depth, this.#pushed(stop, side, row) || 0), 0))));
    // Behind a stop that gives way stands its footing.
    this.reach = (this.deepest ? 1.3 : 1.08) * (Math.max(most, gap < 4 * most || !most ? gap : 0) || 1);
    this.envelope = this.geometry.element ? beamEnvelope(rows, drawn, this.geometry.element) : { smallest, largest };
  }

  /** @param {Walls} stop @param {number} side @param {ArrayLike<number>} x displacements @returns {number | null} how far it is pushed in; null: it is rigid */
  #pushed(stop, side, x) {
    return indentation(stop, side, x[stop.dof] - (stop.relativeTo === null ? 0 : x[stop.relativeTo]));
  }

  /** Draw how long a round displacement is. @param {number} scale pixels of a unit @param {number} x @param {number} y @param {boolean} upright */
  #bar(scale, x, y, upright) {
    if (!(scale > 0) || !Number.isFinite(scale)) return;
    const { context, colours } = this;
    const power = 10 ** Math.floor(Math.log10(BAR / scale));
    const value = power * ([1, 2, 5].find((factor) => factor * power * scale >= BAR) || 10);
    const length = value * scale;
    const ends = /** @type {[number, number][]} */ (upright ? [[x, y], [x, y - length]] : [[x, y], [x + length, y]]);
    this.#line(ends, colours.soft, 1.5);
    for (const [a, b] of ends) this.#line(upright ? [[a - 3, b], [a + 3, b]] : [[a, b - 3], [a, b + 3]], colours.soft, 1.5);
    context.fillStyle = colours.soft;
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "left";
    context.fillText(shown(value, 3), upright ? x + 6 : x + length + 6, upright ? y - length / 2 + 4 : y + 4);
  }

  /**
   * Draw one instant.
   * @param {ArrayLike<number>} x displacements [dof]
   * @param {Mark[]} [marks]
   */
  draw(x, marks = []) {
    const { canvas, context } = this;
    const ratio = globalThis.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.lineJoin = "round";
    context.lineCap = "round";
    this.places = [];
    if (width <= 2 * PAD || height <= 2 * PAD) return; // not laid out yet
    const draw = { profile: this.#profile, row: this.#row, pendulum: this.#pendulum, cloud: this.#cloud }[this.geometry.layout];
    draw.call(this, width, height, x, marks);
  }

  /** @param {number} x @param {number} y @returns {number} the coordinate drawn nearest to a point, or −1 */
  at(x, y) {
    let best = -1;
    let least = 30 ** 2;
    for (const place of this.places) {
      const distance = (place.x - x) ** 2 + ((place.y - y) / 3) ** 2;
      if (distance < least) [best, least] = [place.dof, distance];
    }
    return best;
  }

  /** @param {number} stop @param {number} side @param {Mark[]} marks */
  #mark(stop, side, marks) {
    return marks.find((mark) => mark.stop === stop && mark.side === side);
  }

  /** @param {[number, number][]} points @param {string} colour @param {number} width @param {number[]} [dash] */
  #line(points, colour, width, dash = []) {
    const { context } = this;
    context.beginPath();
    points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.setLineDash(dash);
    context.stroke();
    context.setLineDash([]);
  }

  /** @param {number} x @param {number} y @param {number} radius @param {boolean} chosen */
  #bead(x, y, radius, chosen) {
    const { context, colours } = this;
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.fillStyle = chosen ? colours.accent : colours.fill;
    context.fill();
    context.strokeStyle = colours.accent;
    context.lineWidth = 2;
    context.stroke();
  }

  /**
   * A wall at (x, y), facing the direction (u, v).
   * @param {number} x @param {number} y @param {number} u @param {number} v @param {number} width
   * @param {Mark | undefined} mark @param {number | null} [pushed] pixels by which it gives way; null: it is rigid @param {number} [scale] pixels of a unit
   */
  #wall(x, y, u, v, width, mark, pushed = null, scale = 0) {
    const { context, colours } = this;
    drawWall(context, mark && mark.alarm ? colours.alarm : colours.stop, { x, y, u, v, width, marked: Boolean(mark), pushed: pushed === null ? null : pushed * scale, deepest: this.deepest * scale });
  }

  /** @param {number} x @param {number} height @param {number} sign side of the hatching */
  #clamp(x, height, sign) {
    const { colours } = this;
    this.#line([[x, height / 2 - 26], [x, height / 2 + 26]], colours.ink, 2.5);
    for (let y = -22; y <= 26; y += 8) this.#line([[x, height / 2 + y], [x + 7 * sign, height / 2 + y - 6]], colours.soft, 1);
  }

  /** @param {number} width @param {number} height @param {ArrayLike<number>} x @param {Mark[]} marks */
  #profile(width, height, x, marks) {
    const { geometry, colours, context } = this;
    const { drawn, fixed, smooth } = geometry;
    const [left, right] = [PAD + 8, width - PAD - 8];
    const parts = drawn.length - 1 + Number(fixed[0]) + Number(fixed[1]);
    const spacing = parts ? (right - left) / parts : 0;
    /** @param {number} k */
    const across = (k) => (parts ? left + (k + Number(fixed[0])) * spacing : width / 2);
    const scale = (height / 2 - PAD) / this.reach;
    /** @param {number} value */
    const up = (value) => height / 2 - value * scale;
    this.#line([[left, height / 2], [right, height / 2]], colours.line, 1, [4, 5]);
    /** @param {(dof: number) => number} value @returns {[number, number][]} */
    const points = (value) => [
      ...(fixed[0] ? [/** @type {[number, number]} */ ([left, height / 2])] : []),
      ...drawn.map((dof, k) => /** @type {[number, number]} */ ([across(k), up(value(dof))])),
      ...(fixed[1] ? [/** @type {[number, number]} */ ([right, height / 2])] : []),
    ];
    if (this.envelope && drawn.length > 1) {
      const { smallest, largest } = this.envelope;
      /** @param {ArrayLike<number>} limit @returns {[number, number][]} */
      const edge = (limit) => (geometry.element ? Array.from(limit, (value, i) => /** @type {[number, number]} */ ([left + (i * spacing) / FINE, up(value)])) : points((dof) => limit[dof]));
      context.beginPath();
      edge(largest).forEach(([a, b], i) => (i ? context.lineTo(a, b) : context.moveTo(a, b)));
      edge(smallest).reverse().forEach(([a, b]) => context.lineTo(a, b));
      context.globalAlpha = 0.1;
      context.fillStyle = colours.accent;
      context.fill();
      context.globalAlpha = 1;
    }
    if (fixed[0]) this.#clamp(left, height, -1);
    if (fixed[1]) this.#clamp(right, height, 1);
    this.#bar(scale, 12, height - 8, true);
    this.stops.forEach((stop, index) => {
      const k = drawn.indexOf(stop.dof);
      if (k < 0) return;
      const base = stop.relativeTo === null ? 0 : x[stop.relativeTo];
      const size = Math.min(34, Math.max(16, 1.3 * spacing));
      if (stop.upper !== null) this.#wall(across(k), up(base + stop.upper) - this.#radius(spacing), 0, 1, size, this.#mark(index, 1, marks), this.#pushed(stop, 1, x), scale);
      if (stop.lower !== null) this.#wall(across(k), up(base - stop.lower) + this.#radius(spacing), 0, -1, size, this.#mark(index, -1, marks), this.#pushed(stop, -1, x), scale);
    });
    if (geometry.element) this.#beam(points((dof) => x[dof]), [0, ...drawn.map((dof) => x[dof + 1] * (geometry.element || 0) * scale)], spacing);
    else this.#line(points((dof) => x[dof]), colours.accent, smooth ? 4 : 2);
    const radius = this.#radius(spacing);
    drawn.forEach((dof, k) => {
      this.places.push({ dof, x: across(k), y: up(x[dof]) });
      const struck = this.stops.some((stop) => stop.dof === dof);
      if (!smooth || struck || dof === this.chosen) this.#bead(across(k), up(x[dof]), smooth ? 5 : radius, dof === this.chosen || struck);
    });
  }

  /**
   * A beam clamped at its left end, cubic between its nodes.
   * @param {[number, number][]} points @param {number[]} rises what each slope adds along an element
   * @param {number} spacing
   */
  #beam(points, rises, spacing) {
    const { context, colours } = this;
    context.beginPath();
    context.moveTo(...points[0]);
    for (let k = 1; k < points.length; k += 1) {
      const [[a, b], [c, d]] = [points[k - 1], points[k]];
      context.bezierCurveTo(a + spacing / 3, b - rises[k - 1] / 3, c - spacing / 3, d + rises[k] / 3, c, d);
    }
    context.strokeStyle = colours.accent;
    context.lineWidth = 4;
    context.stroke();
  }

  /** @param {number} spacing between beads */
  #radius(spacing) {
    return this.geometry.smooth ? 3 : Math.min(9, Math.max(1.6, spacing ? 0.34 * spacing : 12));
  }

  /** @param {number} width @param {number} height @param {ArrayLike<number>} x @param {Mark[]} marks */
  #row(width, height, x, marks) {
    const { geometry, colours, context } = this;
    const { n, fixed } = geometry;
    const cages = new Map(this.stops.map((stop, index) => [stop, index]).filter(([stop]) => /** @type {Walls} */ (stop).relativeTo !== null)
      .map(([stop, index]) => [/** @type {Walls} */ (stop).dof, { stop: /** @type {Walls} */ (stop), index: /** @type {number} */ (index) }]));
    const standing = geometry.drawn.filter((dof) => !cages.has(dof));
    const places = standing.length + (n === 1 ? 1 : 0) + (fixed[1] ? 0.35 : 0);
    const pitch = (width - 2 * PAD) / (places + 0.35);
    const size = Math.min(54, 0.3 * pitch, 0.5 * height);
    // Room for a displacement of `reach` on both sides of each block.
    const scale = (n === 1 ? 0.62 * pitch : cages.size ? 0.22 * pitch : 0.34 * pitch) / this.reach;
    const ground = height / 2 + size / 2 + 3;
    const [left, right] = [PAD, width - PAD];
    this.#line([[left, ground], [right, ground]], colours.line, 1.5);
    if (fixed[0]) this.#clamp(left, height, -1);
    if (fixed[1]) this.#clamp(right, height, 1);
    /** @param {number} place */
    const rest = (place) => left + (n === 1 ? 1 : place + 0.85) * pitch;
    let from = left;
    standing.forEach((dof, place) => {
      const centre = rest(place) + x[dof] * scale;
      const inner = [...cages.values()].find(({ stop }) => stop.relativeTo === dof);
      const half = inner ? size * 0.45 + Math.max(inner.stop.lower || 0, inner.stop.upper || 0) * scale + 6 : size / 2;
      // Springs pass above the stops, which stand on the ground.
      if (place > 0 || fixed[0]) this.#spring(from, centre - half, height / 2 - 0.3 * size, size);
      this.stops.forEach((stop, index) => {
        if (stop.dof !== dof || stop.relativeTo !== null) return;
        const [middle, tall] = [height / 2 + 0.24 * size, 0.52 * size + 6];
        if (stop.upper !== null) this.#wall(rest(place) + stop.upper * scale + half, middle, -1, 0, tall, this.#mark(index, 1, marks), this.#pushed(stop, 1, x), scale);
        if (stop.lower !== null) this.#wall(rest(place) - stop.lower * scale - half, middle, 1, 0, tall, this.#mark(index, -1, marks), this.#pushed(stop, -1, x), scale);
      });
      context.beginPath();
      context.roundRect(centre - half, height / 2 - size / 2, 2 * half, size, 5);
      context.fillStyle = colours.fill;
      context.fill();
      context.strokeStyle = colours.accent;
      context.lineWidth = 2.5;
      context.stroke();
      if (inner) {
        const { stop, index } = inner;
        const middle = centre + (x[stop.dof] - x[dof]) * scale;
        const small = size * 0.45;
        if (stop.upper !== null) this.#wall(centre + stop.upper * scale + small, height / 2, -1, 0, size * 0.8, this.#mark(index, 1, marks), this.#pushed(stop, 1, x), scale);
        if (stop.lower !== null) this.#wall(centre - stop.lower * scale - small, height / 2, 1, 0, size * 0.8, this.#mark(index, -1, marks), this.#pushed(stop, -1, x), scale);
        this.#bead(middle, height / 2, small, true);
        this.places.push({ dof: stop.dof, x: middle, y: height / 2 });
      }
      this.places.push({ dof, x: centre, y: height / 2 });
      from = centre + half;
    });
    if (fixed[1]) this.#spring(from, right, height / 2 - 0.3 * size, size);
    this.#bar(scale, left, height - 8, false);
  }

  /** @param {number} from @param {number} to @param {number} y @param {number} size */
  #spring(from, to, y, size) {
    const turns = 7;
    const end = Math.min(10, (to - from) / 6);
    /** @type {[number, number][]} */
    const points = [[from, y], [from + end, y]];
    for (let k = 0; k < 2 * turns; k += 1) {
      points.push([from + end + ((k + 0.5) / (2 * turns)) * (to - from - 2 * end), y + (k % 2 ? 1 : -1) * size * 0.15]);
    }
    this.#line([...points, [to - end, y], [to, y]], this.colours.soft, 1.5);
  }

  /** @param {number} width @param {number} height @param {ArrayLike<number>} x @param {Mark[]} marks */
  #pendulum(width, height, x, marks) {
    const rod = (height - 2 * PAD - 12) / 2;
    const scale = 0.6 / this.reach;
    let [px, py] = [width / 2, PAD];
    this.#line([[px - 40, py - 4], [px + 40, py - 4]], this.colours.ink, 2.5);
    for (let dof = 0; dof < 2; dof += 1) {
      const [fromX, fromY] = [px, py];
      this.stops.forEach((stop, index) => {
        if (stop.dof !== dof || stop.relativeTo !== null) return;
        for (const [gap, side] of /** @type {[number | null, number][]} */ ([[stop.upper, 1], [stop.lower, -1]])) {
          if (gap === null) continue;
          const angle = side * gap * scale + (side * 12) / rod;
          const [u, v] = [-side * Math.cos(angle), side * Math.sin(angle)];
          this.#wall(fromX + rod * Math.sin(angle), fromY + rod * Math.cos(angle), u, v, 36, this.#mark(index, side, marks));
        }
      });
      px += rod * Math.sin(x[dof] * scale);
      py += rod * Math.cos(x[dof] * scale);
      this.#line([[fromX, fromY], [px, py]], this.colours.accent, 2.5);
      this.places.push({ dof, x: px, y: py });
    }
    const first = this.places[0];
    this.#bead(first.x, first.y, 10, this.chosen === 0);
    this.#bead(px, py, 8, this.chosen === 1);
  }

  /** @param {number} width @param {number} height @param {ArrayLike<number>} x @param {Mark[]} marks */
  #cloud(width, height, x, marks) {
    const { colours, context, geometry } = this;
    const nodes = geometry.nodes || [];
    const directions = geometry.directions || [];
    const nodeOf = geometry.nodeOf || [];
    const spans = [0, 1, 2].map((axis) => [Math.min(...nodes.map((node) => node[axis])), Math.max(...nodes.map((node) => node[axis]))]);
    const extent = Math.hypot(...spans.map(([low, high]) => high - low)) || 1;
    const flat = spans[2][0] === spans[2][1];
    const [turn, tilt] = flat && directions.every((each) => !each || each[2] === 0) ? [0, 0] : this.angles;
    const stretch = (0.12 * extent) / this.reach;
    const moved = nodes.map((node) => [...node]);
    for (const dof of geometry.drawn) {
      for (let axis = 0; axis < 3; axis += 1) moved[nodeOf[dof]][axis] += stretch * x[dof] * directions[dof][axis];
    }
    const size = Math.min((width - 2 * PAD) / extent, (height - 2 * PAD) / (0.75 * extent)) * (flat && !turn ? 1.1 : 0.95);
    /** @param {number[]} p @returns {[number, number]} */
    const seen = ([a, b, c]) => {
      const [u, v, w] = [a - (spans[0][0] + spans[0][1]) / 2, b - (spans[1][0] + spans[1][1]) / 2, c - (spans[2][0] + spans[2][1]) / 2];
      if (!turn && !tilt) return [width / 2 + size * u, height / 2 - size * v];
      const [along, deep] = [u * Math.cos(turn) - v * Math.sin(turn), u * Math.sin(turn) + v * Math.cos(turn)];
      return [width / 2 + size * along, height / 2 - size * (w * Math.cos(tilt) + deep * Math.sin(tilt))];
    };
    this.#bar(size * stretch, 12, height - 8, false);
    for (const [a, b] of geometry.links || []) this.#line([seen(nodes[a]), seen(nodes[b])], colours.line, 1);
    for (const [a, b] of geometry.links || []) this.#line([seen(moved[a]), seen(moved[b])], colours.accent, 1.6);
    const radius = Math.min(5, Math.max(1.5, 120 / Math.sqrt(nodes.length + 1) / 6));
    context.fillStyle = colours.accent;
    for (const point of moved) {
      const [a, b] = seen(point);
      context.beginPath();
      context.arc(a, b, radius, 0, 2 * Math.PI);
      context.fill();
    }
    for (const dof of geometry.drawn) {
      const [a, b] = seen(moved[nodeOf[dof]]);
      this.places.push({ dof, x: a, y: b });
    }
    this.stops.forEach((stop, index) => {
      const node = nodes[nodeOf[stop.dof]];
      const direction = directions[stop.dof];
      if (!node || !direction) return;
      for (const [gap, side] of /** @type {[number | null, number][]} */ ([[stop.upper, 1], [stop.lower, -1]])) {
        if (gap === null) continue;
        const shift = side * gap * stretch;
        const from = seen(node);
        const [a, b] = seen(node.map((value, axis) => value + shift * direction[axis]));
        const [c, d] = seen(node.map((value, axis) => value + side * 0.2 * extent * direction[axis]));
        const length = Math.hypot(c - from[0], d - from[1]) || 1;
        const [u, v] = [-(c - from[0]) / length, -(d - from[1]) / length];
        this.#wall(a - u * (radius + 2), b - v * (radius + 2), u, v, 30, this.#mark(index, side, marks), this.#pushed(stop, side, x), (stretch * length) / (0.2 * extent));
      }
      const [a, b] = seen(moved[nodeOf[stop.dof]]);
      this.#bead(a, b, radius + 2, true);
    });
  }
}
