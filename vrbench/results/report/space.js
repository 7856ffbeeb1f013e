// The path in space: an orthographic view that turns, coloured by the error along it.
"use strict";

const CLASSES = 5;
const BITS = 60;
// Yaw and pitch (rad) of the views on offer: one from a corner, and three along an axis.
const VIEWS = [
  ["corner", [-0.7, 0.45]],
  ["from above", [0, Math.PI / 2]],
  ["along y", [0, 0]],
  ["along x", [Math.PI / 2, 0]],
];

class Space {
  constructor(parent, spec) {
    this.spec = spec;
    this.turn = VIEWS[0][1];
    this.svg = node("svg", { role: "img", tabindex: "0", class: "space" });
    this.svg.setAttribute("aria-label", `${spec.title}. ${spec.summary} Arrow keys turn it.`);
    const caption = element("figcaption", {}, element("strong", {}, spec.title), element("span", { class: "note" }, ` ${spec.note}`));
    const save = element("button", { type: "button", class: "save" }, "Save SVG");
    save.setAttribute("aria-label", `Save the figure ${spec.title} as SVG`);
    save.addEventListener("click", () => saveFigure(this.svg, spec.title));
    const views = element("div", { class: "views", role: "group", "aria-label": "View" }, "drag or arrow keys turn it:");
    for (const [name, turn] of VIEWS) {
      const button = element("button", { type: "button" }, name);
      button.addEventListener("click", () => this.look(turn));
      views.append(button);
    }
    this.figure = element("figure", {}, caption, this.legend(), this.svg, element("div", { class: "foot" }, views, save));
    parent.append(this.figure);
    this.listen();
    new ResizeObserver(() => this.draw()).observe(this.figure);
  }

  /** Upper ends of the classes of error, in equal steps; the last takes what is beyond. */
  get ends() {
    return Array.from({ length: CLASSES }, (_, k) => ((k + 1) * this.spec.top) / CLASSES);
  }

  legend() {
    const list = element("ul", { class: "legend" });
    if (!this.spec.error) return list;
    this.ends.forEach((end, k) => {
      const key = node("svg", { width: 26, height: 12, "aria-hidden": "true" });
      node("path", { d: "M1 6H25", class: `line e${k}` }, key);
      const text = k < CLASSES - 1 ? `to ${show(end, 2)}` : `over ${show(this.ends[k - 1], 2)} mm`;
      list.append(element("li", {}, key, text));
    });
    return list;
  }

  listen() {
    let last = null;
    this.svg.addEventListener("pointerdown", (event) => {
      last = [event.clientX, event.clientY];
      this.svg.setPointerCapture(event.pointerId);
    });
    this.svg.addEventListener("pointerup", () => { last = null; });
    this.svg.addEventListener("pointercancel", () => { last = null; });
    this.svg.addEventListener("pointermove", (event) => {
      if (!last) return;
      this.rotate((event.clientX - last[0]) / 120, (event.clientY - last[1]) / 120);
      last = [event.clientX, event.clientY];
    });
    this.svg.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[event.key];
      if (!by) return;
      event.preventDefault();
      this.rotate(...by);
    });
  }

  rotate(yaw, pitch) {
    const steepest = Math.PI / 2;
    this.look([this.turn[0] + yaw, Math.min(Math.max(this.turn[1] + pitch, -steepest), steepest)]);
  }

  look(turn) {
    this.turn = turn;
    this.draw();
  }

  draw() {
    const width = Math.max(this.svg.parentNode.clientWidth - 2, 240);
    const height = Math.min(width * 0.75, 380);
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.svg.setAttribute("width", width);
    this.svg.setAttribute("height", height);
    this.svg.replaceChildren();
    const { xyz } = this.spec;
    const box = xyz.map((column) => extent([column], false));
    const middle = box.map(([lo, hi]) => (lo + hi) / 2);
    const sides = box.map(([lo, hi]) => hi - lo);
    const size = Math.hypot(...sides) || 1;
    const [yaw, pitch] = this.turn;
    const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
    // how wide and how high the box is seen; a slender one reaches further than its share
    const wide = sides[0] * Math.abs(cy) + sides[1] * Math.abs(sy);
    const high = sides[2] * Math.abs(cp) + (sides[0] * Math.abs(sy) + sides[1] * Math.abs(cy)) * Math.abs(sp);
    const [across, down] = [width - 130, height - 56];
    const scale = Math.min((Math.min(across, height - 40) / size) * 1.2, across / (wide || size), down / (high || size));
    const flat = (p) => {
      const [a, b, c] = p.map((value, k) => value - middle[k]);
      const [u, v] = [a * cy - b * sy, a * sy + b * cy];
      return [width / 2 + u * scale, height / 2 - (c * cp + v * sp) * scale];
    };
    this.cage(box, flat, size, width);
    this.bits = [];
    // drawn bit by bit: in one go the largest errors of any pass would cover all that lies there
    const bit = Math.ceil(xyz[0].length / BITS);
    let paths = [];
    let before = null;
    for (let k = 0; k < xyz[0].length; k += 1) {
      if (k % bit === 0) paths = this.bit();
      const p = xyz.map((column) => column[k]);
      if (p.includes(null)) { before = null; continue; }
      const here = flat(p).map((value) => value.toFixed(1)).join(" ");
      const error = this.spec.error ? this.spec.error[k] : null;
      const at = error === null ? 0 : Math.min(Math.floor((error / this.spec.top) * CLASSES), CLASSES - 1);
      if (before !== null) paths[at].d += `M${before}L${here}`;
      before = here;
    }
    for (const { d, path } of this.bits) {
      if (d) path.setAttribute("d", d);
      else path.remove();
    }
  }

  /** A path for each class, for a stretch of time. */
  bit() {
    const paths = Array.from({ length: CLASSES }, (_, k) => (
      { d: "", path: node("path", { class: `line ${this.spec.error ? `e${k}` : "s1"}` }, this.svg) }
    ));
    this.bits.push(...paths);
    return paths;
  }

  /** The box around the path, with the lengths of its sides. */
  cage(box, flat, size, width) {
    const corner = (bits) => box.map((ends, k) => ends[bits[k]]);
    let d = "";
    for (let k = 0; k < 3; k += 1) {
      for (const [a, b] of [[0, 0], [0, 1], [1, 0], [1, 1]]) {
        const ends = [0, 1].map((end) => {
          const bits = [a, b];
          bits.splice(k, 0, end);
          return flat(corner(bits)).map((value) => value.toFixed(1)).join(" ");
        });
        d += `M${ends[0]}L${ends[1]}`;
      }
    }
    node("path", { d, class: "cage" }, this.svg);
    const centre = flat(box.map(([lo, hi]) => (lo + hi) / 2));
    for (let k = 0; k < 3; k += 1) {
      // of the four parallel edges, the one whose middle lies lowest and outermost
      const middles = [[0, 0], [0, 1], [1, 0], [1, 1]].map(([a, b]) => {
        const bits = [a, b];
        bits.splice(k, 0, 0);
        const from = corner(bits);
        const to = [...from];
        to[k] = box[k][1];
        const p = flat(from.map((value, i) => (value + to[i]) / 2));
        const far = flat(to);
        const near = flat(from);
        return { p, length: Math.hypot(far[0] - near[0], far[1] - near[1]), weight: k < 2 ? p[1] : Math.abs(p[0] - centre[0]) + (p[0] < centre[0] ? 1 : 0) };
      });
      const best = middles.reduce((a, b) => (b.weight > a.weight ? b : a));
      // seen from its end a side has no length to tell
      if (best.length < 12) continue;
      const away = [best.p[0] - centre[0], best.p[1] - centre[1]];
      const length = Math.hypot(...away) || 1;
      const at = [best.p[0] + (away[0] / length) * 14, best.p[1] + (away[1] / length) * 14 + 4];
      const anchor = away[0] > 20 ? "start" : away[0] < -20 ? "end" : "middle";
      const side = box[k][1] - box[k][0];
      const text = node("text", { y: at[1], class: "tick", "text-anchor": anchor }, this.svg, `${"xyz"[k]} ${show(side, size < 10 ? 2 : 3)} m`);
      const wide = text.getComputedTextLength();
      const before = { start: 0, middle: wide / 2, end: wide }[anchor];
      text.setAttribute("x", Math.min(Math.max(at[0], before), width - wide + before));
    }
  }
}
