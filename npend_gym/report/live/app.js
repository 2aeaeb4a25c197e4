// The page: what moves the chain, what the reader does, what is told.

const data = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
const { physics } = data, { task } = physics;

const TICK = task.dt / Math.round(task.dt * 120); // s, of the motion
const BUDGET = 11; // ms of computation in a picture's 16; beyond it time runs slower than told
const TOUCH = 44; // pixels within which a bob is grabbed
const MAX_PARTS = 64; // of a tick, while a bob is pulled
const reduced = matchMedia("(prefers-reduced-motion: reduce)").matches;

const bytes = await unpacked(data.binary);
const chain = await Chain.load(bytes.subarray(0, data.moduleBytes), data.layout, physics);
const policies = new Map();
let end = data.moduleBytes;
for (const one of data.policies) {
  const policy = new Policy(one, bytes, end);
  policies.set(one.n, policy);
  end = policy.end;
}
const stage = new Stage($("chain"), data.palette, reduced);

// ---- the motion ------------------------------------------------------------------------------

let running = !reduced, dirty = true, owed = 0, ticks_ = 0, slow = false;
let motor = null; // the policy that acts, if any
let action = 0; // its last
let pull = null; // {bob, x, y, by}: a bob, and where it is pulled to [m]
let chosen = null; // the bob that keys push
let released = null; // the angle of the release, while nothing else has moved the chain
let upright = 0; // s for which the goal of the motor has been met

const value = (id) => Number($(id).value);
const parameters = () => {
  const n = value("n"), along = (k) => (n > 1 ? k / (n - 1) - 0.5 : 0);
  const spread = (id) => {
    const shares = Array.from({ length: n }, (_, k) => 2 ** (value(id) * along(k)));
    const mean = shares.reduce((sum, share) => sum + share, 0) / n;
    return shares.map((share) => share / mean); // 1 m and 1 kg on average
  };
  const damping = new Array(n).fill(value("damping"));
  return { masses: spread("masses"), lengths: spread("lengths"), gravity: value("gravity"), damping };
};
const radians = () => (value("angle") / 180) * Math.PI;
const isUniform = () => value("lengths") === 0 && value("masses") === 0;

function begin(theta, omega) {
  chain.begin(parameters(), theta, omega);
  chain.torque.fill(0);
  stage.clear();
  [owed, ticks_, upright, action, dirty] = [0, 0, 0, 0, true];
  tell.reset();
}

function release() {
  [motor, pull, released] = [null, null, radians()];
  begin(new Array(value("n")).fill(released), new Array(value("n")).fill(0));
  showMotor();
}

/** Go on from the present state, measuring anew. */
function goOn() {
  released = null;
  begin(Array.from(chain.theta), Array.from(chain.omega));
}

/** Let a network of the package swing up its chain from near rest. */
function swing(n) {
  for (const [id, at] of Object.entries({ n, gravity: physics.gravity, damping: 0, lengths: 0, masses: 0 }))
    $(id).value = at;
  const near = () => Array.from({ length: n }, () => (2 * Math.random() - 1) * task.nearness);
  [motor, pull, released, chosen] = [policies.get(n), null, null, null];
  begin(near(), near());
  showValues();
  showMotor();
}

function tick() {
  const { torque } = chain, every = Math.round(task.dt / TICK);
  if (motor && ticks_ % every === 0) action = motor.act(chain.observation);
  ticks_ += 1;
  const limit = task.torque * chain.liftingEnergy;
  const parts = pull ? pullParts() : 1;
  for (let part = 0; part < parts; part++) {
    torque.fill(0);
    if (motor) torque[0] = limit * action;
    if (pull) addPull();
    chain.advance(TICK / parts);
  }
  upright = motor && !pull && chain.flag("SUCCESS") ? task.hold : 0;
  stage.follow(chain, !motor && !pull);
  if (chain.flag("DIVERGED")) release();
}

/** A damped spring from the bob to the pointer: 1/30 of the chain's length bears its weight. */
function spring() {
  const { totalLength, totalMass } = chain, weight = totalMass * (value("gravity") || physics.gravity);
  const stiffness = (30 * weight) / totalLength;
  return { stiffness, damping: Math.sqrt(stiffness * totalMass), most: 12 * weight };
}

function pullParts() { // the force is held for a part of a tick, in which it must not brake too much
  const rate = spring().damping / Math.min(...chain.masses);
  return Math.min(MAX_PARTS, Math.max(1, Math.ceil((rate * TICK) / 0.2)));
}

function addPull() {
  const { stiffness, damping, most } = spring(), places = chain.places(), velocity = chain.velocity(pull.bob);
  const force = [pull.x, pull.y].map((to, c) => stiffness * (to - places[2 * pull.bob + 2 + c]) - damping * velocity[c]);
  const size = Math.hypot(...force), share = size > most ? most / size : 1;
  chain.push(pull.bob, share * force[0], share * force[1]);
}

/** Bend the chain so that a bob comes to a place, the rods below it keeping their directions. */
function pose(bob, x, y) {
  const places = chain.places(), { lengths } = chain, theta = Array.from(chain.theta);
  const points = Array.from({ length: bob + 2 }, (_, i) => [places[2 * i], places[2 * i + 1]]);
  const towards = (from, to, length) => { // the point at a distance from one, in the direction of another
    const [dx, dy] = [to[0] - from[0], to[1] - from[1]], far = Math.hypot(dx, dy) || 1;
    return [from[0] + (dx * length) / far, from[1] + (dy * length) / far];
  };
  for (let round = 0; round < 40; round++) { // from the bob to the pivot and back (FABRIK)
    points[bob + 1] = [x, y];
    for (let i = bob; i > 0; i--) points[i] = towards(points[i + 1], points[i], lengths[i]);
    for (let i = 0; i <= bob; i++) points[i + 1] = towards(points[i], points[i + 1], lengths[i]);
  }
  for (let i = 0; i <= bob; i++) {
    const angle = Math.atan2(points[i + 1][0] - points[i][0], points[i][1] - points[i + 1][1]);
    theta[i] = angle + 2 * Math.PI * Math.round((theta[i] - angle) / (2 * Math.PI));
  }
  released = null;
  begin(theta, new Array(chain.n).fill(0));
}

function letGo() {
  if (!pull) return;
  pull = null;
  if (running && !motor) goOn();
}

let last = performance.now();
function frame(now) {
  const elapsed = Math.min(now - last, 100) / 1000;
  last = now;
  if (running) run(elapsed * value("speed"));
  if (running || dirty) {
    stage.draw(chain, { chosen, pull, action: motor && action });
    tell.show();
  }
  dirty = false;
  requestAnimationFrame(frame);
}

function run(seconds) {
  const start = performance.now();
  for (owed += seconds; owed >= TICK; owed -= TICK) {
    tick();
    slow = performance.now() - start > BUDGET;
    if (slow) owed = Math.min(owed, TICK);
  }
}

// ---- what is told ----------------------------------------------------------------------------

const seconds = (time) => `${time.toFixed(2)} s`;
const plural = (n, word) => `${n} ${word}${n === 1 ? "" : "s"}`;

/** Numbers, diagram and table follow the motion; the sentence, which is read out, changes seldom. */
const tell = {
  completed: -1, sentence: "", spoken: -Infinity,
  reset() { [this.completed, this.spoken] = [-1, -Infinity]; },
  show() {
    const energy = chain.output("ENERGY"), error = Math.abs(chain.output("ENERGY_ERROR"));
    $("clock").textContent = seconds(chain.output("TIME"));
    $("energy").textContent = `${energy.toPrecision(4)} J`;
    $("error").textContent = pull ? "\u2013" : error.toExponential(0);
    $("pace").textContent = slow ? "slower than told: too much to compute" : "";
    const completed = chain.output("COMPLETED"), centre = chain.output("PSEUDO_PERIOD_COM");
    const known = pull ? -2 : completed + (centre > 0 ? 0.5 : 0);
    if (known !== this.completed) {
      this.completed = known;
      if (pull) this.periods(new Array(chain.n).fill(0), 0); // known are those of free motion alone
      else this.periods(Array.from(chain.periods, (period) => period || 0), centre);
    }
    const now = performance.now();
    if (now - this.spoken > 2000) {
      this.spoken = now;
      this.say(this.text());
    }
  },
  say(text) {
    if (text !== this.sentence) $("status").textContent = this.sentence = text;
  },
  text() {
    const { n } = chain, done = chain.output("COMPLETED");
    if (pull) return `Bob ${pull.bob + 1} of ${n} is pulled.`;
    if (motor && upright) return `${plural(n, "rod")} stand upright. Pull a bob, and see whether they get up again.`;
    if (motor) return `A network swings up ${plural(n, "rod")} by the motor at the pivot.`;
    if (done === 0) return `${plural(n, "pendulum")} ${running ? "swing" : "rest"}; no bob has completed its pseudo-period.`;
    return `${done} of ${plural(n, "bob")} ${done === 1 ? "has" : "have"} completed, mean pseudo-period ${seconds(chain.output("PSEUDO_PERIOD"))}.`;
  },
  periods(periods, centre) {
    const known = !motor && !pull && released !== null && isUniform() && value("gravity") > 0 && value("damping") === 0;
    const degrees = Math.round(value("angle"));
    const law = known ? data.law[chain.n - 1] * data.factor[degrees] / Math.sqrt(value("gravity")) : null;
    $("measured").hidden = motor !== null;
    drawPeriods($("periods"), periods, centre, law);
    $("periods").setAttribute("aria-label", `Pseudo-period of each of ${plural(chain.n, "bob")}; values in the table below`);
    $("law").textContent = law ? `law T(N, a): ${seconds(law)}` : "";
    $("centre").textContent = centre > 0 ? `centre of mass: ${seconds(centre)}` : "centre of mass: not yet";
    $("table").tBodies[0].replaceChildren(...periods.map((period, k) => {
      const row = document.createElement("tr"), head = document.createElement("th");
      Object.assign(head, { scope: "row", textContent: k + 1 });
      row.append(head, Object.assign(document.createElement("td"), { textContent: period > 0 ? period.toFixed(4) : "\u2013" }));
      return row;
    }));
  },
};

const UNITS = {
  n: (n) => plural(n, "pendulum"), angle: (angle) => `${angle}\u00b0`, gravity: (g) => `${g.toFixed(2)} m/s\u00b2`,
  damping: (d) => `${d.toFixed(2)} N m s`, lengths: (power) => `\u00d7 ${(2 ** power).toPrecision(2)}`,
  masses: (power) => `\u00d7 ${(2 ** power).toPrecision(2)}`,
};

function showValues() {
  for (const [id, write] of Object.entries(UNITS)) {
    const text = write(value(id));
    $(`${id}-value`).textContent = text;
    $(id).setAttribute("aria-valuetext", text.replace("\u00d7", "times"));
  }
  $("chain").setAttribute("aria-label", `${plural(value("n"), "pendulum")}${chosen === null ? "" : `; bob ${chosen + 1} is chosen`}`);
}

function showMotor() {
  for (const input of document.querySelectorAll("input[name=motor]"))
    input.checked = Number(input.value) === (motor?.n ?? 0);
  dirty = true;
}

function play(on) {
  running = on;
  $("play").textContent = on ? "Pause" : "Run";
  tell.spoken = -Infinity;
  dirty = true;
}

// ---- what the reader does --------------------------------------------------------------------

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
