// Charts: SVG drawn from columns of numbers; colours come from the page's style sheet.
"use strict";

const SVG = "http://www.w3.org/2000/svg";
const GAP = 65535;

/** The numbers of a packed column; null where there is a gap. */
function unpack(column) {
  const bytes = Uint8Array.from(atob(column.data), (c) => c.charCodeAt(0));
  const codes = new DataView(bytes.buffer);
  const step = (column.hi - column.lo || 1) / (GAP - 1);
  const values = [];
  for (let at = 0; at + 1 < bytes.length; at += 2) {
    const code = codes.getUint16(at, true);
    values.push(code === GAP ? null : column.lo + code * step);
  }
  return values;
}

/** A number as people write it: three or four digits, a true minus. */
function show(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  const text =
    size !== 0 && (size < 1e-3 || size >= 1e5)
      ? value.toExponential(digits - 1)
      : String(Number(value.toPrecision(digits)));
  return text.replace(/-/g, "−");
}

function node(name, attributes = {}, parent = null, text = null) {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== null) made.textContent = text;
  if (parent) parent.append(made);
  return made;
}

function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
}

/** Round steps that divide lo..hi into about `count` parts. */
function linearTicks(lo, hi, count) {
  const rough = (hi - lo) / Math.max(count, 1);
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 4, 5, 10].find((k) => k * power >= rough * 0.999) || 10);
  const ticks = [];
  for (let k = Math.ceil(lo / step - 1e-9); k * step <= hi + 1e-9 * step; k += 1) {
    ticks.push(k * step);
  }
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  return ticks.map((value) => [value, value.toFixed(digits).replace(/^-(?=[0.]*$)/, "").replace("-", "−")]);
}

const RAISED = "⁰¹²³⁴⁵⁶⁷⁸⁹";

/** Powers of ten, and their 2 and 5 where a decade or two is all there is; the rest unlabelled. */
function logTicks(lo, hi) {
  const decades = Math.log10(hi / lo);
  const ticks = [];
  for (let power = Math.floor(Math.log10(lo)); 10 ** power <= hi; power += 1) {
    for (let k = 1; k < 10; k += 1) {
      const value = k * 10 ** power;
      if (value < lo * 0.999 || value > hi * 1.001) continue;
      const labelled = k === 1 || (decades < 2.2 && (k === 2 || k === 5));
      const raised = String(Math.abs(power)).replace(/\d/g, (d) => RAISED[d]);
      const plain = power >= -3 && power <= 3 ? show(value, 1) : `10${power < 0 ? "⁻" : ""}${raised}`;
      ticks.push([value, labelled ? plain : ""]);
    }
  }
  return ticks;
}

function extent(columns, log) {
  let lo = Infinity;
  let hi = -Infinity;
  for (const column of columns) {
    for (const value of column) {
      if (value === null || (log && value <= 0)) continue;
      if (value < lo) lo = value;
      if (value > hi) hi = value;
    }
  }
  return lo <= hi ? [lo, hi] : log ? [0.1, 10] : [0, 1];
}

/** From the numbers of an axis to pixels, and its ticks. */
function axis(spec, columns, zoom, from, to, count) {
  let [lo, hi] = zoom || extent(columns, spec.log);
  if (!zoom && !spec.log) {
    if (spec.lo !== undefined) lo = spec.lo;
    if (spec.hi !== undefined) hi = spec.hi;
    if (spec.zero) lo = Math.min(lo, 0);
    const room = (hi - lo || Math.abs(hi) || 1) * (spec.tight ? 0 : 0.06);
    if (!spec.zero && spec.lo === undefined) lo -= room;
    if (spec.hi === undefined) hi += room;
    if (spec.even) [lo, hi] = [-Math.max(-lo, hi), Math.max(-lo, hi)];
  }
  if (hi <= lo) hi = lo + (Math.abs(lo) || 1);
  const flat = spec.log ? Math.log10 : (value) => value;
  const [a, b] = [flat(lo), flat(hi)];
  const at = (value) => from + ((flat(value) - a) / (b - a)) * (to - from);
  const back = (pixel) => {
    const value = a + ((pixel - from) / (to - from)) * (b - a);
    return spec.log ? 10 ** value : value;
  };
  return { lo, hi, at, back, ticks: spec.log ? logTicks(lo, hi) : linearTicks(lo, hi, count) };
}

const FOLDS = {
  rms: (values) => Math.sqrt(values.reduce((sum, value) => sum + value * value, 0) / values.length),
  mean: (values) => values.reduce((sum, value) => sum + value, 0) / values.length,
  max: (values) => Math.max(...values),
};

/** A line or band with neighbours taken together where it has more points than there is room for. */
function folded(one, x, room) {
  if (!one.fold) return one;
  const inside = one.x.reduce((n, value) => n + (value !== null && value >= x.lo && value <= x.hi), 0);
  const each = Math.ceil(inside / room);
  if (each < 2) return one;
  const fold = (column, how) => {
    const values = [];
    for (let k = 0; k < column.length; k += each) {
      const some = column.slice(k, k + each).filter((value) => value !== null);
      values.push(some.length ? FOLDS[how](some) : null);
    }
    return values;
  };
  const made = { ...one, x: fold(one.x, "mean") };
  if (one.y) made.y = fold(one.y, one.fold);
  if (one.lo) Object.assign(made, { lo: fold(one.lo, one.fold), hi: fold(one.hi, "max") });
  return made;
}

/** The `d` of a line; it breaks at gaps. */
function pathOf(xs, ys, x, y) {
  let d = "";
  let down = false;
  for (let k = 0; k < xs.length; k += 1) {
    if (xs[k] === null || ys[k] === null || ys[k] === undefined) {
      down = false;
    } else {
      d += `${down ? "L" : "M"}${x.at(xs[k]).toFixed(1)} ${y.at(ys[k]).toFixed(1)}`;
      down = true;
    }
  }
  return d;
}

/** The `d` of the area between two lines; one piece for each run without gaps. */
function areaOf(xs, los, his, x, y) {
  let d = "";
  let run = [];
  const close = () => {
    if (run.length > 1) {
      const up = run.map((k) => `${x.at(xs[k]).toFixed(1)} ${y.at(his[k]).toFixed(1)}`);
      const down = run.map((k) => `${x.at(xs[k]).toFixed(1)} ${y.at(los[k]).toFixed(1)}`).reverse();
      d += `M${up.join("L")}L${down.join("L")}Z`;
    }
    run = [];
  };
  for (let k = 0; k < xs.length; k += 1) {
    if (xs[k] === null || los[k] === null || his[k] === null) close();
    else run.push(k);
  }
  close();
  return d;
}

let charts = 0;

/**
 * A figure with one plot or several above each other that share the x axis.
 *
 * spec: title, note, summary, x {label, unit, log, lo, hi}, panels [{label, y {log, zero, even},
 * lines [{name, cls, x, y, thin}], bands [{name, cls, x, lo, hi}], dots [{name, cls, x, y}]}],
 * gaps [[from, to]], marks [{t, kind}], height of a panel.
 */
class Chart {
  constructor(parent, spec) {
    this.spec = spec;
    this.zoom = null;
    this.cursor = null;
    charts += 1;
    this.id = `chart-${charts}`;
    const caption = element("figcaption", {}, element("strong", {}, spec.title));
    if (spec.note) caption.append(element("span", { class: "note" }, ` ${spec.note}`));
    this.svg = node("svg", { role: "img", tabindex: "0", focusable: "true" });
    this.svg.setAttribute("aria-label", `${spec.title}. ${spec.summary || ""} Arrow keys read values.`);
    this.readout = element("output", { class: "readout", "aria-live": "polite" });
    const save = element("button", { type: "button", class: "save" }, "Save SVG");
    save.setAttribute("aria-label", `Save the figure ${spec.title} as SVG`);
    save.addEventListener("click", () => saveFigure(this.svg, spec.title));
    const foot = element("div", { class: "foot" }, this.readout, save);
    this.figure = element("figure", { class: spec.wide ? "wide" : "" }, caption, this.legend(), this.svg, foot);
    parent.append(this.figure);
    this.listen();
    new ResizeObserver(() => this.draw()).observe(this.figure);
  }

  legend() {
    const list = element("ul", { class: "legend" });
    const seen = new Set();
    for (const panel of this.spec.panels) {
      for (const kind of ["lines", "bands", "dots"]) {
        for (const one of panel[kind] || []) {
          if (!one.name || seen.has(one.name)) continue;
          seen.add(one.name);
          const key = node("svg", { width: 26, height: 12, "aria-hidden": "true" });
          if (kind === "lines") node("path", { d: "M1 6H25", class: `line ${one.cls}` }, key);
          if (kind === "bands") node("rect", { x: 1, y: 2, width: 24, height: 8, class: `area ${one.cls}` }, key);
          if (kind === "dots") node("circle", { cx: 13, cy: 6, r: 3.5, class: `dot ${one.cls}` }, key);
          list.append(element("li", {}, key, one.name));
        }
      }
    }
    if ((this.spec.gaps || []).length) {
      const key = node("svg", { width: 26, height: 12, "aria-hidden": "true" });
      node("rect", { x: 1, y: 1, width: 24, height: 10, class: "gap" }, key);
      list.append(element("li", {}, key, "no pose"));
    }
    return list;
  }

  draw() {
    const { spec } = this;
    const width = Math.max(this.svg.parentNode.clientWidth - 2, 240);
    const small = width < 480;
    const each = spec.height || (spec.panels.length > 1 ? 120 : 210);
    const tops = spec.panels.map((_, k) => 22 + k * (each + 26));
    const height = tops[tops.length - 1] + each + 44;
    const left = this.left || 46;
    const right = width - 12;
    this.svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    this.svg.setAttribute("width", width);
    this.svg.setAttribute("height", height);
    this.svg.replaceChildren();
    node("title", {}, this.svg, spec.title);
    const defs = node("defs", {}, this.svg);
    const xs = spec.panels.flatMap((p) => [...(p.lines || []), ...(p.bands || []), ...(p.dots || [])].map((s) => s.x));
    const x = axis({ tight: true, ...spec.x }, xs, this.zoom, left, right, small ? 4 : 8);
    this.x = x;
    spec.panels.forEach((panel, k) => {
      const top = tops[k];
      const bottom = top + each;
      const clip = `${this.id}-${k}`;
      const cut = node("clipPath", { id: clip }, defs);
      node("rect", { x: left, y: top - 1, width: right - left, height: each + 2 }, cut);
      const ys = [
        ...(panel.lines || []).map((s) => s.y),
        ...(panel.bands || []).flatMap((s) => [s.lo, s.hi]),
        ...(panel.dots || []).map((s) => s.y),
      ];
      const y = axis(panel.y, ys, null, bottom, top, each < 150 ? 4 : 5);
      this.frame(x, y, left, right, top, bottom, panel.label, k === spec.panels.length - 1, small);
      const plot = node("g", { "clip-path": `url(#${clip})` }, this.svg);
      for (const [a, b] of spec.gaps || []) {
        const from = x.at(a);
        node("rect", { x: from, y: top, width: Math.max(x.at(b) - from, 1), height: each, class: "gap" }, plot);
      }
      const room = (right - left) / 1.6;
      for (const band of (panel.bands || []).map((one) => folded(one, x, room))) {
        node("path", { d: areaOf(band.x, band.lo, band.hi, x, y), class: `area ${band.cls}` }, plot);
      }
      const lines = (panel.lines || []).map((one) => folded(one, x, room));
      for (const line of lines.sort((a, b) => Boolean(b.under) - Boolean(a.under))) {
        node("path", { d: pathOf(line.x, line.y, x, y), class: `line ${line.cls}` }, plot);
      }
      for (const dots of panel.dots || []) {
        dots.x.forEach((value, i) => {
          node("circle", { cx: x.at(value).toFixed(1), cy: y.at(dots.y[i]).toFixed(1), r: 3, class: `dot ${dots.cls}` }, plot);
        });
      }
      for (const mark of spec.marks || []) {
        const at = x.at(mark.t);
        // many of them, of loops say, would hide what they part
        const end = spec.marks.length > 20 ? top + 7 : bottom;
        const line = node("path", { d: `M${at} ${top}V${end}`, class: "mark" }, plot);
        node("title", {}, line, mark.kind);
      }
    });
    this.hair = node("path", { class: "hair" }, this.svg);
    this.brush = node("rect", { class: "brush", y: tops[0], height: tops[tops.length - 1] + each - tops[0], width: 0 }, this.svg);
    this.box = [left, right, tops[0], tops[tops.length - 1] + each];
    const widest = Math.max(...[...this.svg.querySelectorAll(".ytick")].map((t) => t.getComputedTextLength()), 0);
    const wanted = Math.ceil(widest) + 14;
    if (widest > 0 && Math.abs(wanted - left) > 3) {
      this.left = wanted;
      this.draw();
      return;
    }
    this.point(this.cursor);
  }

  frame(x, y, left, right, top, bottom, label, last, small) {
    const grid = node("g", { class: "grid" }, this.svg);
    for (const [value, text] of y.ticks) {
      const at = y.at(value);
      node("path", { d: `M${left} ${at.toFixed(1)}H${right}`, class: text ? "" : "minor" }, grid);
      if (text) node("text", { x: left - 6, y: at + 4, class: "ytick", "text-anchor": "end" }, this.svg, text);
    }
    let free = -Infinity;
    for (const [value, text] of x.ticks) {
      const at = x.at(value);
      node("path", { d: `M${at.toFixed(1)} ${top}V${bottom}`, class: text ? "" : "minor" }, grid);
      const half = text.length * 3.6;
      if (!last || !text || at - half < free) continue;
      free = at + half + (small ? 6 : 10);
      const anchor = at + half > right + 10 ? "end" : "middle";
      node("text", { x: anchor === "end" ? right + 8 : at, y: bottom + 16, class: "tick", "text-anchor": anchor }, this.svg, text);
    }
    node("path", { d: `M${left} ${top}V${bottom}H${right}`, class: "axis" }, this.svg);
    node("text", { x: 2, y: top - 9, class: "label" }, this.svg, label);
    if (last) {
      const { unit, label: name } = this.spec.x;
      node("text", { x: (left + right) / 2, y: bottom + 36, class: "label", "text-anchor": "middle" }, this.svg, unit ? `${name} (${unit})` : name);
    }
  }

  listen() {
    let begun = null;
    const place = (event) => {
      const { left } = this.svg.getBoundingClientRect();
      return Math.min(Math.max(event.clientX - left, this.box[0]), this.box[1]);
    };
    this.svg.addEventListener("pointermove", (event) => {
      if (!this.box) return;
      const at = place(event);
      this.point(this.x.back(at));
      if (begun !== null) {
        this.brush.setAttribute("x", Math.min(begun, at));
        this.brush.setAttribute("width", Math.abs(at - begun));
      }
    });
    this.svg.addEventListener("pointerdown", (event) => {
      if (event.pointerType === "mouse" && event.button === 0 && this.box) begun = place(event);
    });
    window.addEventListener("pointerup", (event) => {
      if (begun === null) return;
      const ends = [begun, place(event)].sort((a, b) => a - b);
      begun = null;
      // a click draws nothing anew: what was clicked must be there still for the second one
      if (ends[1] - ends[0] <= 8) {
        this.brush.setAttribute("width", 0);
        return;
      }
      this.zoom = ends.map(this.x.back);
      this.draw();
    });
    this.svg.addEventListener("dblclick", () => this.whole());
    this.svg.addEventListener("pointerleave", () => this.point(null));
    this.svg.addEventListener("keydown", (event) => {
      if (!this.x || event.ctrlKey || event.metaKey || event.altKey) return;
      const { lo, hi, at, back } = this.x;
      const step = (event.shiftKey ? 10 : 1) * ((this.box[1] - this.box[0]) / 100);
      const here = this.cursor === null ? (this.box[0] + this.box[1]) / 2 : at(this.cursor);
      const moved = { ArrowLeft: here - step, ArrowRight: here + step, Home: this.box[0], End: this.box[1] }[event.key];
      if (moved !== undefined) {
        this.point(back(Math.min(Math.max(moved, this.box[0]), this.box[1])));
      } else if ("+-=".includes(event.key) && event.key.length === 1) {
        const share = event.key === "-" ? 2 : 0.5;
        this.zoom = [here + (at(lo) - here) * share, here + (at(hi) - here) * share].map(back);
        this.draw();
      } else if (event.key === "Escape" || event.key === "0") {
        this.whole();
      } else {
        return;
      }
      event.preventDefault();
    });
  }

  whole() {
    this.zoom = null;
    this.draw();
  }

  /** Puts the hair at an x and says what the lines have there. */
  point(value) {
    this.cursor = value;
    if (value === null || !this.hair) {
      if (this.hair) this.hair.setAttribute("d", "");
      this.readout.textContent = this.zoom ? "zoomed: double click or Esc shows all" : "";
      return;
    }
    const at = this.x.at(value).toFixed(1);
    this.hair.setAttribute("d", `M${at} ${this.box[2]}V${this.box[3]}`);
    const parts = [];
    for (const panel of this.spec.panels) {
      for (const one of [...(panel.lines || []), ...(panel.dots || []), ...(panel.bands || [])]) {
        if (!one.read) continue;
        const k = nearest(one.x, value);
        parts.push(k === null ? "" : `${one.read} ${show((one.y || one.hi)[k])} ${panel.unit || ""}`.trim());
      }
    }
    const { unit, short } = this.spec.x;
    this.readout.textContent = `${short} ${show(value, 4)} ${unit || ""}: ${parts.filter(Boolean).join(", ")}`;
  }
}

/** The index of the value nearest to one; null without any. */
function nearest(values, value) {
  let best = null;
  values.forEach((one, k) => {
    if (one !== null && (best === null || Math.abs(one - value) < Math.abs(values[best] - value))) best = k;
  });
  return best;
}

const STYLED = ["fill", "fill-opacity", "stroke", "stroke-width", "stroke-dasharray", "stroke-opacity", "stroke-linejoin", "font-family", "font-size", "font-weight", "display"];

/** Offers a figure as an SVG file that carries its colours along. */
function saveFigure(svg, title) {
  const copy = svg.cloneNode(true);
  const from = [svg, ...svg.querySelectorAll("*")];
  [copy, ...copy.querySelectorAll("*")].forEach((one, k) => {
    const style = getComputedStyle(from[k]);
    for (const name of STYLED) one.setAttribute(name, style.getPropertyValue(name));
    one.removeAttribute("class");
  });
  copy.setAttribute("xmlns", SVG);
  const file = new Blob([new XMLSerializer().serializeToString(copy)], { type: "image/svg+xml" });
  const link = element("a", { download: `${title.toLowerCase().replace(/[^a-z0-9]+/g, "-")}.svg` });
  link.href = URL.createObjectURL(file);
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}
