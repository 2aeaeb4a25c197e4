// What moves the chain: time, a network, and the reader, who pulls its bobs or poses it.

const data = JSON.parse(document.getElementById("data").textContent);
const $ = (id) => document.getElementById(id);
const { physics } = data, { task } = physics;

const TICK = task.dt / Math.round(task.dt * 120); // s, of the motion
const BUDGET = 11; // ms of computation in a picture's 16; beyond it time runs slower than told
const TOUCH = 44; // pixels within which a bob is grabbed
const MAX_PARTS = 64; // of a tick, while a bob is pulled
const reduced = matchMedia("(prefers-reduced-motion: reduce)").matches;

if (!globalThis.WebAssembly || !globalThis.DecompressionStream)
  $("status").textContent = "This browser is too old: the pendulums need WebAssembly and DecompressionStream.";
const chain = await Chain.load(await unpacked(data.module), data.layout, physics);
const policies = new Map(), weights = await unpacked(data.weights);
let end = 0;
for (const one of data.policies) {
  const policy = new Policy(one, weights, end);
  policies.set(one.n, policy);
  end = policy.end;
}
const stage = new Stage($("chain"), data.palette, reduced);

let running = !reduced, dirty = true, owed = 0, ticked = 0, slow = false;
let motor = null; // the policy that acts, if any
let action = 0; // its last
let pull = null; // {bob, x, y}: a bob, and where it is pulled to [m]; {key}: by a key
let chosen = null; // the bob that keys push
let released = null; // rad, of the release, while nothing else has moved the chain
let upright = false; // whether the network has met its goal for as long as success needs

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
  [owed, ticked, upright, action, dirty] = [0, 0, false, 0, true];
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
  if (motor && ticked % every === 0) action = motor.act(chain.observation);
  ticked += 1;
  const limit = task.torque * chain.liftingEnergy;
  const parts = pull ? pullParts() : 1;
  for (let part = 0; part < parts; part++) {
    torque.fill(0);
    if (motor) torque[0] = limit * action;
    if (pull) addPull();
    chain.advance(TICK / parts);
  }
  upright = motor && !pull && chain.flag("SUCCESS");
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
