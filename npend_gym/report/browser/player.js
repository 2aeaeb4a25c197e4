// Plays recorded motions.

const TRACE_SECONDS = 3;
const beside = { chosen() {}, shown() {} }; // what a page shows beside the chain sets these

for (const release of data.releases) {
  const bytes = Uint8Array.from(atob(release.places), (c) => c.charCodeAt(0));
  // x, y of every bob at every instant, over the chain's length; those of a cart come first
  release.places = new Float32Array(bytes.buffer);
  release.bodies = release.n + (release.onCart ? 1 : 0);
  release.instants = release.places.length / (2 * release.bodies);
  release.end = (release.instants - 1) * release.interval;
}

/** Place of a bob (counted from 0), or of the cart, -1, at a time, between the two nearest instants. */
function place(release, bob, time) {
  if (bob < 0 && !release.onCart) return [0, 0];
  const at = Math.min(Math.max(time / release.interval, 0), release.instants - 1);
  const k = Math.min(Math.floor(at), Math.max(release.instants - 2, 0));
  const { places, bodies } = release, body = bob + bodies - release.n;
  const [i, j] = [2 * (k * bodies + body), 2 * ((k + 1) * bodies + body)];
  if (j >= places.length) return [places[i], places[i + 1]];
  const share = at - k;
  return [0, 1].map((c) => places[i + c] + share * (places[j + c] - places[i + c]));
}

let release, time = 0;
const stage = new Stage($("chain"), data.palette);
const player = new Player((passed) => {
  time = Math.min(release.end, time + passed);
  if (time >= release.end) player.play(false);
}, show);
$("play").onclick = () => playOrPause();

function playOrPause() {
  if (!player.playing && time >= release.end) time = 0;
  player.play(!player.playing);
}

function show() {
  const { n, interval, periods, centres, onCart } = release, trace = [];
  for (let t = Math.max(0, time - TRACE_SECONDS); t < time; t += interval / 2)
    trace.push(place(release, n - 1, t));
  const joints = [place(release, -1, time), ...periods.map((_, bob) => place(release, bob, time))];
  const marks = periods.flatMap((period, bob) =>
    period !== null && period <= time ? [place(release, bob, period)] : []);
  stage.draw({ joints, centres, trace, marks, onCart });
  $("time").value = time;
  $("time").setAttribute("aria-valuetext", `${time.toFixed(2)} seconds`);
  $("clock").textContent = `${time.toFixed(2)} of ${release.end.toFixed(2)} s`;
  beside.shown();
}

function choose(index) {
  release = data.releases[index];
  $("release").value = index;
  $("time").max = release.end;
  $("chain").setAttribute("aria-label", `Animation of ${release.label}`);
  beside.chosen();
  go(0);
}

function go(to) {
  time = Math.min(Math.max(to, 0), release.end);
  show();
}

data.releases.forEach(({ label }, k) => $("release").add(new Option(label, k)));
$("release").onchange = (event) => choose(Number(event.target.value));
$("time").oninput = (event) => go(Number(event.target.value));
$("controls").onsubmit = (event) => event.preventDefault();
onKeys(document, {
  " ": playOrPause, ",": () => go(time - release.interval), ".": () => go(time + release.interval),
  Home: () => go(0), End: () => go(release.end),
});
followLooks(stage, () => player.redraw());
// once what a page shows beside the chain is there
document.addEventListener("DOMContentLoaded", () => choose(data.releases.length - 1));
