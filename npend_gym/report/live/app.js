// What the reader does.

for (const id of Object.keys(UNITS))
  $(id).oninput = () => {
    chosen = null;
    if (id === "n" || (id === "angle" && !motor) || (released !== null && chain.output("TIME") === 0)) release();
    else if (id !== "angle") goOn();
    showValues();
  };
for (const input of document.querySelectorAll("input[name=motor]"))
  input.onchange = () => (Number(input.value) ? swing(Number(input.value)) : release());
$("controls").onsubmit = (event) => event.preventDefault();
$("play").onclick = () => play(!running);
$("release").onclick = release;
$("step").onclick = step;
$("theme").onclick = () => {
  const root = document.documentElement.style;
  const system = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  root.colorScheme = (root.colorScheme || system) === "dark" ? "light" : "dark";
  stage.fit();
  dirty = true;
};

function step() {
  play(false);
  for (let k = 0; k < 2; k++) tick();
}

function nearest(event) {
  const box = $("chain").getBoundingClientRect(), places = chain.places();
  const [x, y] = stage.place([event.clientX - box.left, event.clientY - box.top], chain.totalLength);
  let [bob, far] = [-1, stage.place([stage.width / 2 + TOUCH, 0], chain.totalLength)[0]];
  for (let i = 0; i < chain.n; i++) {
    const distance = Math.hypot(places[2 * i + 2] - x, places[2 * i + 3] - y);
    if (distance < far) [bob, far] = [i, distance];
  }
  return { bob, x, y };
}

$("chain").onpointerdown = (event) => {
  const at = nearest(event);
  if (at.bob < 0 || event.button > 0) return;
  $("chain").setPointerCapture(event.pointerId);
  [pull, dirty] = [at, true];
};
$("chain").onpointermove = (event) => {
  const at = nearest(event);
  $("chain").style.cursor = pull ? "grabbing" : at.bob < 0 ? "" : "grab";
  if (!pull || pull.key) return;
  Object.assign(pull, { x: at.x, y: at.y });
  if (!running) pose(pull.bob, at.x, at.y);
};
$("chain").onpointerup = $("chain").onpointercancel = letGo;

/** By keys a bob is pulled to the side by a fifth of the chain's length, or posed a bit further. */
function pullBy(side) {
  chosen ??= chain.n - 1;
  const places = chain.places(), [x, y] = [places[2 * chosen + 2], places[2 * chosen + 3]];
  if (running) pull = { bob: chosen, x: x + 0.2 * side * chain.totalLength, y, key: true };
  else pose(chosen, x + 0.03 * side * chain.totalLength, y);
  dirty = true;
}

function choose(by) {
  chosen = Math.min(chain.n - 1, Math.max(0, (chosen ?? chain.n) + by));
  dirty = true;
  showValues();
}

$("chain").onkeydown = (event) => {
  const act = {
    ArrowLeft: () => pullBy(-1), ArrowRight: () => pullBy(1), ArrowUp: () => choose(-1), ArrowDown: () => choose(1),
    " ": () => play(!running), r: release, ".": step, Escape: () => { chosen = null; showValues(); dirty = true; },
  }[event.key];
  if (!act || event.ctrlKey || event.altKey || event.metaKey) return;
  event.preventDefault();
  if (!event.repeat || event.key.startsWith("Arrow")) act();
};
$("chain").onkeyup = (event) => { if (pull?.key && /^Arrow(Left|Right)$/.test(event.key)) letGo(); };
$("chain").onblur = () => { if (pull?.key) letGo(); };

new ResizeObserver(() => { stage.fit(); dirty = true; }).observe($("chain"));
matchMedia("(prefers-color-scheme: dark)").onchange = () => { stage.fit(); dirty = true; };
showValues();
release();
play(running);
requestAnimationFrame(frame);
document.body.dataset.ready = "true";
globalThis.npend = { chain, policies, data, Chain, unpacked }; // to play with in the browser's console
