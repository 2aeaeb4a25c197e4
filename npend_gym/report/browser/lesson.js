// In class: an angle for every rod, a second chain nearly like the first, plots, files.

const ROWS = 18000; // the latest ones, kept for the table and the plots: five minutes
const SHOWN = 600; // of them in a plot: ten seconds
let rows = []; // time, angles, angular velocities, energy, kinetic energy, angles of the second chain, place and velocity of a cart
let film = null; // a MediaRecorder that runs

/** The angles of a release [rad]: those that the reader has written, the last one for rods without, or the slider's. */
function written() {
  const { angles } = understood();
  if (angles.length > 1 && !given) $("n").value = angles.length;
  const n = parameters().masses.length;
  return Array.from({ length: n }, (_, k) => ((angles[k] ?? angles.at(-1) ?? value("angle")) / 180) * Math.PI);
}

/**
 * The angles [degrees] in the reader's text, or what is `wrong` with it. They stand between commas,
 * semicolons or blanks; beside semicolons a comma is a decimal one.
 */
function understood() {
  const text = $("angles").value, most = given ? given.masses.length : Number($("n").max);
  const plain = text.replace(/[\u2212\u2013]/g, "-").replaceAll("\u00b0", " ");
  const parts = (plain.includes(";") ? plain.replaceAll(",", ".").split(/[;\s]+/) : plain.split(/[,\s]+/)).filter(Boolean);
  const odd = parts.find((part) => !Number.isFinite(Number(part)));
  if (odd) return { angles: [], wrong: `\u201c${odd}\u201d is no number. Write degrees, one for each rod, as in 120, -10.` };
  if (parts.length > most) return { angles: [], wrong: `${parts.length} angles, but at most ${plural(most, "rod")}.` };
  return { angles: parts.map(Number).map(bounded), decimal: !plain.includes(";") && /\d,\d/.test(plain) };
}

/** Say what was understood of the angles, or what is wrong with them. */
function sayAngles() {
  const { angles, wrong = "", decimal } = understood(), n = parameters().masses.length;
  const each = angles.map((angle) => `${angle}\u00b0`.replace("-", "\u2212"));
  let text = wrong;
  if (each.length) text = `${plural(n, "rod")}: ${each.join(", ")}${n > each.length ? `, and ${each.at(-1)} for the others` : ""}.`;
  if (decimal) text += " A decimal has a point: 120.5, -10.";
  if (text !== $("understood").textContent) $("understood").textContent = text;
  $("understood").className = wrong ? "hint wrong" : "hint";
  $("angles").setAttribute("aria-invalid", Boolean(wrong));
}

function record() {
  if (ticked % 2) return;
  if (rows.length === ROWS) rows.shift();
  rows.push([chain.output("TIME"), ...chain.theta, ...chain.omega, chain.output("ENERGY"), chain.kinetic,
    ...(twin ? second.theta : []), ...(chain.cart === null ? [] : [chain.place, chain.speed])]);
}

function showPlots() {
  if (!$("lesson").open) return;
  const { n } = chain, shown = rows.slice(-SHOWN).filter((_, k) => k % 2 === 0), energy = 2 * n + 1;
  if (shown.length < 2) return;
  const series = (name, color, x, y, style) => ({ name, color, style, kind: "line", smooth: true, points: shown.map((row) => ({
    x: x(row), y: y(row), text: `${x(row).toFixed(2)}, ${y(row).toFixed(2)}` })) });
  const axis = (label, all) => { // wide enough for labels that differ
    const low = Math.min(...all), least = 1e-3 * Math.max(1, Math.abs(low));
    return { label, low, high: Math.max(low + least, ...all) };
  };
  const show = (id, label, x, y, all) => {
    const points = all.flatMap((one) => one.points);
    plot($(id), label, axis(x, points.map((at) => at.x)), axis(y, points.map((at) => at.y)), all);
  };
  const degrees = (column) => (row) => (row[column] * 180) / Math.PI, time = (row) => row[0];
  show("phase", "Phase plane of the last rod", "angle [\u00b0]", "angular velocity [rad/s]",
    [series("last rod", "blue", degrees(n), (row) => row[2 * n])]);
  show("energies", "Energy against time", "time [s]", "energy [J]", [
    series("all", "blue", time, (row) => row[energy]),
    ...(chain.kinetic === null ? [] : [series("kinetic", "orange", time, (row) => row[energy + 1]),
      series("potential", "green", time, (row) => row[energy] - row[energy + 1], "dashed")])]);
  $("apart").parentElement.hidden = !twin;
  if (twin) show("apart", "Angle between the last rods", "time [s]", "last rods apart [\u00b0]",
    [series("second chain minus first", "pink", time, (row) => degrees(energy + 1 + n)(row) - degrees(n)(row))]);
}

function save(blob, name) {
  Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name }).click();
}

function table() {
  const each = (name) => Array.from({ length: chain.n }, (_, k) => name + k);
  const heads = ["time", ...each("theta"), ...each("omega"), "energy", "kinetic", ...(twin ? each("second_theta") : []),
    ...(chain.cart === null ? [] : ["cart_position", "cart_velocity"])];
  return [heads, ...rows].map((row) => `${row}\n`).join("");
}

$("csv").onclick = () => save(new Blob([table()], { type: "text/csv" }), "pendulums.csv");
$("film").onclick = () => {
  if (film) return film.stop();
  const parts = [];
  film = new MediaRecorder($("chain").captureStream());
  film.ondataavailable = ({ data }) => parts.push(data);
  film.onstop = () => {
    save(new Blob(parts, { type: film.mimeType }), `pendulums.${/mp4/.test(film.mimeType) ? "mp4" : "webm"}`);
    film = null;
    $("film").textContent = "Film";
  };
  film.start();
  player.redraw(); // a film has a picture at least
  $("film").textContent = "Stop and save";
};
$("film").hidden = !globalThis.MediaRecorder;
$("angles").onchange = () => (understood().wrong ? sayAngles() : release());
$("twin").onchange = release;
$("lesson").ontoggle = showPlots;
setInterval(() => player.playing && showPlots(), 300);
