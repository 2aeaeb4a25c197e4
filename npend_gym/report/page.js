"use strict";
// What the page shows beside the player: diagrams and tables of what was measured.

// ---- what it shows --------------------------------------------------------------------------

function drawBobs(release) {
  const { n, models } = release;
  const points = release.order.map(({ bob, period }) => ({
    x: bob, y: period, bob, period, text: `bob ${bob}: ${seconds(period)}`,
  }));
  const series = Object.entries(models).map(([name, { color, style, value }]) =>
    level(name, color, style, value, n));
  series.push({ name: "measured", color: "blue", kind: "points", style: n > 40 ? "small" : "", points });
  const high = 1.12 * Math.max(release.end, ...Object.values(models).map(({ value }) => value));
  const x = { label: "bob, from the pivot", low: 0.5, high: n + 0.5, whole: true };
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
