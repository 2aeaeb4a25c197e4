"use strict";
// What the page shows beside the player: diagrams and tables of what was measured.

const seconds = (value) => `${value.toFixed(4)} s`;

// ---- diagrams --------------------------------------------------------------------------------

const BOX = { width: 480, height: 330, left: 46, right: 470, top: 10, bottom: 288 };

function draw(parent, name, attributes, text) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  return parent.appendChild(element);
}

/** Round numbers between low and high: at most eight of them, or 1, 2, 5, 10, ... on a log axis. */
function ticks({ low, high, log }) {
  const decades = Array.from({ length: 15 }, (_, k) => 10 ** (k - 6));
  const round = decades.flatMap((power) => [1, 2, 5].map((digit) => digit * power));
  if (log) return round.filter((value) => value >= low && value <= high);
  const step = round.find((size) => (high - low) / size <= 8);
  const first = Math.ceil(low / step), count = Math.floor(high / step) - first + 1;
  return Array.from({ length: count }, (_, k) => (first + k) * step);
}

function scaled({ low, high, log }, from, to) {
  const bend = log ? Math.log : (value) => value;
  return (value) => from + ((bend(value) - bend(low)) / (bend(high) - bend(low))) * (to - from);
}

function drawAxes(svg, x, y, across, up) {
  const middle = (BOX.left + BOX.right) / 2;
  for (const value of ticks(x)) {
    const at = across(value), text = { x: at, y: BOX.bottom + 18, "text-anchor": "middle" };
    draw(svg, "line", { class: "grid", x1: at, x2: at, y1: BOX.top, y2: BOX.bottom });
    draw(svg, "text", text, Number(value.toPrecision(6)));
  }
  for (const value of ticks(y)) {
    const at = up(value), text = { x: BOX.left - 6, y: at + 4, "text-anchor": "end" };
    draw(svg, "line", { class: "grid", x1: BOX.left, x2: BOX.right, y1: at, y2: at });
    draw(svg, "text", text, Number(value.toPrecision(6)));
  }
  draw(svg, "path", { class: "axis", d: `M${BOX.left},${BOX.top}V${BOX.bottom}H${BOX.right}` });
  draw(svg, "text", { x: middle, y: BOX.height - 6, "text-anchor": "middle" }, x.label);
  draw(svg, "text", { x: BOX.left + 6, y: BOX.top + 10 }, y.label);
}

/** Draw series of {x, y, text} as lines or dots, with hover and arrow keys; return the dots. */
function plot(svg, label, x, y, series) {
  const across = scaled(x, BOX.left, BOX.right), up = scaled(y, BOX.bottom, BOX.top);
  svg.replaceChildren();
  svg.setAttribute("viewBox", `0 0 ${BOX.width} ${BOX.height}`);
  svg.setAttribute("aria-label", `${label}. Arrow keys go from value to value.`);
  drawAxes(svg, x, y, across, up);
  const legend = svg.parentElement.querySelector(".legend"), dots = [];
  legend.replaceChildren();
  for (const { name, color, kind, style = "", points } of series) {
    const key = document.createElement("span"), look = `--color: var(--${color})`;
    Object.assign(key, { textContent: name, className: kind, style: look });
    legend.append(key);
    const at = points.map((point) => [across(point.x), up(point.y)]);
    if (kind === "line") draw(svg, "path", { class: `line ${style}`, style: look, d: `M${at.join("L")}` });
    points.forEach((point, k) => {
      const r = kind === "line" ? 0 : style === "small" ? 2.5 : 4.5;
      const shape = { class: `dot ${style}`, style: look, cx: at[k][0], cy: at[k][1], r };
      dots.push({ ...point, at: at[k], shown: true, element: draw(svg, "circle", shape) });
    });
  }
  point(svg, dots);
  return dots;
}

/** Let pointer and arrow keys choose a dot, whose text appears beside it. */
function point(svg, dots) {
  const tip = svg.parentElement.querySelector(".tip");
  let chosen = null;
  const choose = (dot) => {
    chosen?.element.classList.remove("chosen");
    chosen = dot;
    tip.textContent = dot ? dot.text : "";
    if (!dot) return;
    dot.element.classList.add("chosen");
    const [inner, outer] = [svg, svg.parentElement].map((box) => box.getBoundingClientRect());
    const scale = inner.width / BOX.width, room = tip.offsetWidth / 2;
    const side = Math.min(Math.max(dot.at[0] * scale, room), inner.width - room);
    tip.style.left = `${inner.left - outer.left + side}px`;
    tip.style.top = `${inner.top - outer.top + dot.at[1] * scale}px`;
  };
  svg.onpointermove = (event) => {
    const frame = svg.getBoundingClientRect(), scale = BOX.width / frame.width;
    const [x, y] = [(event.clientX - frame.left) * scale, (event.clientY - frame.top) * scale];
    const far = (dot) => Math.hypot(dot.at[0] - x, dot.at[1] - y);
    const near = dots.filter((dot) => dot.shown && far(dot) < 24).sort((a, b) => far(a) - far(b));
    choose(near[0] ?? null);
  };
  svg.onpointerleave = svg.onblur = () => choose(null);
  svg.onkeydown = (event) => {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    const shown = dots.filter((dot) => dot.shown);
    if (!step || !shown.length) return;
    event.preventDefault();
    const next = chosen ? shown.indexOf(chosen) + step : step > 0 ? 0 : shown.length - 1;
    choose(shown[(next + shown.length) % shown.length]);
  };
}

function level(name, color, style, value, n) {
  const text = `${name}: ${seconds(value)}`;
  const points = [0.5, n + 0.5].map((x) => ({ x, y: value, text }));
  return { name, color, style, kind: "line", points };
}

function drawBobs(release) {
  const { n, models } = release;
  const points = release.order.map(({ bob, period }) => ({
    x: bob, y: period, bob, period, text: `bob ${bob}: ${seconds(period)}`,
  }));
  const series = Object.entries(models).map(([name, { color, style, value }]) =>
    level(name, color, style, value, n));
  series.push({ name: "measured", color: "blue", kind: "points", style: n > 40 ? "small" : "", points });
  const high = 1.12 * Math.max(release.end, ...Object.values(models).map(({ value }) => value));
  const x = { label: "bob, from the pivot", low: 0.5, high: n + 0.5 };
  const y = { label: "pseudo-period [s]", low: 0, high };
  return plot($("bobs"), `Pseudo-period of each of ${n} bobs`, x, y, series)
    .filter((dot) => dot.bob !== undefined);
}

function drawLaw() {
  const { series, x, y } = data.law;
  const named = series.map((one) => ({ ...one, points: one.points.map(([n, value, text]) => ({
    x: n, y: value, text: text ?? `${one.name}, N = ${n}: ${seconds(value)}`,
  })) }));
  const [left, up] = [{ ...x, label: "number of pendulums N" }, { ...y, label: "pseudo-period [s]" }];
  plot($("law"), "Pseudo-period against the number of pendulums, with models", left, up, named);
}

// ---- beside the player -----------------------------------------------------------------------

let dots, cells, told;

beside.chosen = () => {
  told = -1;
  dots = drawBobs(release);
  const rows = release.periods.map((_, k) => {
    const row = document.createElement("tr"), head = document.createElement("th");
    Object.assign(head, { scope: "row", textContent: k + 1 });
    row.append(head, document.createElement("td"));
    return row;
  });
  $("table").tBodies[0].replaceChildren(...rows);
  cells = rows.map((row) => row.cells[1]);
};

beside.shown = () => {
  const done = release.order.filter(({ period }) => period <= time);
  if (done.length === told) return;
  told = done.length;
  for (const dot of dots) {
    dot.shown = dot.period <= time;
    dot.element.style.display = dot.shown ? "" : "none";
  }
  release.periods.forEach((period, k) => {
    cells[k].textContent = period !== null && period <= time ? period.toFixed(4) : "\u2013";
  });
  const sum = done.reduce((total, { period }) => total + period, 0);
  const latest = done.at(-1), count = `${done.length} of ${release.n} bobs have completed`;
  $("state").textContent = latest
    ? `${count}, mean ${seconds(sum / done.length)}; latest: bob ${latest.bob}, ${seconds(latest.period)}`
    : count;
  $("chain").setAttribute("aria-label", `Animation of ${release.n} pendulums; ${count}`);
};

$("theme").onclick = () => {
  const dark = getComputedStyle(document.body).colorScheme === "dark"
    || (!document.documentElement.style.colorScheme && matchMedia("(prefers-color-scheme: dark)").matches);
  document.documentElement.style.colorScheme = dark ? "light" : "dark";
  show();
};
drawLaw();
