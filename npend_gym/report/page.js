"use strict";
// Shows what was recorded and measured; nothing is computed here but where to draw it.

const data = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
const seconds = (value) => `${value.toFixed(4)} s`;

// ---- the recorded motion ---------------------------------------------------------------------

for (const release of data.releases) {
  const bytes = Uint8Array.from(atob(release.places), (c) => c.charCodeAt(0));
  release.places = new Float32Array(bytes.buffer); // x, y of every bob at every instant, over the chain's length
  release.instants = release.places.length / (2 * release.n);
  release.end = (release.instants - 1) * release.interval;
  release.order = release.periods
    .map((period, k) => ({ bob: k + 1, period }))
    .filter(({ period }) => period !== null)
    .sort((a, b) => a.period - b.period);
}

/** Place of a bob (counted from 0) at a time, between the two nearest instants. */
function place(release, bob, time) {
  const at = Math.min(Math.max(time / release.interval, 0), release.instants - 1);
  const k = Math.min(Math.floor(at), Math.max(release.instants - 2, 0));
  const [i, j] = [2 * (k * release.n + bob), 2 * ((k + 1) * release.n + bob)];
  const { places } = release;
  if (j >= places.length) return [places[i], places[i + 1]];
  const share = at - k;
  return [0, 1].map((c) => places[i + c] + share * (places[j + c] - places[i + c]));
}

// ---- the chain -------------------------------------------------------------------------------

const { ramp: RAMP, tip: TIP } = data.palette;
const TRACE_SECONDS = 3;

function ramp(share) {
  const at = 2 * share, k = Math.min(Math.floor(at), 1);
  return `rgb(${RAMP[k].map((low, c) => Math.round(low + (at - k) * (RAMP[k + 1][c] - low)))})`;
}

function drawChain(release, time) {
  const canvas = $("chain"), ratio = devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const pen = canvas.getContext("2d"), ink = getComputedStyle(canvas).color;
  const scale = 0.46 * Math.min(width, height);
  const pixel = (x, y) => [width / 2 + scale * x, height / 2 - scale * y];
  const disc = (at, radius, color) => {
    pen.fillStyle = color;
    pen.beginPath();
    pen.arc(...at, radius, 0, 2 * Math.PI);
    pen.fill();
  };
  const path = (points, color, lineWidth) => {
    Object.assign(pen, { strokeStyle: color, lineWidth, lineJoin: "round" });
    pen.beginPath();
    points.forEach((at) => pen.lineTo(...at));
    pen.stroke();
  };
  pen.scale(ratio, ratio);
  pen.globalAlpha = 0.25;
  pen.strokeStyle = ink;
  pen.beginPath();
  pen.arc(...pixel(0, 0), scale, 0, 2 * Math.PI);
  pen.stroke();
  const tip = release.n - 1, trace = [];
  for (let t = Math.max(0, time - TRACE_SECONDS); t < time; t += release.interval / 2)
    trace.push(pixel(...place(release, tip, t)));
  pen.globalAlpha = 0.5;
  path(trace, TIP, 2);
  pen.globalAlpha = 1;
  const bobs = [];
  for (let bob = 0; bob < release.n; bob++) bobs.push(pixel(...place(release, bob, time)));
  const joints = [pixel(0, 0), ...bobs], radius = Math.min(8, Math.max(2, (0.35 * scale) / release.n));
  const along = (link, share) =>
    [0, 1].map((c) => joints[link][c] + share * (joints[link + 1][c] - joints[link][c]));
  if (release.centres.length === 0) {
    path(joints, ink, release.n > 60 ? 2.5 : 1.5);
    bobs.forEach((at, bob) => disc(at, radius, ramp(bob / release.n)));
    disc(bobs[tip], Math.max(radius + 1, 5), TIP);
  } else { // links are bars, with a dot at the centre of mass
    pen.lineCap = "round";
    release.centres.forEach((share, link) => {
      path([joints[link], along(link, share)], ink, radius / 2);
      path([joints[link], joints[link + 1]], link === tip ? TIP : ramp(link / release.n), 1.6 * radius);
    });
    release.centres.forEach((share, link) => disc(along(link, share), radius / 2, ink));
    joints.slice(0, -1).forEach((at) => disc(at, radius / 3, "white"));
  }
  for (const { bob, period } of release.order)
    if (period <= time) disc(pixel(...place(release, bob - 1, period)), 0.45 * radius, ink);
  disc(pixel(0, 0), 3, ink);
}

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

// ---- playback --------------------------------------------------------------------------------

let release, dots, cells, time = 0, playing = false, last = 0, told = -1;

function choose(index) {
  release = data.releases[index];
  [time, told] = [0, -1];
  $("time").max = release.end;
  dots = drawBobs(release);
  const rows = release.periods.map((_, k) => {
    const row = document.createElement("tr"), head = document.createElement("th");
    Object.assign(head, { scope: "row", textContent: k + 1 });
    row.append(head, document.createElement("td"));
    return row;
  });
  $("table").tBodies[0].replaceChildren(...rows);
  cells = rows.map((row) => row.cells[1]);
  show();
}

function show() {
  drawChain(release, time);
  $("time").value = time;
  $("time").setAttribute("aria-valuetext", `${time.toFixed(2)} seconds`);
  $("clock").textContent = `${time.toFixed(2)} of ${release.end.toFixed(2)} s`;
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
}

function play(on) {
  playing = on;
  $("play").textContent = on ? "Pause" : "Play";
  if (!on) return;
  if (time >= release.end) time = 0;
  last = performance.now();
  requestAnimationFrame(advance);
}

function advance(now) {
  if (!playing) return;
  time = Math.min(release.end, time + (Math.max(0, now - last) / 1000) * Number($("speed").value));
  last = now;
  show();
  if (time >= release.end) play(false);
  else requestAnimationFrame(advance);
}

function go(to) {
  time = Math.min(Math.max(to, 0), release.end);
  show();
}

data.releases.forEach(({ n, label }, k) => $("release").add(new Option(label, k)));
$("release").onchange = (event) => choose(Number(event.target.value));
$("play").onclick = () => play(!playing);
$("time").oninput = (event) => go(Number(event.target.value));
$("controls").onsubmit = (event) => event.preventDefault();
$("theme").onclick = () => {
  const dark = getComputedStyle(document.body).colorScheme === "dark"
    || (!document.documentElement.style.colorScheme && matchMedia("(prefers-color-scheme: dark)").matches);
  document.documentElement.style.colorScheme = dark ? "light" : "dark";
  show();
};
document.onkeydown = (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey) return;
  if (event.target.closest("button, select, input, summary")) return; // these have keys of their own
  const keys = {
    " ": () => play(!playing), ",": () => go(time - release.interval),
    ".": () => go(time + release.interval), Home: () => go(0), End: () => go(release.end),
  };
  if (!keys[event.key]) return;
  event.preventDefault();
  keys[event.key]();
};
new ResizeObserver(() => drawChain(release, time)).observe($("chain"));
matchMedia("(prefers-color-scheme: dark)").onchange = () => show();
drawLaw();
choose(data.releases.length - 1);
