// Diagrams of lines and dots, whose values show under the pointer and by the arrow keys.

const BOX = { width: 480, height: 330, left: 46, right: 470, top: 24, bottom: 288 };

function draw(parent, name, attributes, text) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  if (text !== undefined) element.textContent = text;
  return parent.appendChild(element);
}

/** Round (or whole) numbers between low and high: at most eight; 1, 2, 5, 10, ... on a log axis with four of them. */
function ticks({ low, high, log, whole, marks }) {
  if (marks) return marks;
  const decades = Array.from({ length: 15 }, (_, k) => 10 ** (k - 6));
  const round = decades.flatMap((power) => [1, 2, 5].map((digit) => digit * power));
  const within = round.filter((value) => value >= low && value <= high);
  if (log && within.length > 3) return within;
  const step = round.find((size) => (high - low) / size <= 8 && !(whole && size < 1));
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
  draw(svg, "text", { x: 4, y: BOX.top - 10 }, y.label);
}

/** The path through points: straight, `smooth` (a Catmull-Rom spline), or a dash through a single one. */
function path(at, smooth) {
  if (at.length === 1) return `M${at[0][0] - 14},${at[0][1]}h28`;
  if (!smooth) return `M${at.join("L")}`;
  const from = (k) => at[Math.min(Math.max(k, 0), at.length - 1)];
  const beside = (k, side) => from(k).map((place, c) => place + (side * (from(k + 1)[c] - from(k - 1)[c])) / 6);
  return `M${at[0]}` + at.slice(1).map((to, k) => `C${beside(k, 1)} ${beside(k + 1, -1)} ${to}`).join("");
}

/** Draw series of {x, y, text} as lines or dots, whose texts show by hover and arrow keys. */
function plot(svg, label, x, y, series) {
  const across = scaled(x, BOX.left, BOX.right), up = scaled(y, BOX.bottom, BOX.top);
  svg.replaceChildren();
  svg.setAttribute("viewBox", `0 0 ${BOX.width} ${BOX.height}`);
  svg.setAttribute("aria-label", `${label}. Arrow keys go from value to value.`);
  drawAxes(svg, x, y, across, up);
  const legend = svg.parentElement.querySelector(".legend"), dots = [];
  legend.replaceChildren();
  for (const { name, color, kind, style = "", smooth, points } of series) {
    const key = document.createElement("span"), look = `--color: var(--${color})`;
    Object.assign(key, { textContent: name, className: `${kind} ${style}`, style: look });
    legend.append(key);
    const at = points.map((point) => [across(point.x), up(point.y)]);
    if (kind === "line") draw(svg, "path", { class: `line ${style}`, style: look, d: path(at, smooth) });
    points.forEach((point, k) => {
      const r = kind === "line" ? 0 : style === "small" ? 2.5 : 4.5;
      const shape = { class: `dot ${style}`, style: look, cx: at[k][0], cy: at[k][1], r };
      dots.push({ ...point, at: at[k], element: draw(svg, "circle", shape) });
    });
  }
  point(svg, dots);
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
    const near = dots.filter((dot) => far(dot) < 24).sort((a, b) => far(a) - far(b));
    choose(near[0] ?? null);
  };
  svg.onpointerleave = svg.onblur = () => choose(null);
  choose(null);
  svg.onkeydown = (event) => {
    const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
    if (!step || !dots.length) return;
    event.preventDefault();
    const next = chosen ? dots.indexOf(chosen) + step : step > 0 ? 0 : dots.length - 1;
    choose(dots[(next + dots.length) % dots.length]);
  };
}
