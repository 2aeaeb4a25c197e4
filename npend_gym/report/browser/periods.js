// The pseudo-periods of all bobs: as a diagram with their models, and in the table.

/** How many of n bobs have completed, in words. */
const completion = (done, n) => `${done} of ${plural(n, "bob")} ${done === 1 ? "has" : "have"} completed`;

/** A series for the diagram of n bobs: a line across it. */
function level(name, color, style, value, n) {
  const points = [0.5, n + 0.5].map((x) => ({ x, y: value, text: `${name}: ${seconds(value)}` }));
  return { name: `${name}: ${seconds(value)}`, color, style, kind: "line", points };
}

/**
 * Show the `periods` of all bobs [s], 0 where one is not complete, with `levels`, each of which has
 * a name, a colour, a style and a value [s]. The axis reaches `high` at least.
 */
function showPeriods(periods, levels, high = 0) {
  const n = periods.length, known = levels.filter(({ value }) => value > 0);
  const points = periods.map((period, k) => ({ x: k + 1, y: period, text: `bob ${k + 1}: ${seconds(period)}` }));
  const series = known.map(({ name, color, style, value }) => level(name, color, style, value, n));
  series.push({ name: "bobs", color: "blue", kind: "points", style: n > 40 ? "small" : "",
    points: points.filter(({ y }) => y > 0) });
  const x = { label: "bob, from the pivot", low: 0.5, high: n + 0.5, whole: true };
  const highest = 1.12 * Math.max(high, ...periods, ...known.map(({ value }) => value));
  const y = { label: "pseudo-period [s]", low: 0, high: highest || 1 };
  plot($("periods"), `Pseudo-period of each of ${plural(n, "bob")}`, x, y, series);
  const rows = periods.map((period, k) => {
    const row = document.createElement("tr"), head = document.createElement("th");
    Object.assign(head, { scope: "row", textContent: k + 1 });
    const cell = Object.assign(document.createElement("td"), { textContent: period > 0 ? period.toFixed(4) : "\u2013" });
    row.append(head, cell);
    return row;
  });
  $("table").tBodies[0].replaceChildren(...rows);
}
