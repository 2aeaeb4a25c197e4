// What the reader does.

for (const id of Object.keys(UNITS))
  $(id).oninput = () => {
    chosen = null;
    if (id === "n" || id === "angle") $("angles").value = "";
    if (id === "n" || (id === "angle" && !motor) || (released !== null && chain.output("TIME") === 0)) release();
    else if (id !== "angle") goOn();
    showValues();
  };
for (const input of document.querySelectorAll("input[name=motor]"))
  input.onchange = () => (Number(input.value) ? swing(Number(input.value)) : release());
$("controls").onsubmit = (event) => event.preventDefault();
$("play").onclick = () => play(!player.playing);
$("release").onclick = release;
$("step").onclick = step;

function step() {
  play(false);
  for (let k = 0; k < 2; k++) tick();
}

function nearest(event) {
  const box = $("chain").getBoundingClientRect();
  const [x, y] = stage.place([event.clientX - box.left, event.clientY - box.top]);
  let [bob, far] = [null, TOUCH / stage.reach];
  chain.joints().forEach((joint, i) => {
    const distance = Math.hypot(joint[0] - x, joint[1] - y), moves = i > 0 || chain.cart !== null;
    if (moves && distance < far) [bob, far] = [i - 1, distance];
  });
  return { bob, x, y };
}

$("chain").onpointerdown = (event) => {
  const at = nearest(event);
  if (at.bob === null || event.button > 0) return;
  $("chain").setPointerCapture(event.pointerId);
  pull = at;
  player.redraw();
};
$("chain").onpointermove = (event) => {
  const at = nearest(event);
  $("chain").style.cursor = pull ? "grabbing" : at.bob === null ? "" : "grab";
  if (!pull || pull.key) return;
  Object.assign(pull, { x: at.x, y: at.y });
  if (!player.playing) pose(pull.bob, at.x, at.y);
};
$("chain").onpointerup = $("chain").onpointercancel = letGo;

/** By keys a bob is pulled to the side by a fifth of the chain's length, or posed a bit further. */
function pullBy(side) {
  chosen ??= chain.n;
  const [x, y] = chain.joints()[chosen];
  if (chosen === 0) turnBy(side);
  else if (player.playing) pull = { bob: chosen - 1, x: x + 0.2 * side, y, key: true };
  else pose(chosen - 1, x + 0.03 * side, y);
  player.redraw();
}

/** At the pivot keys are a motor, or turn the whole chain; a cart they push, or move. */
function turnBy(side) {
  if (player.playing) turn = side;
  else if (chain.cart !== null) pose(-1, chain.joints()[0][0] + 0.03 * side, 0);
  else rest(Array.from(chain.theta, (angle) => angle + 0.05 * side));
}

/** Let keys act on the next joint, or on none. */
function choose(by) {
  chosen = by === null ? null : Math.min(chain.n, Math.max(0, (chosen ?? chain.n + 1) + by));
  player.redraw();
  showValues();
}

onKeys($("chain"), {
  ArrowLeft: () => pullBy(-1), ArrowRight: () => pullBy(1), ArrowUp: () => choose(-1),
  ArrowDown: () => choose(1), " ": () => play(!player.playing), ".": step, r: release, R: release,
  Escape: () => choose(null),
});
$("chain").onkeyup = (event) => { if ((turn || pull?.key) && /^Arrow(Left|Right)$/.test(event.key)) letGo(); };
$("chain").onblur = () => { if (turn || pull?.key) letGo(); };

followLooks(stage, () => player.redraw());
release();
showValues();
play(!reduced);
document.body.dataset.ready = "true";
globalThis.npend = { chain, policies, data, Chain, unpacked }; // to play with in the browser's console
