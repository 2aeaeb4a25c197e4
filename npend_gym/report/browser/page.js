// What the page shows beside the player: diagrams and tables of what was measured.

let told; // how many bobs the page says have completed

beside.chosen = () => { told = -1; };

beside.shown = () => {
  const { n, periods, models, end } = release;
  const known = periods.map((period) => (period !== null && period <= time ? period : 0));
  const done = known.filter((period) => period > 0);
  if (done.length === told) return;
  told = done.length;
  showPeriods(known, Object.entries(models).map(([name, model]) => ({ name, ...model })), end);
  const mean = done.reduce((total, period) => total + period, 0) / done.length, last = Math.max(...done);
  const count = completion(done.length, n);
  $("state").textContent = done.length
    ? `${count}, mean ${seconds(mean)}; latest: bob ${known.indexOf(last) + 1}, ${seconds(last)}`
    : count;
  $("chain").setAttribute("aria-label", `Animation of ${plural(n, "pendulum")}; ${count}`);
};

function drawLaw({ series, x, y }) {
  const named = series.map((one) => ({ ...one, points: one.points.map(([n, value, text]) => ({
    x: n, y: value, text: text ?? `${one.name}, N = ${n}: ${seconds(value)}`,
  })) }));
  plot($("law"), "Pseudo-period against the number of pendulums, with models",
    { ...x, label: "number of pendulums N", whole: true }, { ...y, label: "pseudo-period [s]" }, named);
}

drawLaw(data.law);
