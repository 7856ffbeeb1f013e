// The figures of a run: which columns make which chart.
"use strict";

const AXES = ["x", "y", "z"];

/** Values with their intervals, one row each; pooled rows stand out. */
class Forest {
  constructor(parent, spec) {
    this.spec = spec;
    this.svg = node("svg", { role: "img" });
    this.svg.setAttribute("aria-label", `${spec.title}. The same numbers stand in the table below.`);
    const caption = element("figcaption", {}, element("strong", {}, spec.title), element("span", { class: "note" }, ` ${spec.note}`));
    const save = element("button", { type: "button", class: "save" }, "Save SVG");
    save.setAttribute("aria-label", `Save the figure ${spec.title} as SVG`);
    save.addEventListener("click", () => saveFigure(this.svg, spec.title));
    const list = element("ul", { class: "legend" });
    const floors = spec.rows.map((row) => row.floor).filter((value) => value !== null);
    if (floors.length) {
      const key = node("svg", { width: 26, height: 12, "aria-hidden": "true" });
      node("rect", { x: 1, y: 1, width: 24, height: 10, class: "floor" }, key);
      list.append(element("li", {}, key, `noise floor of each, to ${show(Math.max(...floors))} ${spec.unit}`));
    }
    this.figure = element("figure", { class: "wide" }, caption, list, this.svg, element("div", { class: "foot" }, element("span"), save));
    parent.append(this.figure);
    new ResizeObserver(() => this.draw()).observe(this.figure);
  }

  draw() {
    const { rows, unit } = this.spec;
    const width = Math.max(this.svg.parentNode.clientWidth - 2, 240);
    this.svg.setAttribute("width", width);
    this.svg.replaceChildren();
    const names = rows.map((row) =>
      node("text", { x: 0, class: row.pooled ? "name pooled" : "name" }, this.svg, row.name),
    );
    names.forEach((name) => shorten(name, width - 76));
    const widest = Math.max(...names.map((name) => name.getComputedTextLength()), 40);
    // where names would take the plot's room they stand above their intervals
    const above = widest > width * 0.42;
    const step = above ? 38 : 24;
    const middle = (k) => 14 + k * step + (above ? 26 : 12);
    const bottom = 14 + rows.length * step;
    this.svg.setAttribute("viewBox", `0 0 ${width} ${bottom + 44}`);
    this.svg.setAttribute("height", bottom + 44);
    names.forEach((name, k) => {
      name.setAttribute("y", above ? middle(k) - 10 : middle(k) + 4);
      name.setAttribute("x", above ? 14 : 0);
    });
    const left = above ? 8 : widest + 16;
    const right = width - 62;
    const ends = rows.flatMap((row) => [row.value, row.low ?? row.value, row.high ?? row.value, 0, row.floor ?? 0]);
    const x = axis({ zero: true }, [ends], null, left, right, width < 480 ? 4 : 8);
    const grid = node("g", { class: "grid" });
    this.svg.prepend(grid);
    for (const [value, text] of x.ticks) {
      node("path", { d: `M${x.at(value).toFixed(1)} 8V${bottom}` }, grid);
      node("text", { x: x.at(value), y: bottom + 16, class: "tick", "text-anchor": "middle" }, this.svg, text);
    }
    rows.forEach((row, k) => {
      if (row.floor === null || x.at(row.floor) <= left) return;
      const shade = node("rect", { x: left, y: 8 + k * step, width: x.at(row.floor) - left, height: step + (k === rows.length - 1 ? 6 : 0), class: "floor" });
      grid.after(shade);
      node("title", {}, shade, `noise floor, ${show(row.floor)} ${unit}`);
    });
    node("path", { d: `M${left} 8V${bottom}H${right}`, class: "axis" }, this.svg);
    const label = node("text", { y: bottom + 36, class: "label", "text-anchor": "middle" }, this.svg, `${this.spec.label} (${unit})`);
    const half = label.getComputedTextLength() / 2;
    label.setAttribute("x", Math.max(half, Math.min((left + right) / 2, width - half)));
    const told = numerals(rows);
    rows.forEach((row, k) => {
      const y = middle(k);
      const cls = row.pooled ? "s2" : row.status === "published" ? "s4" : "s1";
      if (row.low !== null && row.high !== null) {
        const [a, b] = [x.at(row.low), x.at(row.high)].map((value) => value.toFixed(1));
        node("path", { d: `M${a} ${y}H${b}M${a} ${y - 4}V${y + 4}M${b} ${y - 4}V${y + 4}`, class: `line ${cls}` }, this.svg);
      }
      const size = row.pooled ? 5.5 : 4;
      node("circle", { cx: x.at(row.value).toFixed(1), cy: y, r: size, class: `dot ${row.status === "ok" ? cls : `${cls} open`}` }, this.svg);
      node("text", { x: right + 8, y: y + 4, class: row.pooled ? "name pooled" : "name" }, this.svg, told(row.value));
    });
  }
}

/** How the values are written: to the second digit of the narrowest interval, where there is one. */
function numerals(rows) {
  const widths = rows.filter((row) => row.low !== null && row.high > row.low).map((row) => row.high - row.low);
  if (!widths.length) return (value) => show(value);
  const decimals = Math.min(Math.max(1 - Math.floor(Math.log10(Math.min(...widths))), 0), 6);
  return (value) => value.toFixed(decimals).replace("-", "−");
}

/** Cuts a text that is wider than there is room; the whole of it stands in its title. */
function shorten(text, room) {
  const whole = text.textContent;
  if (text.getComputedTextLength() <= room) return;
  let [few, many] = [0, whole.length];
  while (many - few > 1) {
    const middle = (few + many) >> 1;
    if (text.getSubStringLength(0, middle) <= room - 12) few = middle;
    else many = middle;
  }
  text.textContent = `${whole.slice(0, few).trimEnd()}…`;
  node("title", {}, text, whole);
}

/** Middles of a take's bins of time. */
function times(take) {
  const count = unpack(take.speed).length;
  return Array.from({ length: count }, (_, k) => Math.min((k + 0.5) * take.bin_s, take.duration_s));
}

function errorPanel(names, take, x) {
  const lines = [];
  const bands = [];
  for (const [name, title, cls, withMax] of names) {
    const error = take.errors[name];
    if (!error) continue;
    const rms = unpack(error.rms);
    if (withMax) bands.push({ name: `largest at the ${title}`, cls, x, lo: rms, hi: unpack(error.max), read: "largest", fold: "rms" });
    lines.push({ name: `rms at the ${title}`, cls, x, y: rms, read: title, under: !withMax, fold: "rms" });
  }
  return { lines, bands };
}

function statistics(error) {
  const q = error.quantiles;
  const last = q.length - 1;
  return `median ${show(q[Math.round(last / 2)])} ${error.unit}, 95 % under ${show(q[Math.round(0.95 * last)])}, largest ${show(q[last])}`;
}

function figuresOfTake(parent, take) {
  parent.replaceChildren();
  const time = times(take);
  const travelled = unpack(take.travelled);
  const truth = take.truth.map(unpack);
  const { eye, tcp, rotation } = take.errors;
  const seconds = { label: "time", unit: "s", short: "t", lo: 0, hi: take.duration_s };
  const gaps = take.missing;
  const marks = take.marks;
  const where = take.point === "eye" ? "eye" : "tcp";
  const each = take.bin_s >= 1 ? `${show(take.bin_s)} s` : `${show(take.bin_s * 1000)} ms`;
  const binned = `points of ${each}`;
  new Space(parent, {
    title: `Path of the ${where}`,
    note: eye ? "coloured by the error" : "of the reference",
    summary: "The true path in space, coloured by the error along it.",
    xyz: truth,
    error: eye ? unpack(eye.rms) : null,
    top: eye ? eye.quantiles[Math.round(0.98 * (eye.quantiles.length - 1))] || 1 : 1,
  });
  const drift = eye && eye.axes ? eye.axes.map(unpack) : null;
  new Chart(parent, {
    title: "Position by axis",
    note: drift ? "headset over reference" : "of the reference",
    x: seconds,
    gaps,
    panels: AXES.map((name, k) => ({
      label: `${name} (m)`,
      unit: "m",
      y: {},
      lines: [
        { name: "reference", cls: "s3 broad", x: time, y: truth[k], read: `${name} reference` },
        ...(drift
          ? [{ name: "headset, aligned", cls: "s1 thin", x: time, y: truth[k].map((p, i) => (p === null || drift[k][i] === null ? null : p + drift[k][i] / 1000)), read: "headset" }]
          : []),
      ],
    })),
    height: 78,
  });
  if (eye) {
    const named = [["eye", "eye", "s1", true], ["tcp", "tcp", "s2 dash", false]];
    new Chart(parent, {
      title: "APE over time", note: `translation, ${binned}`, summary: `At the eye ${statistics(eye)}.`, wide: true,
      x: seconds, gaps, marks,
      panels: [{ label: "error (mm)", unit: "mm", y: { zero: true }, ...errorPanel(named, take, time) }],
    });
    new Chart(parent, {
      title: "APE along the path", note: "translation, over the length travelled", summary: `At the eye ${statistics(eye)}.`, wide: true,
      x: { label: "length of the true path", unit: "m", short: "s" },
      panels: [{ label: "error (mm)", unit: "mm", y: { zero: true }, ...errorPanel(named, take, travelled) }],
    });
    if (drift) {
      new Chart(parent, {
        title: "Error by axis", note: `at the eye, mean, ${binned}`, summary: "Mean error vector over time.", x: seconds, gaps, marks,
        panels: AXES.map((name, k) => ({
          label: `${name} (mm)`, unit: "mm", y: { even: true },
          lines: [{ cls: "s1", x: time, y: drift[k], read: name, fold: "mean" }],
        })),
        height: 66,
      });
    }
    new Chart(parent, {
      title: "Rotation error over time", note: binned, summary: statistics(rotation), x: seconds, gaps, marks,
      panels: [{ label: "error (deg)", unit: "deg", y: { zero: true }, ...errorPanel([["rotation", "eye", "s4", true]], take, time) }],
      height: 250,
    });
    const share = (error) => error.quantiles.map((_, k) => (100 * k) / (error.quantiles.length - 1));
    new Chart(parent, {
      title: "Distribution of the error", note: "translation, share of samples below", summary: statistics(eye),
      x: { label: "error", unit: "mm", short: "error", zero: true, lo: 0 },
      panels: [{
        label: "samples below (%)", unit: "%", y: { lo: 0, hi: 100 },
        lines: [
          { name: "at the eye", cls: "s1", x: eye.quantiles, y: share(eye), read: "eye" },
          { name: "at the tcp", cls: "s2 dash", x: tcp.quantiles, y: share(tcp), read: "tcp" },
        ],
      }],
    });
  }
  if (take.by_speed) {
    const { speed, quartiles, p95 } = take.by_speed;
    new Chart(parent, {
      title: "Error against speed", note: "at the eye, classes of equally many samples", summary: "Median, quartiles and 95th percentile of the error by true speed.",
      x: { label: "true speed of the eye", unit: "m/s", short: "speed", lo: 0 },
      panels: [{
        label: "error (mm)", unit: "mm", y: { zero: true },
        bands: [{ name: "middle half", cls: "s1", x: speed, lo: quartiles[0], hi: quartiles[2] }],
        lines: [
          { name: "median", cls: "s1", x: speed, y: quartiles[1], read: "median" },
          { name: "95th percentile", cls: "s2 dash", x: speed, y: p95, read: "95 %" },
        ],
      }],
    });
  }
  if (take.spectrum) {
    new Chart(parent, {
      title: "Spectrum of the error", note: "translation at the eye, Welch", summary: "Amplitude spectral density by frequency.",
      x: { label: "frequency", unit: "Hz", short: "f", log: true },
      panels: [{
        label: "density (mm/√Hz)", unit: "mm/√Hz", y: { log: true },
        lines: [{ cls: "s1", x: take.spectrum.hz, y: take.spectrum.density, read: "density" }],
      }],
    });
  }
  if (take.clock) {
    const [t, ms] = take.clock;
    new Chart(parent, {
      title: "Clock residual", note: "offset of windows of 30 s from the clock used", summary: "How far each window's own offset lies from the fitted clock.",
      x: seconds,
      panels: [{ label: "residual (ms)", unit: "ms", y: { even: true }, dots: [{ cls: "s1", x: t, y: ms, read: "window" }] }],
    });
  }
  coverage(parent, take, seconds);
  if (take.loops.length === 2) loops(parent, take);
}

/** When there were poses, and what happened. */
function coverage(parent, take, seconds) {
  const speed = unpack(take.speed);
  const lost = take.missing.reduce((sum, [a, b]) => sum + b - a, 0);
  const kinds = [...new Set(take.marks.map((mark) => mark.kind))];
  const events = take.marks.length ? `; dashed: ${kinds.join(", ")}` : "";
  new Chart(parent, {
    title: "Coverage and speed", wide: true, height: 90,
    note: `${take.missing.length} ${take.missing.length === 1 ? "gap" : "gaps"}, ${show(lost)} s in all${events}`,
    summary: `Poses are missing for ${show(lost)} of ${show(take.duration_s, 4)} seconds.`,
    x: seconds, gaps: take.missing, marks: take.marks,
    panels: [{ label: "true speed (m/s)", unit: "m/s", y: { zero: true }, lines: [{ cls: "s3", x: times(take), y: speed, read: "speed", fold: "mean" }] }],
  });
}

/** The first and the last loop of a looped motion over each other. */
function loops(parent, take) {
  const styles = ["s1", "s2 dash"];
  new Chart(parent, {
    title: "First and last loop", note: "error at the eye by axis", wide: true, height: 100,
    summary: "Error by axis over the first and over the last loop.",
    x: { label: "time in the loop", unit: "s", short: "t", lo: 0 },
    panels: AXES.map((name, k) => ({
      label: `${name} (mm)`, unit: "mm", y: { even: true },
      lines: take.loops.map((loop, i) => {
        const y = unpack(loop.axes[k]);
        return { name: loop.name, cls: styles[i], x: y.map((_, j) => ((j + 0.5) * loop.duration_s) / y.length), y, read: loop.name };
      }),
    })),
  });
}

// Characters that turn the direction of what stands beside them: names are other people's words.
const TURNING = /[\u202a-\u202e\u2066-\u2069]/g;

/** What the page holds as JSON under an id; null where it doesn't. */
function held(id) {
  const found = document.getElementById(id);
  return found ? JSON.parse(found.textContent, (_, value) => (typeof value === "string" ? value.replace(TURNING, "") : value)) : null;
}

function drawFigures() {
  for (const spec of held("forests") || []) new Forest(document.getElementById("intervals"), spec);
  const choice = document.getElementById("take");
  const curves = held("curves");
  if (!choice || !curves) return;
  const draw = () => figuresOfTake(document.getElementById("figures"), curves.takes[choice.selectedIndex]);
  choice.addEventListener("change", draw);
  draw();
}

drawFigures();
