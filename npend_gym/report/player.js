// Plays recorded motions: the chain, and the controls. Page and notebooks share it.

const data = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);

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

function drawChain(release, time) {
  const canvas = $("chain"), ratio = devicePixelRatio || 1;
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  const pen = new Pen(canvas, ratio), ink = getComputedStyle(canvas).color;
  const scale = 0.46 * Math.min(width, height);
  const pixel = (x, y) => [width / 2 + scale * x, height / 2 - scale * y];
  const color = (bob) => blend(RAMP, bob / release.n);
  pen.fade(0.25);
  pen.ring(pixel(0, 0), scale, ink, 1);
  const tip = release.n - 1, trace = [];
  for (let t = Math.max(0, time - TRACE_SECONDS); t < time; t += release.interval / 2)
    trace.push(pixel(...place(release, tip, t)));
  pen.fade(0.5);
  pen.line(trace, TIP, 2);
  pen.fade(1);
  const bobs = [];
  for (let bob = 0; bob < release.n; bob++) bobs.push(pixel(...place(release, bob, time)));
  const joints = [pixel(0, 0), ...bobs], radius = Math.min(8, Math.max(2, (0.35 * scale) / release.n));
  const along = (link, share) =>
    [0, 1].map((c) => joints[link][c] + share * (joints[link + 1][c] - joints[link][c]));
  if (release.centres.length === 0) {
    pen.line(joints, ink, release.n > 60 ? 2.5 : 1.5);
    bobs.forEach((at, bob) => pen.disc(at, radius, color(bob)));
    pen.disc(bobs[tip], Math.max(radius + 1, 5), TIP);
  } else { // links are bars, with a dot at the centre of mass
    release.centres.forEach((share, link) => {
      pen.line([joints[link], along(link, share)], ink, radius / 2);
      pen.line([joints[link], joints[link + 1]], link === tip ? TIP : color(link), 1.6 * radius);
    });
    release.centres.forEach((share, link) => pen.disc(along(link, share), radius / 2, ink));
    joints.slice(0, -1).forEach((at) => pen.disc(at, radius / 3, "white"));
  }
  for (const { bob, period } of release.order)
    if (period <= time) pen.disc(pixel(...place(release, bob - 1, period)), 0.45 * radius, ink);
  pen.disc(pixel(0, 0), 3, ink);
}

// ---- playback --------------------------------------------------------------------------------

let release, time = 0, playing = false, last = 0;
const beside = { chosen() {}, shown() {} }; // what a page shows beside the chain sets these

function choose(index) {
  release = data.releases[index];
  $("release").value = index;
  time = 0;
  $("time").max = release.end;
  $("chain").setAttribute("aria-label", `Animation of ${release.label}`);
  beside.chosen();
  show();
}

function show() {
  drawChain(release, time);
  $("time").value = time;
  $("time").setAttribute("aria-valuetext", `${time.toFixed(2)} seconds`);
  $("clock").textContent = `${time.toFixed(2)} of ${release.end.toFixed(2)} s`;
  beside.shown();
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

data.releases.forEach(({ label }, k) => $("release").add(new Option(label, k)));
$("release").onchange = (event) => choose(Number(event.target.value));
$("play").onclick = () => play(!playing);
$("time").oninput = (event) => go(Number(event.target.value));
$("controls").onsubmit = (event) => event.preventDefault();
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
document.addEventListener("DOMContentLoaded", () => {
  choose(data.releases.length - 1);
  new ResizeObserver(() => drawChain(release, time)).observe($("chain"));
  matchMedia("(prefers-color-scheme: dark)").onchange = () => show();
});
